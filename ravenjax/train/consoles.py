"""Consoles that drive a session beside the page: a script, or ITP over the network."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot import ArmName
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.robot_link.packet_filter import TAKEN, Gate
from ravenjax.train.session import pedal, scripts
from ravenjax.train.session.advance import Session
from ravenjax.train.session.command_log import read_commands

SOME_PACKETS = 10
"""After this number of refused packets in `STALE_MS`, and none accepted, the user is informed."""
UNATTENDED_MS = 60_000
"""If a script has not driven by then, the session's time begins all the same, so that it ends."""


class Scripted:
    """A scripted or recorded operator as a console."""

    def __init__(self, script: str, session: Session) -> None:
        self._session = session
        self._operator: scripts.Follower | scripts.Recorded
        if script in scripts.REACTIONS:
            speeds = session.scenario.speeds
            self._operator = scripts.Follower(session.task, session.arms, speeds, script)
        else:
            self._operator = scripts.Recorded(read_commands(script))

    def poll(self) -> list[dict[str, Any]]:
        """The commands before this tick."""
        session = self._session
        commands = self._operator.messages(session.ticks, session.frame)
        if session.ticks == UNATTENDED_MS and session.started is None:
            commands.append({"type": "instructor", "do": "start"})
        return commands

    def tell(self, frame: Frame) -> None:
        """A script reads the frame in `poll`."""


class Refusals:
    """Reports when the packet filter refuses all packets of a console."""

    def __init__(self, gate: Gate) -> None:
        self._gate, self._counts = gate, dict(gate.counts)
        self._polls, self._published = 0, ""

    def poll(self) -> list[dict[str, Any]]:
        """Once a ms: a command "unheard" when packets begin or cease to be accepted."""
        self._polls += 1
        if self._polls % STALE_MS:
            return []
        counts, before = dict(self._gate.counts), self._counts
        more = {cause: count - before[cause] for cause, count in counts.items()}
        self._counts = counts
        accepted, why = more.pop(TAKEN), self._published
        cause = "stranger" if more["stranger"] >= SOME_PACKETS else max(more, key=more.__getitem__)
        if cause != "stranger" and accepted:
            why = ""
        elif more[cause] >= SOME_PACKETS:
            why = pedal.packets(cause)
        if why == self._published:
            return []
        self._published = why
        return [{"type": "unheard", "why": why}]


class PedalWords:
    """Prints why the pedal of a console over the network does not count."""

    def __init__(self, session: Session, say: Callable[[str], None]) -> None:
        self._session, self._say = session, say

    def poll(self) -> list[dict[str, Any]]:
        """This console never sends commands."""
        return []

    def tell(self, frame: Frame) -> None:
        """Print what the last tick found."""
        for line in self._session.pedals.news():
            self._say(line)


class ItpConsole:
    """A console over the network: increments in, force out."""

    def __init__(
        self, server: ItpServer, session: Session, say: Callable[[str], None] = print
    ) -> None:
        """say: takes what a user should know of the console's packets."""
        self._server, self._session, self._arms = server, session, session.arms
        self._say = say
        self._still: dict[str, Any] = dict.fromkeys(session.arms, (0.0, 0.0, 0.0))
        self._refusals = Refusals(server.gate)

    def poll(self) -> list[dict[str, Any]]:
        messages = [
            {**one, "console": "itp"} for one in (*self._server.poll(), *self._refusals.poll())
        ]
        for line in self._server.gate.news():
            self._say(line)
        return messages

    def tell(self, frame: Frame) -> None:
        drives = self._session.arbiter.owner == "itp"
        forces = self._still
        if drives and frame.number("console_alive"):
            setting, cue_on = self._session.scenario, frame.number("cue_on") != 0
            gain, cap = setting.contact.units_per_n, setting.cue.cap
            forces = {arm: force_at_hand(frame, arm, gain, cap, cue_on) for arm in self._arms}
        self._server.send_force(
            forces,
            int(frame.number("runlevel")),
            bool(frame.number("soft_estopped")),
            pedal=drives and frame.number("pedal") != 0,
            drives=drives,
        )


def force_at_hand(
    frame: Frame, arm: ArmName, units_per_n: float, cap: float, cue: bool
) -> tuple[float, float, float]:
    """Device units along the axes of frame 0; never more than `cap`, or the cue's own where that is
    more.

    cue: whether the cue is felt. The contact's force is felt either way: it is no aid, the tissue
    is there.
    """
    places, numbers = frame.layout.places, frame.numbers
    first, touch = places[f"{arm}/force"].start, places[f"{arm}/contact"].start
    pull = numbers[first : first + 3] if cue else [0.0, 0.0, 0.0]
    x, y, z = (a + units_per_n * b for a, b in zip(pull, numbers[touch : touch + 3], strict=True))
    size, most = math.hypot(x, y, z), max(cap, math.hypot(*pull))
    share = most / size if size > most else 1.0
    return x * share, y * share, z * share
