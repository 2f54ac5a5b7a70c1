"""Operators without a person: one that does the task and reacts to what it feels and sees, and one
that was recorded.

Both are asked once a tick what they say, `messages(tick, frame)`, and are deterministic: a session
is the same again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN
from ravenjax.train.protocol.frame import PHASES, Frame
from ravenjax.train.protocol.jaws import closing_point
from ravenjax.train.protocol.world import Point, to_world, view_from_world
from ravenjax.train.scenario import Speeds
from ravenjax.train.tasks import Task

Message = dict[str, Any]

INPUT_EVERY_MS = 16
"""As a page at 60 Hz sends."""
UNAVAILABLE_MS = 1000
"""A robot that does not follow for so long, though the pedal is down, is restarted."""
REACTIONS = ("none", "release", "slow", "stop")
_STOPPED = PHASES.index("stopped")


class SessionOperator(Protocol):
    """Whoever operates."""

    def messages(self, tick: int, frame: Frame) -> list[Message]:
        """What is said before this tick, `frame` being that of the tick before."""
        ...


class Follower:
    """Goes for the task's goal, speed in proportion to the distance, and reacts.

    It feels the cue where it is on, and acts on its onset: a pull that stays after the foot was off
    is no news. Without the cue, or before it, it may see that the instrument has left its model
    (the ghost on the page) by `sees_mm`. Delays are from there to the action; they are assumptions,
    as in `stages.reaction`: 0.25 s to a touch; about 0.4 s to something seen that was not looked
    for.
    """

    def __init__(
        self,
        task: Task,
        arms: Sequence[ArmName],
        speeds: Speeds,
        *,
        reaction: Literal["none", "release", "slow", "stop"] = "release",
        delay_ms: int = 250,
        sees_mm: float = math.inf,
        sees_delay_ms: int = 400,
        rest_ms: int = 1500,
        pedal_ms: int = 200,
        restarts: bool = True,
        gain_per_s: float = 4.0,
    ) -> None:
        """rest_ms: how long it stays released or slow. pedal_ms: when it first steps on the
        pedal.
        """
        if reaction not in REACTIONS:
            raise UserError(
                f"reaction is {shown(reaction)}, expected one of {', '.join(REACTIONS)}"
            )
        self.task, self.arms = task, tuple(arms)
        self.reaction = reaction
        self.delay_ms, self.sees_mm, self.sees_delay_ms = delay_ms, sees_mm, sees_delay_ms
        self.rest_ms, self.pedal_ms, self.restarts = rest_ms, pedal_ms, restarts
        self._gain = gain_per_s * 1e3 / speeds.move_mm_s  # share of full speed per m
        self._grasp_per_rad = 4.0
        self._act_at = -1  # tick of the action that is coming; -1: none
        self._until = -1  # the action holds until then
        self._restart_at = -1
        self._felt, self._seen = False, False
        self._waited = 0  # ms of a robot that does not follow

    def messages(self, tick: int, frame: Frame) -> list[Message]:
        out: list[Message] = []
        waits = frame.number("pedal") and frame.number("runlevel") != PEDAL_DOWN
        self._waited = self._waited + 1 if waits else 0
        gone = frame.number("phase") == _STOPPED or self._waited > UNAVAILABLE_MS
        if gone or tick <= self._restart_at:
            self._act_at = -1
            return self._restart(tick)
        self._restart_at = -1
        due = self._noticed(tick, frame)
        if (
            self._act_at < 0
            and tick > self._until
            and self.reaction != "none"
            and frame.number("pedal")
        ):
            self._act_at = due
        if 0 <= self._act_at <= tick:
            self._act_at, self._until = -1, tick + self.rest_ms
            if self.reaction == "stop":
                out.append({"type": "operator", "do": "estop"})
            out.append(self._input(tick, frame))
        elif tick % INPUT_EVERY_MS == 0:
            out.append(self._input(tick, frame))
        return out

    def _noticed(self, tick: int, frame: Frame) -> int:
        """Tick of the action that follows from what is felt or seen now and was not before; -1:
        none.
        """
        due = []
        touch = bool(frame.number("cue_on") and frame.number("console_alive"))
        felt = touch and any(any(frame[f"{arm}/force"].tolist()) for arm in self.arms)
        visible = any(frame.number(f"{arm}/error_mm") > self.sees_mm for arm in self.arms)
        if felt and not self._felt:
            due.append(tick + self.delay_ms)
        if visible and not self._seen:
            due.append(tick + self.sees_delay_ms)
        self._felt, self._seen = felt, visible
        return min(due, default=-1)

    def _input(self, tick: int, frame: Frame) -> Message:
        acting = tick < self._until
        released = acting and self.reaction in ("release", "stop")
        slow = 0.1 if acting and self.reaction == "slow" else 1.0
        arms = (
            {}
            if released
            else {arm: hand for arm in self.arms if (hand := self._hand(arm, frame, slow))}
        )
        return {
            "type": "input",
            "source": "script",
            "pedal": tick >= self.pedal_ms and not released,
            "arms": arms,
        }

    def _hand(self, arm: ArmName, frame: Frame, slow: float) -> Message:
        row = frame[f"{arm}/link_jpos"].tolist()
        tip = to_world(arm, closing_point(arm, frame[f"{arm}/tip"].tolist(), row))
        wish = self.task.wish(arm, tip)
        if wish is None:
            return {}
        way: Point = (wish.point[0] - tip[0], wish.point[1] - tip[1], wish.point[2] - tip[2])
        right, up, toward = view_from_world(way)
        gain = slow * self._gain
        opening = row[5] + row[6]
        aim = 0.6 if wish.closed else 1.4  # rad, well beyond what the pegs' jaws are told apart by
        grasp = min(max((opening - aim) * self._grasp_per_rad, -1.0), 1.0)
        return {
            "move": [gain * right, gain * up, gain * toward],
            "grasp": grasp if abs(opening - aim) > 0.02 else 0.0,
        }

    def _restart(self, tick: int) -> list[Message]:
        """The robot does not follow: hands still, foot off once it is seen, and a restart once
        it is understood.
        """
        if self._restart_at < 0:
            self._restart_at = tick + self.rest_ms
        aware = tick - (self._restart_at - self.rest_ms) >= self.sees_delay_ms
        out: list[Message] = []
        if tick % INPUT_EVERY_MS == 0:
            out.append({"type": "input", "source": "script", "pedal": not aware, "arms": {}})
        if self.restarts and tick == self._restart_at:
            self.pedal_ms = tick + self.rest_ms // 2
            out.append({"type": "operator", "do": "restart"})
        return out


class Recorded:
    """Says what was said, at the same ticks."""

    def __init__(self, said: Iterable[tuple[int, Mapping[str, Any]]]) -> None:
        self.said = sorted(
            ((int(tick), dict(message)) for tick, message in said), key=lambda pair: pair[0]
        )
        self._next = 0

    def messages(self, tick: int, frame: Frame) -> list[Message]:
        out = []
        while self._next < len(self.said) and self.said[self._next][0] <= tick:
            out.append(self.said[self._next][1])
            self._next += 1
        return out


def save(path: str | Path, said: Iterable[tuple[int, Mapping[str, Any]]]) -> None:
    """Write what was said as JSON lines, {"tick": ms, "message": {..}} each."""
    lines = (
        json.dumps({"tick": tick, "message": message}, separators=(",", ":"))
        for tick, message in said
    )
    Path(path).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def load(path: str | Path) -> Recorded:
    """The operator of a file that `save` wrote. Raises UserError."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {error}. Expected JSON lines") from None
    entries = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
            tick, message = entry["tick"], entry["message"]
            good = isinstance(tick, int) and tick >= 0 and isinstance(message, dict)
        except (ValueError, TypeError, KeyError, RecursionError):
            good = False
        if not good:
            raise UserError(
                f'{path}:{number}: got {shown(line)}, expected {{"tick": ms, "message": {{..}}}}'
            )
        entries.append((tick, message))
    return Recorded(entries)
