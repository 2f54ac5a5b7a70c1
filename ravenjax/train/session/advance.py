"""Computes one millisecond of a training session, from the operator's hands to the events.

A session depends only on its scenario, its seed and a list of (tick, command): no clock, file,
socket or thread. A headless run calls `tick`. The realtime loop calls its two halves: `move` before
the frame and the force are sent, `conclude` afterwards. Three robots run side by side with the same
tick as in campaigns: the driven robot, its golden run, and the virtual robot. While the driven
robot rests, the operator can try a motion on the virtual robot. The driven robot can then repeat
this motion while the pedal is held down.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.outcomes import verdict
from ravenjax.train import protocol, scenario, tasks
from ravenjax.train.judge import Judge, Trips
from ravenjax.train.protocol import Command, Event, Frame, Json, Point
from ravenjax.train.robot import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP, ArmName, tip_pose
from ravenjax.train.session import console_arbiter, hands
from ravenjax.train.session.simulation import Blueprint, EstopHold, SimulatedRobot, make_blueprint

SETTLED_MS = 500
"""Time in pedal-down after which a hazard may start, ms; the library's earliest start."""
GAP_MS = 3000
"""Least time between hazards, ms: the tip comes to rest, and the operator resumes the task."""
CLEARED_MS = 500
"""Time with the pedal up, ms, after which a hazard ends: the robot is at rest by then."""


class Director:
    """Decides when the hazards of one session are armed and disarmed."""

    hazard_number = -1
    """Number of the hazard that is armed, or that the instructor has ordered; -1: none."""
    _armed_tick: int | None = None  # when this hazard was armed; None: it is not armed
    _ordered_number = -1  # hazard that the instructor has ordered; -1: none
    _disarm_ordered = False  # whether the instructor has ordered to disarm
    _earliest_tick = 0  # no hazard starts before
    _ready_ms = 0  # time so far in which a hazard could start
    _pedal_up_ms = 0

    def __init__(self, hazards: Sequence[scenario.Armable], seed: int):
        self.hazards = tuple(hazards)
        # The 3 separates these draws from other draws with the same seed.
        rng = np.random.default_rng([seed, 3])
        self.plan = sorted(
            (float(rng.uniform(*hazard.when_ms)), hazard.number)
            for hazard in self.hazards
            if hazard.when_ms is not None
        )
        """(ms, number) of the planned hazards that are still to come, in order."""

    def command(self, message: Command) -> None:
        """Store the instructor's order "arm" or "disarm", which `step` carries out. "arm" has no
        effect while a hazard is armed, or if the number is not one of a hazard.
        """
        number = message.get("hazard")
        if message["do"] == "disarm":
            self._ordered_number, self._disarm_ordered = -1, True
        # `type` excludes True and False, which are instances of int.
        elif type(number) is int and 0 <= number < len(self.hazards) and self._armed_tick is None:
            self._ordered_number = number

    def step(self, tick: int, frame: Frame, clock: int) -> list[tuple[str, int]]:
        """Return the orders before this tick: [("arm" or "disarm", number of the hazard)], or []. A
        hazard ends on the instructor's order, after its time, or if the pedal stays up as a right
        response. The instructor's hazard goes first. frame: of the last tick. clock: session ms.
        """
        number, pedal = frame.number, frame.number("pedal")
        ready = (
            number("phase") == protocol.RUNNING
            and number("view") == protocol.REAL
            and pedal
            and number("console_alive")
            and number("runlevel") == PEDAL_DOWN
            and not number("soft_estopped")
        )
        self._ready_ms = self._ready_ms + 1 if ready else 0
        self._pedal_up_ms = 0 if pedal else self._pedal_up_ms + 1
        if self._armed_tick is not None:
            hazard = self.hazards[self.hazard_number]
            released = "release" in hazard.right_response and self._pedal_up_ms >= CLEARED_MS
            if self._disarm_ordered or released or tick - self._armed_tick >= hazard.lasts_ms:
                self.reset(tick)
                return [("disarm", hazard.number)]
            return []
        # No hazard is armed. The instructor's hazard comes next, or the planned hazard that is due.
        self._disarm_ordered = False
        self.hazard_number = self._ordered_number
        next_number = self._ordered_number
        if next_number < 0 and self.plan and self.plan[0][0] <= clock:
            next_number = self.plan[0][1]
        # The hazard waits until the robot has been driven for `SETTLED_MS`.
        if next_number < 0 or self._ready_ms < SETTLED_MS or tick < self._earliest_tick:
            return []
        if next_number == self._ordered_number:
            self._ordered_number = -1
        else:
            self.plan.pop(0)
        self.hazard_number, self._armed_tick = next_number, tick
        return [("arm", next_number)]

    def reset(self, tick: int) -> None:
        """Forget the armed hazard and the instructor's orders. Planned hazards stay planned."""
        self.hazard_number, self._armed_tick = -1, None
        self._ordered_number, self._disarm_ordered = -1, False
        self._ready_ms, self._earliest_tick = 0, tick + GAP_MS


_VALUE_KEYS = {"console": "alive", "pedal": "down"}
_DOUBLE_PRESS_COMMANDS = {
    protocol.REAL: "rehearse",
    protocol.VIRTUAL: "reengage",
    protocol.REPLAY: "discard",
}
"""By view: the command that two short presses of a network console's pedal give."""
MOST_COMMANDS = 1_000_000
"""The largest number of stored commands: hours of the page, or a quarter of an hour of ITP."""
OUTCOMES_EVERY = 10  # The smallest number of ticks between two readings of the robot's checks
STAND_BY_MS = 30_000
"""How long a robot waits for the first pedal-down, ms, before its motion table restarts.

See `Session._stand_by`. The motion table is as long as the session plus `simulation.SPARE_MS`.
"""


class Session:
    """One training session. Call `tick` until `over`."""

    phase, view = protocol.READY, protocol.REAL
    ticks = 0  # ms of the session, without pauses
    started: int | None = None  # tick at which the session's time began
    ended = ""  # why the session is over
    _resume_to = protocol.READY
    # Motion of the resting robot while the operator drives the virtual robot.
    _resting_row: np.ndarray | None = None
    _pedal, _alive = 0.0, False
    # The count of trips at the last reading of the robot's checks, and the tick of this reading.
    _trips_read, _reading_tick = 0.0, -OUTCOMES_EVERY
    _is_running = False  # whether the robots moved in this tick

    def __init__(
        self,
        chosen: scenario.Scenario,
        seed: int,
        *,
        cue: bool | None = None,
        ready: Blueprint | None = None,
        robot: Callable[[Blueprint], Any] = SimulatedRobot,
    ):
        """cue: whether the operator feels the force; None: as the scenario sets it. ready: a
        blueprint that was compiled for the same scenario and seed. robot: returns the driven robot,
        which has the methods of `SimulatedRobot`.
        """
        self.scenario, self.seed = chosen, seed
        self.blueprint = ready or make_blueprint(
            scenario.session_campaign(chosen, seed), limit_mm=chosen.harm.excursion_mm
        )
        self.layout = self.blueprint.layout
        self.arms = self.layout.arms
        self.hazards = scenario.armable_hazards(chosen, self.blueprint.plan.rows)
        self.robot = robot(self.blueprint)
        self.virtual = SimulatedRobot(self.blueprint)
        self.frame = Frame(self.layout)
        self.cue_on = chosen.cue.on if cue is None else cue
        # The E-stop button is a fault, in the last row of the fault table. No hazard uses this row.
        self._estop_fault_row = self.blueprint.plan.runs - 1
        self.task = tasks.make_task(chosen, self._tips(), seed)
        self.director = Director(self.hazards, seed)
        self.judge = Judge(chosen, self.hazards, self.cue_on, self._record)
        self.arbiter = console_arbiter.ConsoleArbiter(self._record)
        self.pedals = console_arbiter.PedalReasons()
        self._presses = console_arbiter.DoublePress()
        self._estop_hold = EstopHold()
        self.command_lines: list[str] = []
        """Lines of `scripts.read_commands`, at most MOST_COMMANDS."""
        self._hands = self._new_hands()
        # Trips of the virtual robot's checks in a trial, and their count at the last reading.
        self._trial_checks, self._trial_trips = Trips(), 0.0
        self._reported_state: Json = {}  # the values in the last events of `conclude`
        places = self.layout.places
        # Positions in a frame: hand, hand_quat and grasp of each arm, ordered as a motion table;
        # channels of the virtual robot, and the channels of a robot that are copied to them.
        self._hand_places = self._positions("hand", "hand_quat", "grasp")
        self._virtual_places = self._positions("virtual_jpos", "virtual_tip")
        self._link_and_tip_places = self._positions("link_jpos", "tip")
        self._session_places = slice(places["session_tick"].start, places["cue_on"].stop)
        self._trips_place = places["trips"].start
        self._events: list[Event] = []  # of this tick
        self._commands: list[Command] = []  # of this tick

    def _positions(self, *channels: str) -> np.ndarray:
        """Return the positions of these channels of each arm in a frame's row, arm after arm."""
        names = [f"{arm}/{channel}" for arm in self.arms for channel in channels]
        return np.r_[*(self.layout.places[name] for name in names)]

    @property
    def clock(self) -> int:
        """ms since the first pedal-down or the instructor's start; 0 before."""
        return 0 if self.started is None else self.ticks - self.started

    @property
    def left_ms(self) -> float:
        """ms until the session's time is up."""
        return self.scenario.duration_s * 1000 - self.clock

    @property
    def over(self) -> bool:
        return self.phase == protocol.OVER

    def tick(self, commands: list[Command]) -> list[Event]:
        """Compute one millisecond: fill `frame` and return the events."""
        self.move(commands)
        return self.conclude()

    def move(self, commands: list[Command]) -> None:
        """Compute the first half of the tick: commands, hands, hazards, robots. Fill `frame`. In a
        pause and after the end, the commands are read, but robots and hands do not move.
        """
        self._events, self._commands, self._is_running = [], [], False
        for command in commands:
            if not self.over:
                self._commands.append(command)
            self._command(command)
        if self.phase in (protocol.PAUSED, protocol.OVER):
            self._publish()
            return
        if self.arbiter.step(self.ticks):
            self._release_pedal("silent")
        hand = self._hands.advance(self.ticks)
        # The motion table of a robot that waits for too long would end. So it restarts.
        is_waiting = self.started is None and self.robot.next_tick >= STAND_BY_MS
        computes_robot = self._stand_by() if is_waiting else True
        self._drive(hand)
        for order, number in self.director.step(self.ticks, self.frame, self.clock):
            if order == "arm":
                self.robot.arm(number)
                self.judge.begin_hazard(number, self.ticks)
            else:
                self._read_checks()
                self.robot.disarm()
                self.judge.end_hazard()
        if computes_robot:
            self.robot.step()
        if self.view == protocol.VIRTUAL:
            self.virtual.step()
            self._record_trial()
        self._publish(hand)
        self._is_running = True

    def conclude(self) -> list[Event]:
        """Compute the second half of the tick, and return the events of the whole tick: one for
        each change of phase, view, console, pedal and run level, and those of task and judge.
        """
        if len(self.command_lines) < MOST_COMMANDS:
            self.command_lines += [
                protocol.encode({"tick": self.ticks, "message": command}) + "\n"
                for command in self._commands
            ]
        self.frame.copy_numbers()
        state: Json = {
            "phase": protocol.PHASES[self.phase],
            "view": protocol.VIEWS[self.view],
            "console": self._alive,
            "pedal": self._pedal != 0.0,
        }
        if self.robot.reports_arrive:
            state["runlevel"] = int(self.frame.number("runlevel"))
        for kind, value in state.items():
            if value != self._reported_state.get(kind):
                # The key of the new value is the kind, but "alive" for console, "down" for pedal.
                key = _VALUE_KEYS.get(kind, kind)
                self._record(kind, **{key: value})
        self._reported_state |= state
        if self._is_running:
            self._update()
        reasons = {console: self._refusal_reason(console) for console in console_arbiter.NETWORK}
        for event in self.pedals.update(reasons):
            self._record("refused", **event)
        if self._is_running:
            self.ticks += 1
        return self._events

    def _refusal_reason(self, console: str) -> str:
        """Return why a console's messages or its pedal do not count; "" if there is no reason."""
        if self.over:
            return ""
        reason = self.arbiter.refusal_reason(console, self.ticks)
        if self.arbiter.is_pedal_down(console):
            if self.phase in (protocol.PAUSED, protocol.STOPPED, protocol.LOST):
                return console_arbiter.REASONS[protocol.PHASES[self.phase]]
            if not reason and self.frame.number("runlevel") == INIT:
                return console_arbiter.REASONS["homing"]
        return reason

    def _command(self, command: Command):
        # Carries out a command: of the hands, of a console's seat, of operator or instructor.
        console = console_arbiter.console_of(command)
        match command.get("type"):
            case "input" | "increments":
                # Only the console that drives moves the hands.
                self.arbiter.receive(
                    command, lambda counted: self._hands.apply(counted, self.ticks), self.ticks
                )
                # A network console has no buttons. Two presses of its pedal replace a button.
                is_owner = console in console_arbiter.NETWORK and console == self.arbiter.owner
                if is_owner and self._presses.update(command["pedal"], self.ticks):
                    self._operator({"do": _DOUBLE_PRESS_COMMANDS[self.view]})
            # A console's server or process reports why it refuses the console's messages.
            case "unheard":
                why = str(command.get("why", ""))[:200]
                if command.get("once"):
                    self._record("refused", **self.pedals.report(console, why))
                else:
                    self.arbiter.set_refusal(console, why)
            case "seat":
                if self.arbiter.change_seat(command, self.ticks):
                    self._release_pedal("handover", by_operator=command.get("by") != "instructor")
            case "operator":
                self._operator(command)
            case "instructor":
                self._instructor(command)

    def _operator(self, command: Command):
        # Carries out a command of type "operator". If the operator gave it, it is a response, too.
        sender = command.get("by", "operator")
        if sender == "operator":
            self.judge.record_command(command, self.ticks)
        match command["do"]:
            case "estop":
                if sender != "operator":
                    self.judge.interrupt(self.ticks, f"estop by {sender}")
                self.robot.press_estop(self._estop_fault_row)
            case "restart" if self.phase != protocol.PAUSED:
                if self.phase == protocol.STOPPED or self.frame.number("runlevel") != PEDAL_DOWN:
                    self._restart("restart")
            case "rehearse" if self.view == protocol.REAL and self.phase == protocol.RUNNING:
                self._rehearse()
            case "reengage" if self.view == protocol.VIRTUAL:
                # The robot repeats the ticks with the pedal down, without the idle time.
                trial = np.r_[self._trial_start : self.virtual.next_tick]
                self._to_repeat = list(trial[self.virtual.motion[-1, trial] > 0])
                self.view = protocol.REPLAY if self._to_repeat else protocol.REAL
            case "discard" if self.view != protocol.REAL:
                # The hand continues at the pose of the driven robot, which has not moved.
                self._hands.move_to(self.robot.motion[:, self.robot.next_tick - 1])
                self.view = protocol.REAL
            case "note":
                self._record("note", text=str(command.get("text", ""))[:500])

    def _instructor(self, command: Command):
        # Carries out a command of type "instructor". Pause, reset and disarm interrupt a hazard.
        match command["do"]:
            case "arm":
                self.director.command(command)
            case "disarm":
                self.judge.interrupt(self.ticks, "instructor")
                self.director.command(command)
            case "start" if not self.over:
                self._start("instructor")
            case "pause" if self.phase not in (protocol.PAUSED, protocol.OVER):
                self.judge.interrupt(self.ticks, "instructor")
                self._resume_to, self.phase = self.phase, protocol.PAUSED
            case "resume" if self.phase == protocol.PAUSED:
                # The operator may have moved a hand or the foot during the pause.
                self._release_pedal("resume")
                self.phase = self._resume_to
            case "reset" if not self.over:
                self.judge.interrupt(self.ticks, "instructor")
                self._restart("reset")
            case "end":
                self._end("interrupted" if command.get("by") == "terminal" else "instructor")
            case "cue":
                self.cue_on = self.judge.cue_on = bool(command.get("on"))

    def _release_pedal(self, why: str, by_operator: bool = False):
        """Ignore a pedal that is down until the operator lifts it and presses it again. why: cause
        in the event. by_operator: the operator has handed the console over or left it.
        """
        self.arbiter.require_lifts(why)
        self._hands.apply({"type": "input", "pedal": False, "arms": {}}, self.ticks)
        if by_operator:
            self.judge.leave_console()
        else:
            self.judge.lift_pedal(self.ticks, why)

    def _start(self, cause: str):
        if self.started is None:
            self.started = self.ticks
            self._record("started", by=cause)

    def _drive(self, hand: hands.Hands):
        # Writes this tick's motion into the motion tables, [columns, ticks]. The last column is the
        # pedal. In a trial, the hand moves the virtual robot, and the driven robot rests.
        tick, motion = self.robot.next_tick, self.robot.motion
        row = motion[:, tick]
        if self.view == protocol.VIRTUAL:
            self.virtual.motion[:, self.virtual.next_tick] = hand.columns
            row[:] = self._resting_row
        elif self.view == protocol.REPLAY and hand.columns[-1]:
            # The driven robot repeats one row of the trial in each tick with the pedal down.
            row[:] = self.virtual.motion[:, self._to_repeat.pop(0)]
            if not self._to_repeat:
                self._hands.move_to(row)
                self.view = protocol.REAL
        elif self.view == protocol.REPLAY:
            # The robot waits, because the pedal is up.
            row[:] = motion[:, max(tick - 1, 0)]
            row[-1] = 0
        else:
            row[:] = hand.columns

    def _rehearse(self):
        """Begin a trial: the virtual robot follows the hand, and the driven robot rests. Do nothing
        if the driven robot is in another process, because its state cannot be copied.
        """
        tick = self.robot.next_tick
        if not isinstance(self.robot, SimulatedRobot) or tick == 0:
            return
        self.virtual.copy_from(self.robot)
        self._resting_row = self.robot.motion[:, tick - 1].copy()
        # The last column is the pedal, which is up.
        self._resting_row[-1] = 0
        self._trial_start = tick
        self._trial_checks = Trips()
        # Trips before the trial are counted now, so that they are not reported.
        self._trial_checks.new_trips(self.ticks, tick, self.virtual.outcomes())
        self._trial_trips = float(self.virtual.row[self._trips_place])
        self.judge.begin_trial(self.ticks)
        self.view = protocol.VIRTUAL

    def _record_trial(self):
        """Add an event for each new alarm or stop of the virtual robot's checks."""
        trips = float(self.virtual.row[self._trips_place])
        # Reading the checks takes as long as a tick, so it is not done in each tick.
        if trips == self._trial_trips or self.ticks % OUTCOMES_EVERY:
            return
        self._trial_trips = trips
        outcomes = self.virtual.outcomes()
        for trip in self._trial_checks.new_trips(self.ticks, self.virtual.next_tick, outcomes):
            if trip.check.response in verdict.TOLD and trip.is_after_pause:
                self._record("alarm", check=trip.check.name, count=trip.count, virtual=True)

    def _stand_by(self) -> bool:
        """Restart the motion table of a robot that nobody has driven yet. Return False, without a
        change, if a simulated robot is stopped (not in pedal-up): it then computes no ticks.
        """
        # A robot in another process keeps its state and its checks.
        if isinstance(self.robot, SimulatedRobot):
            if self.frame.number("runlevel") != PEDAL_UP:
                return False
            self.judge.restart()
        self.robot.stand_by()
        return True

    def _restart(self, why: str):
        # Homes the robot. Its hazard ends, and no pedal counts until it was lifted.
        self._read_checks()
        self.arbiter.require_lifts(why)
        self.robot.reset()
        self._hands = self._new_hands()
        self.director.reset(self.ticks)
        self.judge.restart()
        self.task.restart()
        self.phase, self.view = protocol.READY, protocol.REAL

    def _publish(self, hand: hands.Hands | None = None):
        """Fill the frame. Without `hand`, the channels of hands and robots keep their values."""
        row, task = self.frame.row, self.task
        if hand is not None:
            row[: self.robot.row.size] = self.robot.row
            self._estop_hold.apply(self.frame)
            row[self._hand_places] = hand.columns[:-1]
            # Outside a trial, the channels of the virtual robot show the driven robot.
            shown = self.virtual.row if self.view == protocol.VIRTUAL else self.robot.row
            row[self._virtual_places] = shown[self._link_and_tip_places]
            self._pedal, self._alive = float(hand.columns[-1]), hand.alive
        left_ms = 0 if self.over else self.left_ms
        # The channels session_tick to console_alive, then console and link, then hazard to cue_on.
        numbers = [self.ticks, left_ms, self.phase, self.view, self._pedal, self._alive]
        numbers += [protocol.CONSOLES.index(self.arbiter.owner), self.robot.reports_arrive]
        numbers += [self.director.hazard_number, task.target, task.progress, self.cue_on]
        row[self._session_places] = numbers

    def _update(self):
        # Updates task, judge and phase after the robot's tick.
        frame = self.frame
        # A distant robot may stop reporting; its state is then unknown.
        is_driven = self.phase in (protocol.READY, protocol.RUNNING, protocol.STOPPED)
        if is_driven and not self.robot.reports_arrive:
            self._release_pedal("link")
            self.phase = protocol.LOST
        elif self.robot.reports_arrive and self.phase == protocol.LOST:
            self.arbiter.require_lifts("link")
            self.phase = protocol.READY
        for event in self.task.step(frame, self.ticks):
            self._record(**event)
        # Reading the checks takes as long as a tick, so it is not done in each tick.
        is_due = self.ticks - self._reading_tick >= OUTCOMES_EVERY
        outcomes = self._new_outcomes() if is_due else None
        self.judge.step(self.ticks, frame, *(outcomes or ()))
        runlevel = frame.number("runlevel")
        is_stopped = runlevel == E_STOP or frame.number("soft_estopped")
        if self.phase == protocol.READY and runlevel == PEDAL_DOWN:
            self._start("pedal")
            self.phase = protocol.RUNNING
        elif self.phase in (protocol.READY, protocol.RUNNING) and is_stopped:
            self.phase = protocol.STOPPED
        # This tick is the session's last if at most 1 ms is left.
        if self.started is not None and self.left_ms <= 1:
            self._end("time")
        elif self.task.done:
            self._end("task")

    def _new_outcomes(self) -> tuple[Json, Json | None] | None:
        """Return the outcome columns of robot and golden run. None if no check has tripped since
        the last call. A robot without golden run has None there.
        """
        trips = float(self.robot.row[self._trips_place])
        if trips == self._trips_read:
            return None
        self._trips_read, self._reading_tick = trips, self.ticks
        return self.robot.outcomes(), self.robot.golden_outcomes()

    def _read_checks(self):
        """Let the judge read the trips before the robot or the golden run restarts."""
        if outcomes := self._new_outcomes():
            self.judge.read_checks(*outcomes)

    def _end(self, reason: str):
        if self.phase != protocol.OVER:
            self._read_checks()
            self.judge.close(self.ticks, reason)
            self.phase, self.ended = protocol.OVER, reason
            self._record("end", reason=reason)

    def _record(self, kind: str, **content):
        # Adds an event of this tick.
        self._events.append({"tick": self.ticks, "kind": kind, **content})

    def _new_hands(self) -> hands.Hands:
        return hands.Hands(self.arms, self.scenario.scale, self.scenario.speeds)

    def _tips(self) -> dict[ArmName, Point]:
        """Return where the jaws close at the beginning, m, in frame 0 of each arm."""
        tips: dict[ArmName, Point] = {}
        for arm, jpos in zip(self.arms, self.blueprint.plan.motion.start_jpos, strict=True):
            joints = [*map(float, jpos)]
            tips[arm] = protocol.closing_point(arm, tip_pose(arm, joints)[0].tolist(), joints)
        return tips
