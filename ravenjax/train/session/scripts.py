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
from ravenjax.train import protocol
from ravenjax.train.protocol import Command, Frame, Increments, Input
from ravenjax.train.robot import PEDAL_DOWN, ArmName, Arms
from ravenjax.train.scenario import Speeds
from ravenjax.train.session.advance import Session
from ravenjax.train.tasks import Task

INPUT_EVERY_MS = 16  # Interval between inputs, ms, as of a page at 60 Hz
FIRST_PEDAL_MS = 200  # Tick of the first pedal-down
TOUCH_DELAY_MS, SIGHT_DELAY_MS = 250, 400
"""Delays from a felt force, or a seen event, to the action; assumed as in `stages.reaction`."""
REST_MS = 1500  # How long the operator keeps the pedal up, or moves slowly, as a reaction, ms
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
    """A simulated operator who moves toward the task's goal and reacts to hazards. The speed is
    proportional to the distance. If the cue is on, the operator reacts to its onset. A force that
    persists after the pedal was up causes no second reaction. A stopped robot is restarted.
    """

    # Ticks: the pedal goes down, the reaction begins and ends, the robot is restarted. -1: none.
    _pedal_down_tick = FIRST_PEDAL_MS
    _reaction_start = _reaction_end = _restart_tick = -1
    _felt_force = False  # in the previous tick
    _unmoved_ms = 0  # time for which the robot has not moved with the pedal down

    def __init__(self, task: Task, arms: Arms, speeds: Speeds, reaction: str):
        """reaction: one of `REACTIONS`."""
        self._task, self._arms, self._reaction = task, arms, reaction
        self._gain = GAIN_PER_S * 1e3 / speeds.move_mm_s

    def messages(self, tick: int, frame: Frame) -> list[Command]:
        """Return the operator's commands before this tick. frame: of the previous tick. A stopped
        robot is restarted. The reaction begins `TOUCH_DELAY_MS` after a force begins.
        """
        pedal_down = frame.number("pedal")
        is_unmoved = pedal_down and frame.number("runlevel") != PEDAL_DOWN
        self._unmoved_ms = self._unmoved_ms + 1 if is_unmoved else 0
        is_stopped = frame.number("phase") == protocol.STOPPED
        if is_stopped or self._unmoved_ms > UNAVAILABLE_MS or tick <= self._restart_tick:
            self._reaction_start = -1
            return self._restart(tick)
        self._restart_tick = -1
        can_feel = bool(frame.number("cue_on") and frame.number("console_alive"))
        forces = [frame[f"{arm}/force"].tolist() for arm in self._arms]
        feels_force = can_feel and any(map(any, forces))
        is_onset, self._felt_force = feels_force and not self._felt_force, feels_force
        is_idle = self._reaction_start < 0 and tick > self._reaction_end
        if is_onset and is_idle and pedal_down and self._reaction != "none":
            self._reaction_start = tick + TOUCH_DELAY_MS
        if 0 <= self._reaction_start <= tick:
            self._reaction_start, self._reaction_end = -1, tick + REST_MS
            stop = [{"type": "operator", "do": "estop"}] if self._reaction == "stop" else []
            return [*stop, self._input(tick, frame)]
        return [] if tick % INPUT_EVERY_MS else [self._input(tick, frame)]

    def _input(self, tick: int, frame: Frame) -> Command:
        # Returns the message "input". A reaction lifts the pedal, or slows the hands down.
        is_reacting = tick < self._reaction_end
        lifts_pedal = is_reacting and self._reaction in ("release", "stop")
        speed_share = 0.1 if is_reacting and self._reaction == "slow" else 1.0
        arms = () if lifts_pedal else self._arms
        hands = {arm: hand for arm in arms if (hand := self._hand(arm, frame, speed_share))}
        pedal_down = tick >= self._pedal_down_tick and not lifts_pedal
        return {"type": "input", "source": "script", "pedal": pedal_down, "arms": hands}

    def _hand(self, arm: ArmName, frame: Frame, speed_share: float) -> Command:
        # Returns the hand's speeds toward the task's next aim, times `speed_share`; {} without aim.
        jpos, tip = frame[f"{arm}/link_jpos"].tolist(), protocol.tip_in_world(frame, arm)
        aim = self._task.next_aim(arm, tip)
        if aim is None:
            return {}
        to_aim = protocol.turn_vector(protocol.VIEW, np.subtract(aim.point, tip).tolist())
        gain = speed_share * self._gain
        opening = jpos[5] + jpos[6]
        # rad, well beyond the openings at which jaws hold and release: see `tasks.CLOSED_RAD`.
        next_opening = 0.6 if aim.jaws_closed else 1.4
        grasp = min(max((opening - next_opening) * GRASP_PER_RAD, -1.0), 1.0)
        # The jaws rest within 0.02 rad, so that they do not tremble.
        is_far = abs(opening - next_opening) > 0.02
        return {"move": [gain * x for x in to_aim], "grasp": grasp if is_far else 0.0}

    def _restart(self, tick: int) -> list[Command]:
        """Return the commands of an operator who restarts the robot after `REST_MS`. The pedal
        stays down for the time that a person needs to notice that the robot stopped.
        """
        if self._restart_tick < 0:
            self._restart_tick = tick + REST_MS
        # The robot stopped `REST_MS` before `_restart_tick`.
        has_noticed = tick - (self._restart_tick - REST_MS) >= SIGHT_DELAY_MS
        commands = []
        if tick % INPUT_EVERY_MS == 0:
            hands = {"type": "input", "source": "script", "pedal": not has_noticed, "arms": {}}
            commands.append(hands)
        if tick == self._restart_tick:
            self._pedal_down_tick = tick + REST_MS // 2
            commands.append({"type": "operator", "do": "restart"})
        return commands


class Scripted:
    """A console of the realtime loop whose commands come from a simulated operator."""

    def __init__(self, script: str, session: Session):
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
            # The key that is wrong, such as message.pedal.
            key = ".".join(map(str, first["loc"])) or "the line"
            raise UserError(
                f"{path}:{number}: {key}: {first['msg']}. Expected"
                ' {"tick": ms, "message": {..}}'
            ) from None
        commands.append((entry.tick, entry.message))
    return commands
