"""Judges a session tick by tick: the effect of each hazard, the response, the score.

docs/outcomes.md defines the outcomes. Effects are differences from the golden run, which starts
from the robot's state when the hazard is armed. From the activation on, the columns `unintended_mm`
to `false_report_first_ms` have the same meaning as in a campaign's result table.

At `knowable_ms` a person at the console can first notice the hazard: the tip is `SEEN_MM` off its
course, the robot has left pedal-down although the pedal is held, or a check has raised an alarm.
Reaction times start at the *origin*: the start of the cue or `knowable_ms`, whichever is earlier.
Nobody can prevent harm within `ACTS_MS` after the origin.

The judge scores the first right response within the time allowed. If there is none, it scores the
first other response. It ignores a slow-down that the scenario does not list as right, because hands
also slow down near a target. A hazard is decided when harm is done, when the operator gives a right
response, or when the time is up. A pause, a reset or a broken connection before that interrupts it.

The score has two parts of up to 50 points. A right response gives all 50 points up to `FASTEST_MS`,
and half of them at the end of the time allowed. The other part measures the patient's safety: of
the distance to harm at the moment when a person could first act, the share that remains at the end.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import pydantic
from pydantic import BeforeValidator

from ravenjax.bundled import resources
from ravenjax.outcomes import verdict
from ravenjax.train.protocol import Command, Frame, Json
from ravenjax.train.robot import ROBOT
from ravenjax.train.scenario import Armable, Harm, Scenario
from ravenjax.vocabulary import checks

Text = Annotated[str, BeforeValidator(lambda value: "" if value is None else str(value))]
Flag = Annotated[bool, BeforeValidator(lambda value: value or False)]
_NAMES: dict[str, Any] = resources.read_tables(__file__, "judge.toml")
"""Names of columns, of channels of a frame and of events."""
AFFECTED_MM = 1.0
"""A distance that counts as an effect: the jump as expert surgeons defined it (DSN'16, text)."""
SEEN_MM = AFFECTED_MM
"""A distance that a person at the console can see while the tip moves: the surgeons' jump.

This is an assumption. An eye at 0.6 m resolves 0.2 mm on the screen, but cannot see the golden run.
"""
ACTS_MS = 150.0
"""The shortest reaction time of a person, ms: reactions to a touch take 150 to 300 ms."""
FASTEST_MS = 250.0
"""Reactions up to this time, ms, lose no points; `stages.reaction` assumes the same value."""
CONTINUE = "continue"
MOMENTS = ("knowable", "cue", "alarm", "response")
"""Moments of a hazard after its activation, each with a column `<name>_ms`."""
DISTANCES = ("unintended", "loss", "false_report")
"""Distances of a frame (channels `<name>_mm`) that are a motion hazard above the limit."""
PEAKS = (*DISTANCES, "unintended_off")
"""Distances whose largest value an `Episode` stores."""


def _number_or_none(value: Any) -> float | None:
    try:
        number = math.nan if value in (None, "") else float(value)
    except ValueError:
        raise ValueError("expected a number or nothing") from None
    return number if math.isfinite(number) else None


Number = Annotated[float | None, BeforeValidator(_number_or_none)]


@pydantic.dataclasses.dataclass(frozen=True, kw_only=True)
class HazardRow:
    """One row of hazards.csv. Strings from a file are converted.

    Times are ms since the session began, None if the event never happened. Distances are None if
    they were not measured.
    """

    session: Text
    participant: Text
    group: Text
    scenario: Text
    seed: Text
    cue: Text  # on, off
    blinded: Flag
    number: int
    hazard: Text  # id in the library
    title: Text
    arm: Text
    armed_ms: Number
    struck_ms: Number
    knowable_ms: Number
    knowable_by: Text
    cue_ms: Number
    # First check that alerted a person or stopped the robot.
    alarm_ms: Number
    alarm: Text
    # First check that changed a command or dropped a packet without alerting anybody.
    limited_ms: Number
    limited: Text
    check_response: Text  # one of outcomes.verdict.RESPONSES; "" if never active
    check_cause: Text  # first check with that response
    motion_hazard: Text  # one of outcomes.verdict.HAZARDS
    limit_mm: Number  # the scenario's limit of hazards and harm
    unintended_mm: Number
    unintended_first_ms: Number
    unintended_off_mm: Number
    loss_mm: Number
    loss_first_ms: Number
    halted_ms: Number
    golden_halted_ms: Number
    false_report_mm: Number
    false_report_first_ms: Number
    # Distance of the reported tip from the model, which drives the cue.
    peak_error_mm: Number
    deepest_mm: Number
    response: Text  # the operator's
    response_ms: Number
    reaction_ms: Number
    right_response: Text
    response_ok: Flag
    halted: Flag  # the robot left pedal-down on its own
    outcome: Text
    score: Number

    @property
    def after(self) -> dict[str, float]:
        """Times of the events that happened, in ms after the activation."""
        if self.struck_ms is None:
            return {}
        times = {name: getattr(self, f"{name}_ms") for name in MOMENTS}
        return {name: time - self.struck_ms for name, time in times.items() if time is not None}

    @property
    def farthest_mm(self) -> float | None:
        """Largest unintended motion of the true tip, whether the robot was live or not."""
        distances = (self.unintended_mm, self.unintended_off_mm)
        return max((mm for mm in distances if mm is not None), default=None)


COLUMNS = tuple(field.name for field in dataclasses.fields(HazardRow))
"""Columns of hazards.csv, in order."""


class Episode:
    """One hazard from arming to disarming."""

    struck_ms: int | None = None
    knowable_ms: int | None = None
    knowable_by = ""
    cue_ms: int | None = None
    # Time of the first sign, cue or alarm, whichever is earliest.
    origin_ms: int | None = None
    halted = False
    halted_ms, golden_halted_ms = 0, 0
    peak_error_mm = 0.0
    deepest_mm = -math.inf
    _is_lost = False
    interrupted = False

    def __init__(
        self, hazard: Armable, harm: Harm, tick: int, cue_on: bool, record: Callable[..., None]
    ) -> None:
        self.hazard, self.harm = hazard, harm
        self.record = functools.partial(record, number=hazard.number)
        self.cue_on = cue_on
        self.armed_ms = tick
        # ms and name of the first check of each kind of response
        self.checks: dict[str, tuple[int, str]] = {}
        # The arm on which the fault acts. If the fault acts on no arm: the one that moved farthest.
        self.arm = hazard.arm
        # -1: not measured
        self.peak_mm: dict[str, float] = dict.fromkeys(PEAKS, -1.0)
        # When one of `DISTANCES` first exceeded the limit.
        self.first_ms: dict[str, int] = {}
        # Each has two values: unintended motion and depth. `_done_mm` is what the fault caused,
        # `_spared_mm` is the part of it before a person could have acted.
        self._done_mm, self._spared_mm = [0.0, 0.0], [0.0, 0.0]
        self._limits_mm = harm.excursion_mm, harm.depth_mm
        # ms of the first response of each kind.
        self.responses: dict[str, int] = {}

    @property
    def struck(self) -> bool:
        return self.struck_ms is not None

    @property
    def check_response(self) -> str:
        """The response of the robot's checks, one of `verdict.RESPONSES`."""
        return next((word for word in verdict.RESPONSES if word in self.checks), "silent")

    def record_knowable(self, tick: int, by: str, at: int | None = None) -> None:
        """Record the first sign of the hazard, at `at` or this tick, if there was none before."""
        if self.knowable_ms is None:
            self.knowable_ms, self.knowable_by = tick if at is None else at, by
            self._originate(self.knowable_ms)
            self.record(tick, "knowable", by=by, ms=self.knowable_ms)

    def record_cue(self, tick: int) -> None:
        """Record that the operator felt the cue."""
        self.cue_ms = tick
        self._originate(tick)

    def record_trip(self, tick: int, check: checks.Check) -> bool:
        """Record a check that the golden run did not trip. Return whether its response is new."""
        if check.response in self.checks:
            return False
        self.checks[check.response] = tick, check.name
        if check.response in verdict.TOLD:
            self._originate(tick)
        return True

    def record_peak(self, tick: int, name: str, mm: float, arm: str) -> None:
        """Record a new largest value of one of `PEAKS`. Report the first value above the limit."""
        self.peak_mm[name] = mm
        if name.startswith("unintended") and mm > self._done_mm[0] and not self.hazard.arm:
            self.arm = arm
        self.record_effect(tick, 0, max(self.peak_mm["unintended"], self.peak_mm["unintended_off"]))
        if name in DISTANCES and mm > self.harm.excursion_mm and name not in self.first_ms:
            self.first_ms[name] = tick
            self.record(tick, _NAMES["events"][name], arm=arm, mm=round(mm, 3))

    def record_halt(self, tick: int, halted_ms: int, golden_halted_ms: int) -> None:
        """Record for how long a held pedal moved neither robot. Report a new loss of motion."""
        was_lost = self._is_lost
        self.halted_ms, self.golden_halted_ms = halted_ms, golden_halted_ms
        stopped = self.check_response == "stopped"
        self._is_lost = bool(verdict.is_halt(halted_ms, golden_halted_ms, stopped))
        if self._is_lost and not was_lost and "loss" not in self.first_ms:
            self.record(tick, _NAMES["events"]["loss"], halted_ms=halted_ms - golden_halted_ms)

    def record_response(self, tick: int, what: str, at: int | None) -> None:
        """Record a response, if it is the first of its kind after the origin.
        at: when the response began, if that was before this tick.
        """
        began = tick if at is None else at
        known = self.origin_ms is not None and began >= self.origin_ms
        is_excluded = self.interrupted or (self.halted and what in _OF_MOTION)
        if is_excluded or not known or what in self.responses:
            return
        was_answered = self.answer()[0] in self.responses
        self.responses[what] = began
        counts = not was_answered or self.answer()[0] == what
        if counts and (what != "slow" or what in self.hazard.right_response):
            ms, is_right = self.reaction_ms(what), self.is_right(what)
            self.record(tick, "response", what=what, ok=is_right, ms=ms)

    def is_decided(self, tick: int) -> bool:
        """Whether the outcome is final: after harm, a right response, or the time allowed."""
        if self._exceeds(self._done_mm) and not self._exceeds(self._spared_mm):
            return True
        is_late = self.origin_ms is not None and tick - self.origin_ms > self._within_ms
        if CONTINUE in self.hazard.right_response:
            return is_late or any(what != "slow" for what in self.responses)
        return is_late or self.answer()[1]

    def is_right(self, what: str) -> bool:
        """Whether this response, which the operator gave, is right and in time."""
        return what in self.hazard.right_response and self.reaction_ms(what) <= self._within_ms

    def reaction_ms(self, what: str) -> int:
        """Return the time from the origin to a response that was given."""
        return self.responses[what] - (self.origin_ms or 0)

    def answer(self) -> tuple[str, bool]:
        """Return the response that counts ("" if none) and whether it is right and in time."""
        in_order = sorted(self.responses, key=self.responses.__getitem__)
        first = next((what for what in in_order if what != "slow"), "")
        if CONTINUE in self.hazard.right_response:
            return (first, False) if first else (CONTINUE, self.struck and not self.halted)
        right = next((what for what in in_order if self.is_right(what)), "")
        return (right, True) if right else (first, False)

    def motion_hazard(self) -> str:
        """Return the motion hazard, one of `verdict.HAZARDS`."""
        columns = {f"{name}_first_ms": [self.first_ms.get(name, -1)] for name in DISTANCES}
        columns |= {"halted_ms": [self.halted_ms], "golden_halted_ms": [self.golden_halted_ms]}
        (place,) = verdict.classify_hazards(columns, np.array([self.check_response == "stopped"]))
        return verdict.HAZARDS[place]

    def outcome(self) -> str:
        """Return one of interrupted, unavoidable, harm, avoided, halted, unaffected, missed."""
        if self.interrupted:
            return "interrupted"
        if self._exceeds(self._spared_mm):
            return "unavoidable"
        if self._exceeds(self._done_mm):
            return "harm"
        if self.answer()[1]:
            return "avoided"
        if self.halted:
            return "halted"
        is_small = max(self.peak_mm.values()) < AFFECTED_MM
        if is_small and self.cue_ms is None and self.motion_hazard() == "none":
            return "unaffected"
        return "missed"

    def score(self) -> float | None:
        """Return the score, 0 to 100, or None if the hazard is unaffected or interrupted."""
        if self.outcome() in ("unaffected", "interrupted"):
            return None
        what, ok = self.answer()
        response = 0.0
        if ok:
            longest = max(self._within_ms - FASTEST_MS, 1.0)
            late = 0.0 if what == CONTINUE else max(self.reaction_ms(what) - FASTEST_MS, 0.0)
            response = 1.0 - 0.5 * min(late / longest, 1.0)
        # Of the distance to a limit when a person could first act, the share that the fault used up
        # afterwards. If the limit was exceeded before: the share of the whole distance.
        done, spared, limit = map(np.array, (self._done_mm, self._spared_mm, self._limits_mm))
        used = float(np.max((done - spared) / (limit - np.where(spared < limit, spared, 0.0))))
        return round(50.0 * response + 50.0 * max(0.0, 1.0 - used), 1)

    def row(self) -> Json:
        """Return the columns of hazards.csv that are known now."""
        what, ok = self.answer()
        answered = what in self.responses
        # Of two alarms at the same time, the stronger comes first.
        alarms = [self.checks[word] for word in verdict.TOLD if word in self.checks]
        alarm_ms, alarm = min(alarms, key=lambda alarm: alarm[0], default=(None, None))
        limited_ms, limited = self.checks.get("limited", (None, None))
        row = {name: getattr(self.hazard, name) for name in _NAMES["of_hazard"]}
        row |= {name: getattr(self, name) for name in _NAMES["of_episode"]} | {
            "cue": "on" if self.cue_on else "off",
            "knowable_by": self.knowable_by or None,
            "alarm_ms": alarm_ms,
            "alarm": alarm,
            "limited_ms": limited_ms,
            "limited": limited,
            "limit_mm": self.harm.excursion_mm,
            "response": what or None,
            "response_ms": self.responses[what] if answered else None,
            "reaction_ms": self.reaction_ms(what) if answered else None,
            "right_response": " ".join(self.hazard.right_response),
            "response_ok": ok,
            "outcome": self.outcome(),
            "score": self.score(),
        }
        if not self.struck:
            return row
        peaks = self.peak_mm.items()
        return row | {
            "check_response": self.check_response,
            "check_cause": self.checks.get(self.check_response, (None, None))[1],
            "motion_hazard": self.motion_hazard(),
            **{f"{name}_mm": round(mm, 4) if mm >= 0.0 else None for name, mm in peaks},
            **{f"{name}_first_ms": self.first_ms.get(name) for name in DISTANCES},
            "halted_ms": self.halted_ms,
            "golden_halted_ms": self.golden_halted_ms,
            "peak_error_mm": round(self.peak_error_mm, 4),
            "deepest_mm": round(self.deepest_mm, 4) if math.isfinite(self.deepest_mm) else None,
        }

    @property
    def _within_ms(self) -> float:
        return self.hazard.within_s * 1000.0

    def _exceeds(self, amounts_mm: list[float]) -> bool:
        return bool(np.greater(amounts_mm, self._limits_mm).any())

    def record_effect(self, tick: int, kind: int, mm: float) -> None:
        """Record the unintended motion (kind 0) or the depth (1) that the fault has caused."""
        self._done_mm[kind] = max(self._done_mm[kind], mm)
        if self.origin_ms is None or tick < self.origin_ms + ACTS_MS:
            self._spared_mm[kind] = self._done_mm[kind]

    def _originate(self, tick: int) -> None:
        if self.origin_ms is None or tick < self.origin_ms:
            self.origin_ms = tick


SLOW_SHARE = 0.25
"""Hands are slow below this share of their usual speed, as in `stages.reaction`."""
SLOW_FOR_MS = 1000
"""A slow-down counts only if it lasts this long, ms."""
MOVING_MM_S = 2.0
"""Hands slower than this cannot slow down. Speed of the tip, mm/s."""
# Rates of the running means of the usual and the present speed, 1/ms.
_USUAL, _PRESENT = 1.0 / 2000.0, 1.0 / 50.0
# Values of `_since` in place of a tick: the hands are not slow, or were slow before the hazard.
_QUICK, _SLOW_AT_STRIKE = -1, -2
QUIET_MS = 1000
"""A check that trips again is announced only after this time without a trip, ms."""
CUE_QUIET_MS = 250
"""Time without force after which a new force counts as a new cue, ms."""
COUNT_EVERY_MS = 1000
"""The shortest time between two events "alarm_count" of one check, ms."""
_OF_MOTION = ("release", "slow")
"""Responses to a robot that moves. They do not count once the robot has halted on its own."""
SEEN = ("known", "unintended", "unintended_off", "loss")
"""Distances of a frame that a person may see at the console."""


class Trip(NamedTuple):
    """One or more trips of a check since the last reading of the counters."""

    check: checks.Check
    # ms of the session: exact for a check's first trip, otherwise the time of the reading.
    ms: int
    # Whether the check has tripped more often than in the golden run.
    beyond_golden: bool
    announced: bool  # the first after `QUIET_MS` without a trip
    count: int  # trips in the session so far


class Trips:
    """Counts the trips of each check. Call `new_trips` every few milliseconds."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._earlier: Counter[str] = Counter()  # trips before the robot's last restart
        self._last: dict[str, int] = {}  # tick of each check's last trip

    def new_trips(
        self, tick: int, robot_tick: int, outcomes: Json, golden: Json | None = None
    ) -> list[Trip]:
        """Return each check that tripped since the last reading, the earliest first.

        tick, robot_tick: ms of session and robot. outcomes, golden: `check_*` columns of robot and
        golden run so far. Without a golden run every trip counts.
        """
        trips = []
        for name in checks.check_names(outcomes):
            count, before = int(outcomes[f"check_{name}_count"]), self._counts[name]
            self._counts[name] = count
            if count <= before:
                continue
            ms = tick
            if before == 0 and (first := int(outcomes.get(f"check_{name}_first_ms", -1))) >= 0:
                ms = tick - (robot_tick - first)
            usual = 0 if golden is None else int(golden[f"check_{name}_count"])
            announced = ms - self._last.get(name, -math.inf) > QUIET_MS
            total = self._earlier[name] + count
            trips.append(Trip(ROBOT.check(name), ms, count > usual, announced, total))
            self._last[name] = tick
        return sorted(trips, key=lambda trip: trip.ms)

    def reset(self) -> None:
        self._earlier += self._counts
        self._counts = Counter()


@dataclasses.dataclass
class SlowdownDetector:
    """Detects that the operator slows down, from running means of the speed of both hands.

    Hands also slow down at each target, so a slow-down counts only if it lasts longer than a tip is
    held at a target. Speeds are those of the tip, mm/s.
    """

    scale: float
    _before: list[float] | None = None
    usual = present = 0.0
    # mm/s; the hands are slow below this limit.
    _limit = 0.0
    # The tick since which the hands are slow.
    _since = _QUICK
    slowed = -1
    """Tick at which a lasting slow-down began; -1 without one."""

    def step(self, tick: int, hands: list[float]) -> None:
        """Read the hands' positions in this tick: um before scaling, three numbers per hand."""
        before, self._before = self._before, hands
        if before is None:
            return
        # um/ms is mm/s
        speed = self.scale * math.dist(hands, before)
        self.usual += _USUAL * (speed - self.usual)
        self.present += _PRESENT * (speed - self.present)
        if self.present >= self._limit:
            self._since, self.slowed = _QUICK, -1
        elif self._since == _QUICK:
            self._since = tick
        elif self._since >= 0 and tick - self._since >= SLOW_FOR_MS:
            self.slowed = self._since

    def start_hazard(self) -> None:
        """Compare later speeds with the usual speed before the hazard that becomes active now."""
        self._limit = SLOW_SHARE * self.usual if self.usual > MOVING_MM_S else 0.0
        self._since = _SLOW_AT_STRIKE if self.present < self._limit else _QUICK
        self.slowed = -1

    def skip_step(self) -> None:
        """Ignore the next step of the hands, because a restart moved them elsewhere."""
        self._before = None


class Judge:
    """Judges one session. The operator can respond in these ways:

    - `release`: the pedal goes up, also because the operator hands the console over, leaves, or
      tries a motion on the virtual robot.
    - `slow`: for a second, the hands move at less than a quarter of their usual speed.
    - `restart`: the operator restarts a robot that does not follow.
    - `stop`: the operator presses the E-stop button.
    - `convert`: the operator sends a note that contains "convert"; the page's button does so.
    """

    _episode: Episode | None = None
    _arms: tuple[_Arm, ...] = ()
    _pedal = False
    # Whether the robot moved when the hazard became active, and the pedal was held since.
    _was_down = False
    _pressed = False  # whether the operator pressed the E-stop
    # Whether the operator has handed the console over or left, and nobody has driven since.
    _walked = False
    _live = False
    # The last ticks of session and robot.
    _ticks = (0, 0)
    # Whether the cue has acted in the golden run since the activation.
    _golden_cue = False
    # ms without motion although the pedal was held: of the robot and of its golden run.
    _halted = _halted_at_strike = (0, 0)

    def __init__(
        self,
        scenario: Scenario,
        hazards: Sequence[Armable],
        cue_on: bool,
        record: Callable[..., None],
    ) -> None:
        """record: called with the tick, the kind and the content of each event."""
        self.scenario, self.hazards = scenario, tuple(hazards)
        self.cue_on = cue_on
        """Whether the operator feels forces. The instructor may change it at any time."""
        self._record = record
        self._over: list[Episode] = []
        self._trips = Trips()
        # Counts of trips not reported yet, and the tick of each check's last report.
        self._alarms: dict[str, int] = {}
        self._counted_at: Counter[str] = Counter()
        self._slowdown = SlowdownDetector(scenario.scale)

    # --- calls of the session ---

    def armed(self, number: int, tick: int) -> None:
        """Begin to judge a hazard, which is armed before this tick."""
        self.disarmed(tick)
        self._episode = Episode(
            self.hazards[number], self.scenario.harm, tick, self.cue_on, self._record
        )
        row = self._episode.row()
        known = {name: row[name] for name in _NAMES["known_when_armed"]}
        self._episode.record(tick, "hazard_armed", row=known)

    def disarmed(self, tick: int) -> None:
        """End the judgement of the armed hazard, if there is one."""
        episode, self._episode = self._episode, None
        if episode is None:
            return
        self._over.append(episode)
        row = episode.row()
        over = {name: row.get(name) for name in _NAMES["known_when_over"]}
        episode.record(tick, "hazard_over", **over)
        known = {name: value for name, value in row.items() if value is not None}
        self._record(tick, "hazard_row", row=known)

    def restarted(self, tick: int) -> None:
        """Forget the state of the robot, which was homed again without any fault."""
        self.disarmed(tick)
        self._trips.reset()
        self._slowdown.skip_step()
        self._pressed = False
        for arm in self._arms:
            arm.reset()

    def close(self, tick: int, reason: str = "end") -> None:
        for name, count in self._alarms.items():
            self._record(tick, "alarm_count", check=name, count=count)
        self.interrupted(tick, reason)
        self.disarmed(tick)

    def lifted(self, tick: int, why: str) -> None:
        """Record that the pedal went up without the operator's foot. This is no release."""
        self._pedal = False
        if why != "silent" or not self._walked:
            self.interrupted(tick, why)

    def walked_away(self) -> None:
        """Record that the operator hands the console over or leaves. The silence until the next
        pedal-down interrupts no hazard, so that leaving avoids no score.
        """
        self._walked = True

    def begin_trial(self, tick: int) -> None:
        """Count the start of a trial as a lifted pedal, not as a robot that halted on its own."""
        self._respond(tick, "release")
        self._was_down = False

    def forget_trips(self) -> None:
        """Forget the trips of the checks: the waiting robot was restarted without a hazard."""
        self._trips.reset()

    def command(self, message: Command, tick: int) -> None:
        """Record a response that the operator gives by a command other than motion."""
        match message.get("do"):
            case "estop":
                self._pressed = True
                self._respond(tick, "stop")
            case "restart" if not self._live:
                self._respond(tick, "restart")
            case "note" if "convert" in str(message.get("text", "")).lower():
                self._respond(tick, "convert")

    def step(
        self, tick: int, frame: Frame, outcomes: Json | None = None, golden: Json | None = None
    ) -> None:
        """Judge one tick. outcomes, golden: see `read_checks`; outcomes None: not read now."""
        if not self._arms:
            self._arms = tuple(_Arm(frame, name) for name in frame.layout.arms)
        row = frame.numbers
        robot_tick, live, active, pedal, alive, golden_cue, *halted = map(
            frame.number, _NAMES["channels"]
        )
        was_live, self._ticks = self._live, (tick, int(robot_tick))
        self._live = live != 0.0
        self._slowdown.step(tick, [x for arm in self._arms for x in row[arm.hand]])
        episode = self._episode
        if episode is not None and active and not episode.struck:
            self._was_down = was_live and self._pedal
            episode.struck_ms = tick
            self._slowdown.start_hazard()
            self._pressed = self._golden_cue = False
            self._halted_at_strike = self._halted
            for arm in self._arms:
                # The depth at which the tip touches the tissue without the hazard.
                arm.depth_at_strike = max(row[arm.depth], 0.0)
            episode.record(tick, "hazard_struck")
        self._halted = (int(halted[0]), int(halted[1]))
        self._golden_cue = self._golden_cue or golden_cue != 0.0
        if outcomes is not None:
            self.read_checks(outcomes, golden)
        if self.cue_on and alive:
            self._record_cue(tick, row)
        if episode is not None and episode.struck:
            if not alive and not self._walked:
                self.interrupted(tick, "console")
            self._judge_tick(tick, row, pedal, alive, episode)
        self._pedal = pedal != 0.0
        self._walked = self._walked and not self._pedal

    # --- rows and events ---

    def rows(self, **identity: Any) -> list[Json]:
        """Return a row of hazards.csv for each hazard. identity: `reader.session_columns`."""
        episodes = (*self._over, self._episode)
        rows = [identity | episode.row() for episode in episodes if episode]
        return [{column: row.get(column) for column in COLUMNS} for row in rows]

    def _struck_episode(self) -> Episode | None:
        return self._episode if self._episode and self._episode.struck else None

    def read_checks(self, outcomes: Json, golden: Json | None) -> None:
        """Record the trips of the robot's checks since the last reading.

        outcomes, golden: outcome columns of robot and golden run so far; golden None: there is no
        golden run. Call it before a hazard is disarmed, because the golden run restarts then.
        """
        tick, robot_tick = self._ticks
        episode = None if self._pressed else self._struck_episode()
        for trip in self._trips.new_trips(tick, robot_tick, outcomes, golden):
            check, ms, is_first = trip.check, trip.ms, False
            if episode is not None and trip.beyond_golden:
                ms = max(ms, episode.struck_ms or 0)
                is_first = episode.record_trip(ms, check)
            is_told = check.response in verdict.TOLD
            is_new = is_first or trip.announced
            if is_told and not is_new and tick - self._counted_at[check.name] < COUNT_EVERY_MS:
                self._alarms[check.name] = trip.count
            elif is_told:
                self._counted_at[check.name] = tick
                self._alarms.pop(check.name, None)
                kind = "alarm" if is_new else "alarm_count"
                self._record(tick, kind, check=check.name, count=trip.count)
            if episode is not None and is_first:
                episode.record(tick, check.response, check=check.name, ms=ms)
                if is_told:
                    episode.record_knowable(tick, check.name, ms)

    def _record_cue(self, tick: int, row: list[float]) -> None:
        episode = self._struck_episode()
        for arm in self._arms:
            if not any(row[arm.force]):
                continue
            if tick - arm.last_force > CUE_QUIET_MS:
                if episode is not None and episode.cue_ms is None and not self._golden_cue:
                    episode.record_cue(tick)
                number = -1 if episode is None or episode.cue_ms is None else episode.hazard.number
                self._record(tick, "cue", number=number, arm=arm.name)
            arm.last_force = tick

    def _judge_tick(
        self, tick: int, row: list[float], pedal: float, alive: float, episode: Episode
    ) -> None:
        # Measures the effect of the hazard in this tick, and detects responses of the operator.
        peaks = episode.peak_mm
        for arm in self._arms:
            if episode.knowable_ms is None and any(row[place] >= SEEN_MM for place in arm.seen):
                episode.record_knowable(tick, "tip")
            for name, place in arm.distances:
                mm = row[place]
                # An unknown distance is NaN, for which this comparison is false.
                if mm > peaks[name]:
                    episode.record_peak(tick, name, mm, arm.name)
            if self._live:
                unintended, depth = row[arm.unintended], row[arm.depth]
                # `max` ignores a NaN as its second argument.
                episode.peak_error_mm = max(episode.peak_error_mm, row[arm.error])
                episode.deepest_mm = max(episode.deepest_mm, depth)
                # The fault added at most as much depth as it added motion.
                episode.record_effect(tick, 1, min(unintended, depth - arm.depth_at_strike))
        self._was_down = self._was_down and pedal != 0.0
        if self._was_down and not self._live and not episode.halted and not self._pressed:
            episode.halted = True
            episode.record_knowable(tick, "runlevel")
        halted, golden_halted = (
            now - then for now, then in zip(self._halted, self._halted_at_strike, strict=True)
        )
        changed = halted != episode.halted_ms or golden_halted != episode.golden_halted_ms
        if changed and not self._pressed:
            episode.record_halt(tick, halted, golden_halted)
        if self._pedal and not pedal and alive:
            self._respond(tick, "release")
        if pedal and self._live and self._slowdown.slowed >= 0:
            self._respond(tick, "slow", self._slowdown.slowed)

    def _respond(self, tick: int, what: str, at: int | None = None) -> None:
        if episode := self._struck_episode():
            episode.record_response(tick, what, at)

    def interrupted(self, tick: int, by: str) -> None:
        """Record that something other than the operator ended the active, undecided hazard."""
        episode = self._struck_episode()
        if episode and not episode.interrupted and not episode.is_decided(tick):
            episode.interrupted = True
            episode.record(tick, "interrupted", by=by)


class _Arm:
    def __init__(self, frame: Frame, name: str) -> None:
        places = frame.layout.places
        self.name = name

        def start(channel: str) -> int:
            return places[f"{name}/{channel}_mm"].start

        self.error, self.depth, self.unintended = map(start, ("error", "depth", "unintended"))
        self.seen = tuple(map(start, SEEN))
        self.distances = tuple((channel, start(channel)) for channel in PEAKS)
        self.force, self.hand = places[f"{name}/force"], places[f"{name}/hand"]
        self.reset()

    def reset(self) -> None:
        self.last_force = -CUE_QUIET_MS - 1
        self.depth_at_strike = 0.0
