"""Computes one millisecond of a training session, from the operator's hands to the events.

A session depends only on its scenario, its seed and a list of (tick, command): no clock, file,
socket or thread. A headless run calls `tick`. The realtime loop calls its two halves: `move` before
the frame and the force are sent, `conclude` afterwards.

Three robots run side by side with the same tick as in campaigns: the driven robot, its golden run,
and the virtual robot. While the driven robot rests, the operator can try a motion on the virtual
robot. The driven robot can then repeat this motion while the pedal is held down.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.outcomes import verdict
from ravenjax.train import scenario, tasks
from ravenjax.train.judge import Judge, Trips
from ravenjax.train.protocol import (
    CONSOLES,
    LOST,
    OVER,
    PAUSED,
    PHASES,
    READY,
    REAL,
    REPLAY,
    RUNNING,
    STOPPED,
    VIEWS,
    VIRTUAL,
    Command,
    Event,
    Frame,
    Json,
    Point,
    closing_point,
    encode,
)
from ravenjax.train.robot import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP, ArmName, tip_pose
from ravenjax.train.session import hands
from ravenjax.train.session.console_arbiter import (
    NETWORK,
    REASONS,
    ConsoleArbiter,
    DoublePress,
    PedalReasons,
    console_of,
)
from ravenjax.train.session.simulation import Blueprint, EstopHold, SimulatedRobot, make_blueprint

SETTLED_MS = 500
"""Time in pedal-down after which a hazard may start, ms; the library's earliest start."""
GAP_MS = 3000
"""Least time between hazards, ms: the tip comes to rest, and the operator resumes the task."""
CLEARED_MS = 500
"""Time with the pedal up, ms, after which a hazard ends: the robot is at rest by then."""


class Director:
    """Decides when the hazards of one session are armed and disarmed."""

    at_work = -1
    """Number of the hazard that is armed or active; -1: none."""
    _pending = -1  # the instructor's next hazard
    _ordered = False  # whether the hazard `at_work` has been armed
    _since = 0  # tick at which it was armed
    _free_from = 0
    _down = 0  # ms of pedal-down so far
    _up = 0  # ms since the pedal came up
    _stop = False  # the instructor disarms the hazard

    def __init__(self, hazards: Sequence[scenario.Armable], seed: int) -> None:
        self.hazards = tuple(hazards)
        rng = np.random.default_rng([seed, 3])
        self.plan = sorted(
            (float(rng.uniform(*hazard.when_ms)), hazard.number)
            for hazard in self.hazards
            if hazard.when_ms is not None
        )
        """(ms, number) of the planned hazards that are still to come, in order."""

    def command(self, message: Command) -> None:
        """Store the instructor's "arm" or "disarm". Only one hazard can be armed at a time."""
        number = message.get("hazard")
        if message["do"] == "disarm":
            self._pending, self._stop = -1, True
        elif type(number) is int and 0 <= number < len(self.hazards) and not self._ordered:
            self._pending = number

    def step(self, tick: int, frame: Frame, clock: int) -> list[tuple[str, int]]:
        """Return the orders before this tick: [("arm" or "disarm", number of the hazard)], or [].

        frame: of the last tick. clock: the session's time, ms.
        """
        number, pedal = frame.number, frame.number("pedal")
        ready = (
            number("phase") == RUNNING
            and number("view") == REAL
            and pedal
            and number("console_alive")
            and number("runlevel") == PEDAL_DOWN
            and not number("soft_estopped")
        )
        self._down = self._down + 1 if ready else 0
        self._up = 0 if pedal else self._up + 1
        if self._ordered:
            hazard = self.hazards[self.at_work]
            cleared = self._up >= CLEARED_MS and "release" in hazard.right_response
            if self._stop or cleared or tick - self._since >= hazard.lasts_ms:
                self.reset(tick)
                return [("disarm", hazard.number)]
            return []
        self._stop = False
        choice = self.at_work = self._pending  # the instructor's hazard first
        if choice < 0 and self.plan and self.plan[0][0] <= clock:
            choice = self.plan[0][1]
        if choice < 0 or self._down < SETTLED_MS or tick < self._free_from:
            return []
        if choice == self._pending:
            self._pending = -1
        else:
            self.plan.pop(0)
        self.at_work, self._ordered, self._since = choice, True, tick
        return [("arm", choice)]

    def reset(self, tick: int) -> None:
        """Forget the armed hazard, because the robot was homed. Planned hazards stay planned."""
        self.at_work, self._ordered, self._pending, self._stop = -1, False, -1, False
        self._down, self._free_from = 0, tick + GAP_MS


_TOLD = {"console": "alive", "pedal": "down"}
"""Key of the new value in an event of this kind. For other kinds, the key is the kind itself."""
_OF_TWO_PRESSES = {REAL: "rehearse", VIRTUAL: "reengage", REPLAY: "discard"}
"""Command that two short presses of a network console's pedal give, by view."""
MOST_COMMANDS = 1_000_000
"""The largest number of stored commands: hours of the page, or a quarter of an hour of ITP."""
OUTCOMES_EVERY = 10
"""The smallest number of ticks between two readings of the robot's checks."""
STAND_BY_MS = 30_000
"""How long a robot waits for the first pedal-down, ms, before its motion table restarts.

See `Session._stand_by`. The motion table is as long as the session plus `simulation.SPARE_MS`.
"""


class Session:
    """One training session. Call `tick` until `over`."""

    phase, view = READY, REAL
    ticks = 0  # ms of the session, without pauses
    started: int | None = None  # tick at which the session's time began
    ended = ""  # why the session is over
    _resume_to = READY
    # Motion of the resting robot while the operator drives the virtual robot.
    _rest: np.ndarray | None = None
    # Ticks of the motion tried on the virtual robot that the robot has not repeated yet.
    _tried = (0, 0)
    _pedal, _alive = 0.0, False
    _seen_trips, _looked = 0.0, -OUTCOMES_EVERY
    _moved = False  # whether the robots moved in this tick

    def __init__(
        self,
        chosen: scenario.Scenario,
        seed: int,
        *,
        cue: bool | None = None,
        ready: Blueprint | None = None,
        robot: Callable[[Blueprint], Any] = SimulatedRobot,
    ) -> None:
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
        self.estop_row = self.blueprint.plan.runs - 1
        self.task = tasks.make_task(chosen, self._tips(), seed)
        self.director = Director(self.hazards, seed)
        self.judge = Judge(chosen, self.hazards, self.cue_on, self._record)
        self.arbiter = ConsoleArbiter(self._record)
        self.pedals = PedalReasons()
        self._presses = DoublePress()
        self._estop_hold = EstopHold(self.layout)
        self.command_lines: list[str] = []
        """Lines of `scripts.read_commands`, at most MOST_COMMANDS."""
        self._hands = self._new_hands()
        self._trial_checks, self._trial_trips = Trips(), 0.0
        self._told: Json = {}
        places = self.layout.places
        # Positions in a frame: hand, hand_quat and grasp of each arm, ordered as a motion table;
        # channels of the virtual robot, and the channels of a robot that are copied to them.
        self._hand_places = np.r_[
            *(slice(places[f"{arm}/hand"].start, places[f"{arm}/grasp"].stop) for arm in self.arms)
        ]
        self._virtual_places, self._shown_places = (
            np.r_[*(places[f"{arm}/{name}"] for arm in self.arms for name in names)]
            for names in (("virtual_jpos", "virtual_tip"), ("link_jpos", "tip"))
        )
        self._common = slice(places["session_tick"].start, places["cue_on"].stop)
        self._trips = places["trips"].start
        self._events: list[Event] = []
        self._new: list[Command] = []  # commands of this tick

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
        return self.phase == OVER

    def tick(self, commands: list[Command]) -> list[Event]:
        """Compute one millisecond: fill `frame` and return the events."""
        self.move(commands)
        return self.conclude()

    def move(self, commands: list[Command]) -> None:
        """Compute the first half of the tick: hands, hazards and robots. Fill `frame`."""
        self._events, self._moved, self._new = [], False, []
        for command in commands:
            if not self.over:
                self._new.append(command)
            self._command(command)
        if self.phase in (PAUSED, OVER):
            self._publish()
            return
        if self.arbiter.step(self.ticks):
            self._release_pedal("silent")
        hand = self._hands.advance(self.ticks)
        goes_on = self.started is not None or self.robot.now < STAND_BY_MS or self._stand_by()
        self._drive(hand)
        for order, number in self.director.step(self.ticks, self.frame, self.clock):
            if order == "arm":
                self.robot.arm(number)
                self.judge.begin_hazard(number, self.ticks)
            else:
                self._read_checks()
                self.robot.disarm()
                self.judge.end_hazard(self.ticks)
        if goes_on:
            self.robot.step()
        if self.view == VIRTUAL:
            self.virtual.step()
            self._record_trial()
        self._publish(hand)
        self._moved = True

    def conclude(self) -> list[Event]:
        """Compute the second half: task, judge and phase. Return the events of the whole tick."""
        if len(self.command_lines) < MOST_COMMANDS:
            self.command_lines += [
                encode({"tick": self.ticks, "message": command}) + "\n" for command in self._new
            ]
        self.frame.copy_numbers()
        state: Json = {
            "phase": PHASES[self.phase],
            "view": VIEWS[self.view],
            "console": self._alive,
            "pedal": self._pedal != 0.0,
        }
        if self.robot.heard:
            state["runlevel"] = int(self.frame.number("runlevel"))
        for kind, value in state.items():
            if value != self._told.get(kind):
                self._tell(kind, **{_TOLD.get(kind, kind): value})
        self._told |= state
        if self._moved:
            self._update()
        for event in self.pedals.update({console: self._why_not(console) for console in NETWORK}):
            self._tell("refused", **event)
        if self._moved:
            self.ticks += 1
        return self._events

    def _why_not(self, console: str) -> str:
        """Return why a pedal that a console holds down does not count; "" if it counts or is up."""
        if self.over:
            return ""
        why = self.arbiter.why_not(console, self.ticks)
        if not self.arbiter.is_pedal_down(console):
            return why
        if self.phase in (PAUSED, STOPPED, LOST):
            return REASONS[PHASES[self.phase]]
        return why or (REASONS["homing"] if self.frame.number("runlevel") == INIT else "")

    # --- commands ---

    def _command(self, command: Command) -> None:
        # Carries out a command: of the hands, of a console's seat, of operator or instructor.
        console = console_of(command)
        match command.get("type"):
            case "input" | "increments":
                self.arbiter.receive(
                    command, lambda counted: self._hands.apply(counted, self.ticks), self.ticks
                )
                is_owner = console in NETWORK and console == self.arbiter.owner
                if is_owner and self._presses.update(command["pedal"], self.ticks):
                    self._operator({"do": _OF_TWO_PRESSES[self.view]})
            case "unheard":
                why = str(command.get("why", ""))[:200]
                if command.get("once"):
                    self._tell("refused", **self.pedals.report(console, why))
                else:
                    self.arbiter.set_refusal(console, why)
            case "seat":
                if self.arbiter.change_seat(command, self.ticks):
                    self._release_pedal("handover", own=command.get("by") != "instructor")
            case "operator":
                self._operator(command)
            case "instructor":
                self._instructor(command)

    def _operator(self, command: Command) -> None:
        # Carries out a command of type "operator", which is also a response for the judge.
        by = command.get("by", "operator")
        if by == "operator":
            self.judge.record_command(command, self.ticks)
        match command["do"]:
            case "estop":
                if by != "operator":
                    self.judge.interrupt(self.ticks, f"estop by {by}")
                self.robot.press(self.estop_row)
            case "restart":
                if self.phase == STOPPED or self.frame.number("runlevel") != PEDAL_DOWN:
                    self._restart("restart")
            case "rehearse" if self.view == REAL and self.phase == RUNNING:
                self._rehearse()
            case "reengage" if self.view == VIRTUAL:
                # The driven robot repeats the motion that was tried.
                first, last = self._tried = self._tried[0], self.virtual.now
                self.view = REPLAY if last > first else REAL
            case "discard" if self.view != REAL:
                # The hand continues at the pose of the driven robot, which has not moved.
                self._hands.move_to(self.robot.motion[:, self.robot.now - 1])
                self.view = REAL
            case "note":
                self._tell("note", text=str(command.get("text", ""))[:500])

    def _instructor(self, command: Command) -> None:
        # Carries out a command of type "instructor". Pause, reset and disarm interrupt a hazard.
        match command["do"]:
            case "arm":
                self.director.command(command)
            case "disarm":
                self.judge.interrupt(self.ticks, "instructor")
                self.director.command(command)
            case "start" if not self.over:
                self._start("instructor")
            case "pause" if self.phase not in (PAUSED, OVER):
                self.judge.interrupt(self.ticks, "instructor")
                self._resume_to, self.phase = self.phase, PAUSED
            case "resume" if self.phase == PAUSED:
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

    def _release_pedal(self, why: str, own: bool = False) -> None:
        """Treat the pedal as up until the operator has lifted it.

        own: the operator caused this by handing the console over or by leaving.
        """
        self.arbiter.rearm(why, self.ticks)
        self._hands.apply({"type": "input", "pedal": False, "arms": {}}, self.ticks)
        if own:
            self.judge.leave_console()
        else:
            self.judge.lift_pedal(self.ticks, why)

    def _start(self, by: str) -> None:
        if self.started is None:
            self.started = self.ticks
            self._tell("started", by=by)

    # --- the three robots ---

    def _drive(self, hand: hands.Hands) -> None:
        # Writes this tick's motion into the motion table of the virtual or the driven robot.
        now, motion = self.robot.now, self.robot.motion
        row = motion[:, now]
        if self.view == VIRTUAL:
            self.virtual.motion[:, self.virtual.now] = hand.columns
            row[:] = self._rest
        elif self.view == REPLAY and hand.columns[-1]:
            first, last = self._tried
            row[:] = self.virtual.motion[:, first]
            self._tried = first + 1, last
            if first + 1 >= last:
                self._hands.move_to(row)
                self.view = REAL
        elif self.view == REPLAY:  # the robot waits, because the pedal is up
            row[:] = motion[:, max(now - 1, 0)]
            row[-1] = 0
        else:
            row[:] = hand.columns

    def _rehearse(self) -> None:
        """Begin a trial: the virtual robot follows the hand, and the driven robot rests."""
        now = self.robot.now
        if not isinstance(self.robot, SimulatedRobot) or now == 0:
            return
        self.virtual.copy_from(self.robot)
        self._rest = self.robot.motion[:, now - 1].copy()
        self._rest[-1] = 0
        self._tried = (now, now)
        self._trial_checks = Trips()
        # Do not report trips before the trial.
        self._trial_checks.new_trips(self.ticks, now, self.virtual.outcomes())
        self._trial_trips = float(self.virtual.row[self._trips])
        self.judge.begin_trial(self.ticks)
        self.view = VIRTUAL

    def _record_trial(self) -> None:
        """Record the alarms and stops of the virtual robot as events."""
        trips = float(self.virtual.row[self._trips])
        if trips == self._trial_trips or self.ticks % OUTCOMES_EVERY:
            return
        self._trial_trips, now = trips, self.virtual.now
        for trip in self._trial_checks.new_trips(self.ticks, now, self.virtual.outcomes()):
            if trip.check.response in verdict.TOLD and trip.announced:
                self._tell("alarm", check=trip.check.name, count=trip.count, virtual=True)

    def _stand_by(self) -> bool:
        """Restart the motion table of a robot that nobody has driven yet.

        Return whether the robot still computes ticks: a stopped simulated robot does not.
        """
        if isinstance(self.robot, SimulatedRobot):
            if self.frame.number("runlevel") != PEDAL_UP:
                return False
            self.judge.forget_trips()
        self.robot.stand_by()
        return True

    def _restart(self, why: str) -> None:
        # Homes the robot. Its hazard ends, and every pedal must be lifted.
        self._read_checks()
        self.arbiter.rearm(why, self.ticks)
        self.robot.reset()
        self._hands = self._new_hands()
        self.director.reset(self.ticks)
        self.judge.restart(self.ticks)
        self.task.restart()
        self.phase, self.view = READY, REAL

    # --- frames and events ---

    def _publish(self, hand: hands.Hands | None = None) -> None:
        """Fill the frame. Without `hand`, the channels of hands and robots keep their values."""
        row, task = self.frame.row, self.task
        if hand is not None:
            row[: self.robot.row.size] = self.robot.row
            self._estop_hold.apply(row)
            view_row = self.virtual.row if self.view == VIRTUAL else self.robot.row
            row[self._hand_places] = hand.columns[:-1]
            row[self._virtual_places] = view_row[self._shown_places]
            self._pedal, self._alive = float(hand.columns[-1]), hand.alive
        left_ms = 0 if self.over else self.left_ms
        row[self._common] = (
            *(self.ticks, left_ms, self.phase, self.view, self._pedal, self._alive),
            *(CONSOLES.index(self.arbiter.owner), self.robot.heard),
            *(self.director.at_work, task.target, task.progress, self.cue_on),
        )

    def _update(self) -> None:
        # Updates task, judge and phase after the robot's tick.
        frame = self.frame
        # A distant robot may stop reporting; its state is then unknown.
        if not self.robot.heard and self.phase in (READY, RUNNING, STOPPED):
            self._release_pedal("link")
            self.phase = LOST
        elif self.robot.heard and self.phase == LOST:
            self.arbiter.rearm("link", self.ticks)
            self.phase = READY
        self._events += self.task.step(frame, self.ticks)
        # Reading the checks takes as long as a tick, so it is not done in each tick.
        is_due = self.ticks - self._looked >= OUTCOMES_EVERY
        checked = self._checked() if is_due else ()
        self.judge.step(self.ticks, frame, *checked)
        runlevel = frame.number("runlevel")
        if self.phase == READY and runlevel == PEDAL_DOWN:
            self._start("pedal")
            self.phase = RUNNING
        elif self.phase in (READY, RUNNING) and (
            runlevel == E_STOP or frame.number("soft_estopped")
        ):
            self.phase = STOPPED
        if self.started is not None and self.left_ms <= 1:
            self._end("time")
        elif self.task.done:
            self._end("task")

    def _checked(self) -> tuple[()] | tuple[Json, Json | None]:
        """Return the outcomes of robot and golden run; () if no check has tripped since then."""
        trips = float(self.robot.row[self._trips])
        if trips == self._seen_trips:
            return ()
        self._seen_trips, self._looked = trips, self.ticks
        return self.robot.outcomes(), self.robot.golden_outcomes()

    def _read_checks(self) -> None:
        """Let the judge read the trips before the robot or the golden run restarts."""
        if checked := self._checked():
            self.judge.read_checks(*checked)

    def _end(self, reason: str) -> None:
        if self.phase != OVER:
            self._read_checks()
            self.judge.close(self.ticks, reason)
            self.phase, self.ended = OVER, reason
            self._tell("end", reason=reason)

    def _tell(self, kind: str, **what: Any) -> None:
        self._record(self.ticks, kind, **what)

    def _record(self, tick: int, kind: str, **what: Any) -> None:
        self._events.append({"tick": tick, "kind": kind, **what})

    def _new_hands(self) -> hands.Hands:
        return hands.Hands(self.arms, self.scenario.scale, self.scenario.speeds)

    def _tips(self) -> dict[ArmName, Point]:
        """Return where the jaws close at the beginning, m, in frame 0 of each arm."""
        tips: dict[ArmName, Point] = {}
        for arm, jpos in zip(self.arms, self.blueprint.plan.motion.start_jpos, strict=True):
            joints = [float(joint) for joint in jpos]
            tips[arm] = closing_point(arm, tip_pose(arm, joints)[0].tolist(), joints)
        return tips
