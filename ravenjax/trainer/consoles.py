"""Who drives a session beside the page: a script, or a console over the network."""

from __future__ import annotations

from typing import Any

from ravenjax.trainer.protocol.frame import Frame
from ravenjax.trainer.robot_link.itp import ItpServer
from ravenjax.trainer.session import scripts
from ravenjax.trainer.session.advance import Session


class Scripted:
    """A scripted or recorded operator as a console."""

    def __init__(self, script: str, session: Session) -> None:
        self._session = session
        self._operator: scripts.SessionOperator
        if script in scripts.REACTIONS:
            speeds = session.scenario.speeds
            self._operator = scripts.Follower(session.task, session.arms, speeds, reaction=script)  # type: ignore[arg-type]
        else:
            self._operator = scripts.load(script)

    def poll(self) -> list[dict[str, Any]]:
        return self._operator.messages(self._session.ticks, self._session.frame)

    def tell(self, frame: Frame) -> None:
        """It sees the frame when it is asked."""


class ItpConsole:
    """A console over the network: increments in, force out."""

    def __init__(self, server: ItpServer, session: Session) -> None:
        self._server, self._arms = server, session.arms
        self._still: dict[str, Any] = dict.fromkeys(session.arms, (0.0, 0.0, 0.0))

    def poll(self) -> list[dict[str, Any]]:
        return self._server.poll()

    def tell(self, frame: Frame) -> None:
        felt = frame.number("cue_on") and frame.number("console_alive")
        forces = self._still
        if felt:
            forces = {arm: frame[f"{arm}/force"].tolist() for arm in self._arms}
        self._server.send_force(forces, int(frame.number("runlevel")), bool(frame.number("soft_estopped")))
