"""Operators without a person: one does the task and reacts to cues, one repeats recorded commands.

Both are deterministic, so a session can be repeated exactly.
"""

import collections
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from ravenjax.errors import UserError
from ravenjax.train.protocol import (
    STOPPED,
    Command,
    Frame,
    Increments,
    Input,
    closing_point,
    to_world,
    view_from_world,
)
from ravenjax.train.robot import PEDAL_DOWN, ArmName
from ravenjax.train.scenario import Speeds
from ravenjax.train.session.advance import Session
from ravenjax.train.tasks import Task

INPUT_EVERY_MS = 16
"""The interval at which a page at 60 Hz sends."""
FIRST_PEDAL_MS = 200
"""The time of the first pedal-down."""
TOUCH_DELAY_MS, SIGHT_DELAY_MS = 250, 400
"""Delays from a touch, or an unexpected sight, to the action; assumed as in `stages.reaction`."""
REST_MS = 1500
"""How long the operator keeps the pedal released or moves slowly."""
UNAVAILABLE_MS = 1000
"""The operator restarts a robot that does not follow for this time although the pedal is down."""
GAIN_PER_S, GRASP_PER_RAD = 4.0, 4.0
UNATTENDED_MS = 60_000
"""The tick at which the session's time begins even if a script has not driven."""
REACTIONS = ("none", "release", "slow", "stop")
_HANDS: TypeAdapter[Input | Increments] = TypeAdapter(
    Annotated[Input | Increments, Field(discriminator="type")]
)


class Follower:
    """Moves toward the task's goal with a speed proportional to the distance, and reacts to
    hazards.

    It feels the cue if the cue is on, and reacts to its onset. A force that persists after the
    pedal was up causes no second reaction. It sees that the robot is stopped, and restarts it.
    """

    def __init__(
        self, task: Task, arms: Sequence[ArmName], speeds: Speeds, reaction: str = "release"
    ) -> None:
        """reaction: one of `REACTIONS`."""
        self._task, self._arms, self._reaction = task, tuple(arms), reaction
        self._gain = GAIN_PER_S * 1e3 / speeds.move_mm_s  # share of full speed per m
        self._pedal_ms = FIRST_PEDAL_MS  # the pedal is down from this tick on
        self._act_at = -1  # tick of the next action; -1: none
        self._until = -1  # the action lasts until this tick
        self._restart_at = -1
        self._felt = False
        self._waited = 0  # ms for which the robot has not followed

    def messages(self, tick: int, frame: Frame) -> list[Command]:
        """Return the commands before this tick; `frame` is that of the previous tick."""
        down = frame.number("pedal")
        waits = down and frame.number("runlevel") != PEDAL_DOWN
        self._waited = self._waited + 1 if waits else 0
        gone = frame.number("phase") == STOPPED or self._waited > UNAVAILABLE_MS
        if gone or tick <= self._restart_at:
            self._act_at = -1
            return self._restart(tick)
        self._restart_at = -1
        touch = bool(frame.number("cue_on") and frame.number("console_alive"))
        felt = touch and any(any(frame[f"{arm}/force"].tolist()) for arm in self._arms)
        begins, self._felt = felt and not self._felt, felt
        if begins and self._act_at < 0 and tick > self._until and down:
            self._act_at = tick + TOUCH_DELAY_MS if self._reaction != "none" else -1
        if 0 <= self._act_at <= tick:
            self._act_at, self._until = -1, tick + REST_MS
            stop = [{"type": "operator", "do": "estop"}] if self._reaction == "stop" else []
            return [*stop, self._input(tick, frame)]
        return [] if tick % INPUT_EVERY_MS else [self._input(tick, frame)]

    def _input(self, tick: int, frame: Frame) -> Command:
        acting = tick < self._until
        released = acting and self._reaction in ("release", "stop")
        slow = 0.1 if acting and self._reaction == "slow" else 1.0
        hands = {} if released else {arm: self._hand(arm, frame, slow) for arm in self._arms}
        return {
            "type": "input",
            "source": "script",
            "pedal": tick >= self._pedal_ms and not released,
            "arms": {arm: hand for arm, hand in hands.items() if hand},
        }

    def _hand(self, arm: ArmName, frame: Frame, slow: float) -> Command:
        # Moves the hand towards the point that the task asks for, as a person's page would.
        row = frame[f"{arm}/link_jpos"].tolist()
        tip = to_world(arm, closing_point(arm, frame[f"{arm}/tip"].tolist(), row))
        wish = self._task.wish(arm, tip)
        if wish is None:
            return {}
        way = view_from_world(np.subtract(wish.point, tip).tolist())
        gain = slow * self._gain
        opening = row[5] + row[6]
        # rad, well past the opening at which the pegs' jaws grip or release.
        aim = 0.6 if wish.closed else 1.4
        grasp = min(max((opening - aim) * GRASP_PER_RAD, -1.0), 1.0)
        return {
            "move": [gain * x for x in way],
            "grasp": grasp if abs(opening - aim) > 0.02 else 0.0,
        }

    def _restart(self, tick: int) -> list[Command]:
        """Stop the hands; restart a robot that does not follow once the operator has noticed."""
        if self._restart_at < 0:
            self._restart_at = tick + REST_MS
        aware = tick - (self._restart_at - REST_MS) >= SIGHT_DELAY_MS
        out: list[Command] = []
        if tick % INPUT_EVERY_MS == 0:
            out.append({"type": "input", "source": "script", "pedal": not aware, "arms": {}})
        if tick == self._restart_at:
            self._pedal_ms = tick + REST_MS // 2
            out.append({"type": "operator", "do": "restart"})
        return out


class Scripted:
    """Presents a scripted or recorded operator to the realtime loop as a console."""

    def __init__(self, script: str, session: Session) -> None:
        """script: one of `REACTIONS`, or a file of commands, which are repeated at their ticks."""
        self._session, self._follower = session, None
        self._recorded: collections.deque[tuple[int, Command]] = collections.deque()
        if script in REACTIONS:
            speeds = session.scenario.speeds
            self._follower = Follower(session.task, session.arms, speeds, script)
        else:
            self._recorded.extend(sorted(read_commands(script), key=lambda pair: pair[0]))

    def poll(self) -> list[Command]:
        """Return the commands to carry out before this tick."""
        session, commands = self._session, []
        if self._follower is not None:
            commands = self._follower.messages(session.ticks, session.frame)
        while self._recorded and self._recorded[0][0] <= session.ticks:
            commands.append(dict(self._recorded.popleft()[1]))
        if session.ticks == UNATTENDED_MS and session.started is None:
            commands.append({"type": "instructor", "do": "start"})
        return commands

    def tell(self, frame: Frame) -> None:
        """Do nothing: a script reads the frame in `poll`."""


class _Line(BaseModel):
    tick: Annotated[int, Field(ge=0, strict=True)]
    message: Command


def read_commands(path: str | Path) -> list[tuple[int, Command]]:
    """Return the tick and the command of each line. Raises UserError if a line is invalid."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {error}. Expected JSON lines") from None
    commands = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = _Line.model_validate_json(line)
            if entry.message.get("type") in ("input", "increments"):
                _HANDS.validate_python(entry.message)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"])) or "the line"
            raise UserError(
                f"{path}:{number}: {where}: {first['msg']}. Expected"
                ' {"tick": ms, "message": {..}}'
            ) from None
        commands.append((entry.tick, entry.message))
    return commands
