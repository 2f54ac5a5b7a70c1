"""Defines two simulated operators: one does the task and reacts to cues, the other repeats commands
of a file. Both are deterministic, so a session can be repeated exactly.
"""

import collections
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from ravenjax.errors import UserError
from ravenjax.train.protocol import (
    STOPPED,
    VIEW,
    Command,
    Frame,
    Increments,
    Input,
    closing_point,
    to_world,
    turn_vector,
)
from ravenjax.train.robot import PEDAL_DOWN, ArmName, Arms
from ravenjax.train.scenario import Speeds
from ravenjax.train.session.advance import Session
from ravenjax.train.tasks import Task

INPUT_EVERY_MS = 16
"""Interval between inputs, ms, as of a page at 60 Hz."""
FIRST_PEDAL_MS = 200
"""Tick of the first pedal-down."""
TOUCH_DELAY_MS, SIGHT_DELAY_MS = 250, 400
"""Delays from a felt force, or a seen event, to the action; assumed as in `stages.reaction`."""
REST_MS = 1500
"""How long the operator keeps the pedal up, or moves slowly, as a reaction, ms."""
UNAVAILABLE_MS = 1000
"""The operator restarts a robot that has not moved for this time, ms, with the pedal down."""
# Speed of the hand per distance from the goal, and speed of the jaws (share of full) per angle.
GAIN_PER_S, GRASP_PER_RAD = 4.0, 4.0
UNATTENDED_MS = 60_000
"""Tick at which the session's time begins although the script has not pressed the pedal."""
REACTIONS = ("none", "release", "slow", "stop")
_HANDS: TypeAdapter[Input | Increments] = TypeAdapter(
    Annotated[Input | Increments, Field(discriminator="type")]
)


class Follower:
    """A simulated operator who moves toward the task's goal and reacts to hazards.

    The speed is proportional to the distance. If the cue is on, the operator reacts to its onset.
    A force that persists after the pedal was up causes no second reaction. The operator sees that
    the robot is stopped, and restarts it.
    """

    _pedal_ms = FIRST_PEDAL_MS  # the pedal is down from this tick on
    _act_at = -1  # tick of the next action; -1: none
    _until = -1  # the action lasts until this tick
    _restart_at = -1
    _felt = False
    _waited = 0  # ms for which the robot has not moved with the pedal down

    def __init__(self, task: Task, arms: Arms, speeds: Speeds, reaction: str = "release") -> None:
        """reaction: one of `REACTIONS`."""
        self._task, self._arms, self._reaction = task, arms, reaction
        self._gain = GAIN_PER_S * 1e3 / speeds.move_mm_s  # share of full speed per m

    def messages(self, tick: int, frame: Frame) -> list[Command]:
        """Return the commands before this tick. frame: of the previous tick."""
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
        # Returns speeds of the hand toward the point that the task requests next.
        row = frame[f"{arm}/link_jpos"].tolist()
        tip = to_world(arm, closing_point(arm, frame[f"{arm}/tip"].tolist(), row))
        wish = self._task.wish(arm, tip)
        if wish is None:
            return {}
        way = turn_vector(VIEW, np.subtract(wish.point, tip).tolist())
        gain = slow * self._gain
        opening = row[5] + row[6]
        # rad, well beyond the openings at which jaws hold and release: see `tasks.CLOSED_RAD`.
        aim = 0.6 if wish.closed else 1.4
        grasp = min(max((opening - aim) * GRASP_PER_RAD, -1.0), 1.0)
        return {
            "move": [gain * x for x in way],
            "grasp": grasp if abs(opening - aim) > 0.02 else 0.0,
        }

    def _restart(self, tick: int) -> list[Command]:
        """Stop the hands, and restart the robot after the time that a person needs to notice."""
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
    """A console of the realtime loop whose commands come from a simulated operator."""

    def __init__(self, script: str, session: Session) -> None:
        """script: one of `REACTIONS`, or a file of commands, which are repeated at their ticks."""
        self._session = session
        self._messages: Callable[[int, Frame], list[Command]] = lambda *_: []
        self._recorded: collections.deque[tuple[int, Command]] = collections.deque()
        if script in REACTIONS:
            speeds = session.scenario.speeds
            self._messages = Follower(session.task, session.arms, speeds, script).messages
        else:
            self._recorded.extend(sorted(read_commands(script), key=lambda pair: pair[0]))

    def poll(self) -> list[Command]:
        """Return the commands before this tick."""
        session = self._session
        commands = self._messages(session.ticks, session.frame)
        while self._recorded and self._recorded[0][0] <= session.ticks:
            commands.append(dict(self._recorded.popleft()[1]))
        if session.ticks == UNATTENDED_MS and session.started is None:
            commands.append({"type": "instructor", "do": "start"})
        return commands

    def send_frame(self, frame: Frame) -> None:
        """Do nothing, because `poll` reads the session's frame."""


class _Line(BaseModel):
    tick: Annotated[int, Field(ge=0, strict=True)]
    message: Command


def read_commands(path: str | Path) -> list[tuple[int, Command]]:
    """Return (tick, command) of each line of a file. Raises UserError if a line is invalid."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(
            f"{path}: cannot be read: {error}. Expected a file of JSON lines, as commands.jsonl"
        ) from None
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
