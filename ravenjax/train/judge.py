"""Judges a session tick by tick: the effect of each hazard, the response, the score.

docs/outcomes.md defines the outcomes. Effects are differences from the golden run, which starts
from the robot's state when the hazard is armed. From the activation on, the columns `unintended_mm`
to `false_report_first_ms` have the same meaning as in a campaign's result table. At `knowable_ms` a
person at the console can first notice the hazard: the tip is `SEEN_MM` off its course, the robot
has left pedal-down although the pedal is held, or a check has raised an alarm. Reaction times start
at the *origin*: the start of the cue or `knowable_ms`, whichever is earlier. A person acts at the
earliest `ACTS_MS` after the origin. The judge scores the first right response within the time
allowed. If there is no right response, the judge scores the first other response. It ignores a
slow-down unless the scenario lists this response as right, because hands slow down near a target. A
hazard ends when harm is done, when the operator gives a right response, or when the time is up. If
a pause, a reset or a broken connection comes first, the hazard counts as interrupted. The score has
two parts of up to 50 points. A right response gives 50 points if it takes up to `FASTEST_MS`, and
25 points at the end of the time allowed. The points for safety are 50 times a ratio: the distance
to harm at the end, divided by the distance to harm at the time when a person could first act.
"""

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import pydantic
from pydantic import BeforeValidator

from ravenjax import resources
from ravenjax.outcomes import verdict
from ravenjax.train.protocol import Command, Frame, Json
from ravenjax.train.robot import ROBOT
from ravenjax.train.scenario import Armable, Harm, Scenario
from ravenjax.vocabulary import checks

Text = Annotated[str, BeforeValidator(lambda value: "" if value is None else str(value))]
Flag = Annotated[bool, BeforeValidator(lambda value: value or False)]
_NAMES: dict[str, Any] = resources.read_tables(__file__, "judge.toml")
"""Names of columns and of events."""
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
PEAKS = (*DISTANCES, "unintended_off")  # Distances whose largest value an `Episode` stores
_MOTION, _DEPTH = 0, 1
"""Index of unintended motion and of depth in lists of the two effects that can be harm."""


def _number_or_none(value) -> float | None:
    """Return a value of hazards.csv as a number; None if it is empty, infinite or NaN."""
    try:
        number = math.nan if value in (None, "") else float(value)
    except ValueError:
        raise ValueError("expected a number or an empty field") from None
    return number if math.isfinite(number) else None


Number = Annotated[float | None, BeforeValidator(_number_or_none)]


@pydantic.dataclasses.dataclass(frozen=True, kw_only=True)
class HazardRow:
    """One row of hazards.csv. Strings from a file are converted. Times are ms since the session's
    time began, without pauses. None: the event never happened, or the distance was not measured.
    """

    session: Text
    participant: Text
    group: Text
    scenario: Text
    seed: Text
    cue: Text  # on, off
    blinded: Flag
    # From 1 in the order of activation, as in the debrief.
    number: int
    hazard: Text  # id in the library
    title: Text
    arm: Text
    armed_ms: Number
    struck_ms: Number  # the activation: the fault acts for the first time
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
    def times_after_activation(self) -> dict[str, float]:
        """Time from the activation to each of `MOMENTS` that occurred, ms. Empty without one."""
        if self.struck_ms is None:
            return {}
        times = {name: getattr(self, f"{name}_ms") for name in MOMENTS}
        return {name: time - self.struck_ms for name, time in times.items() if time is not None}

    @property
    def peak_unintended_mm(self) -> float | None:
        """Largest unintended motion of the true tip, live or not. None if neither was measured."""
        distances = (self.unintended_mm, self.unintended_off_mm)
        return max((mm for mm in distances if mm is not None), default=None)


COLUMNS = tuple(field.name for field in dataclasses.fields(HazardRow))
"""Columns of hazards.csv, in order."""
TIMES: list[str] = _NAMES["times"]


class Episode:
    """Judges one hazard, from arming to disarming. Attributes ending in `_ms` are session times."""

    struck_ms: int | None = None
    """The activation: the tick in which the fault first acts. None before."""
    knowable_ms: int | None = None
    knowable_by = ""
    cue_ms: int | None = None
    # Time of the first sign, cue or alarm, whichever is earliest; infinite before.
    origin_ms: float = math.inf
    halted = False
    # Durations since the activation, ms.
    halted_ms, golden_halted_ms = 0, 0
    peak_error_mm = 0.0
    deepest_mm = -math.inf
    # Whether the robot stood still for too long although the pedal was down.
    _has_lost_motion = False
    interrupted = False

    def __init__(
        self, hazard: Armable, harm: Harm, tick: int, cue_on: bool, record: Callable[..., None]
    ):
        """tick: when the hazard is armed. cue_on: whether the operator feels the cue. record: gets
        kind and content of each event, to which the number of this hazard is added.
        """
        self.hazard, self.harm = hazard, harm
        self.record = functools.partial(record, number=hazard.number)
        self.cue_on = cue_on
        self.armed_ms = tick
        # By kind of response (`verdict.RESPONSES`): ms and name of the first check that tripped.
        self.first_trips: dict[str, tuple[int, str]] = {}
        # The arm on which the fault acts. If the fault acts on no arm: the one that moved farthest.
        self.arm = hazard.arm
        self.peak_mm: dict[str, float] = dict.fromkeys(PEAKS, -1.0)  # -1: not measured
        self.first_ms: dict[str, int] = {}  # When one of `DISTANCES` first exceeded the limit
        # What the fault caused, and the part of it that nobody could have prevented. Each has two
        # values, which `_MOTION` and `_DEPTH` index; so do the limits above which harm is done.
        self._caused_mm, self._unpreventable_mm = np.zeros((2, 2))
        self._limits_mm = np.array([harm.excursion_mm, harm.depth_mm])
        self.responses: dict[str, int] = {}  # When the operator first gave each kind of response

    @property
    def is_activated(self) -> bool:
        return self.struck_ms is not None

    @property
    def check_response(self) -> str:
        """The strongest response of the robot's checks so far, one of `verdict.RESPONSES`."""
        # `RESPONSES` begins with the strongest.
        return next((word for word in verdict.RESPONSES if word in self.first_trips), "silent")

    def record_first_sign(self, ms: int, sign: str) -> None:
        """Record when a person could first notice the hazard. Later signs are ignored. sign: "tip",
        "runlevel" or the name of a check.
        """
        if self.knowable_ms is None:
            self.knowable_ms, self.knowable_by = ms, sign
            self.origin_ms = min(self.origin_ms, ms)
            self.record("knowable", by=sign, ms=ms)

    def record_cue(self, tick: int) -> None:
        """Record that the operator felt the cue."""
        self.cue_ms = tick
        self.origin_ms = min(self.origin_ms, tick)

    def record_trip(self, tick: int, check: checks.Check) -> bool:
        """Record a trip that the golden run does not have, if it is the first with its response.
        Return whether it was the first. Alarms and stops can set the origin of reaction times.
        """
        if check.response in self.first_trips:
            return False
        self.first_trips[check.response] = tick, check.name
        if check.response in verdict.TOLD:
            self.origin_ms = min(self.origin_ms, tick)
        return True

    def record_peak(self, tick: int, name: str, mm: float, arm: str) -> None:
        """Record a new largest value of one of `PEAKS`. Report the first value above the limit."""
        self.peak_mm[name] = mm
        # A fault that acts on no single arm is attributed to the arm that moved farthest.
        if name.startswith("unintended") and mm > self._caused_mm[_MOTION] and not self.hazard.arm:
            self.arm = arm
        farthest = max(self.peak_mm["unintended"], self.peak_mm["unintended_off"])
        self.record_effect(tick, _MOTION, farthest)
        if name in DISTANCES and mm > self.harm.excursion_mm and name not in self.first_ms:
            self.first_ms[name] = tick
            self.record(_NAMES["events"][name], arm=arm, mm=round(mm, 3))

    def record_halt(self, halted_ms: int, golden_halted_ms: int) -> None:
        """Record for how long the robot and its golden run stood still while the pedal was down.
        Report a loss of motion when the difference first becomes too long.
        """
        had_lost_motion = self._has_lost_motion
        self.halted_ms, self.golden_halted_ms = halted_ms, golden_halted_ms
        stopped = self.check_response == "stopped"
        self._has_lost_motion = bool(verdict.is_halt(halted_ms, golden_halted_ms, stopped))
        # A distance may have reported the loss of motion earlier.
        if self._has_lost_motion and not had_lost_motion and "loss" not in self.first_ms:
            self.record(_NAMES["events"]["loss"], halted_ms=halted_ms - golden_halted_ms)

    def record_response(self, response: str, began_ms: int) -> None:
        """Record an operator's response, if it is the first of its kind after `origin_ms`. Report
        it as an event, unless an earlier response remains the scored one. response: one of those
        that `Judge` lists.
        """
        # A robot that has halted needs no response by motion.
        is_excluded = self.interrupted or (self.halted and response in _MOTION_RESPONSES)
        if is_excluded or began_ms < self.origin_ms or response in self.responses:
            return
        # Without a response, `scored_response` returns "" or "continue", which are not recorded.
        had_scored_response = self.scored_response()[0] in self.responses
        self.responses[response] = began_ms
        if had_scored_response and self.scored_response()[0] != response:
            return
        # Hands also slow down near a target, so a slow-down is reported only as a right response.
        if response == "slow" and response not in self.hazard.right_response:
            return
        ms, is_right = self.reaction_ms(response), self.is_right(response)
        self.record("response", what=response, ok=is_right, ms=ms)

    def is_decided(self, tick: int) -> bool:
        """Whether the outcome is final: after harm, a right response, or the time allowed. If the
        right response is to continue, any other response than a slow-down decides too.
        """
        if self._exceeds_limit(self._caused_mm) and not self._exceeds_limit(self._unpreventable_mm):
            return True
        is_late = tick - self.origin_ms > self._within_ms
        if CONTINUE in self.hazard.right_response:
            return is_late or any(response != "slow" for response in self.responses)
        return is_late or self.scored_response()[1]

    def is_right(self, response: str) -> bool:
        """Whether this response, which the operator gave, is right and in time."""
        is_in_time = self.reaction_ms(response) <= self._within_ms
        return response in self.hazard.right_response and is_in_time

    def reaction_ms(self, response: str) -> float:
        """Return the time from the origin to a response that the operator gave, ms."""
        return self.responses[response] - self.origin_ms

    def scored_response(self) -> tuple[str, bool]:
        """Return the response that the judge scores, and whether it is right and in time. It is the
        first right response in time. Without one, it is the first response other than a slow-down;
        "" if there is none. If the operator should continue, the absence of such a response is the
        right response "continue", unless the robot has halted.
        """
        in_order = sorted(self.responses, key=self.responses.__getitem__)
        first = next((response for response in in_order if response != "slow"), "")
        if CONTINUE in self.hazard.right_response:
            if first:
                return first, False
            return CONTINUE, self.is_activated and not self.halted
        right = next((response for response in in_order if self.is_right(response)), "")
        return (right, True) if right else (first, False)

    def motion_hazard(self) -> str:
        """Return the motion hazard, one of `verdict.HAZARDS`."""
        # `classify_hazards` reads columns of many runs; the columns here have a single row.
        columns = {f"{name}_first_ms": [self.first_ms.get(name, -1)] for name in DISTANCES}
        columns |= {"halted_ms": [self.halted_ms], "golden_halted_ms": [self.golden_halted_ms]}
        stopped = np.array([self.check_response == "stopped"])
        (hazard_index,) = verdict.classify_hazards(columns, stopped)
        return verdict.HAZARDS[hazard_index]

    def outcome(self) -> str:
        """Return one of interrupted, unavoidable, harm, avoided, halted, unaffected, missed. The
        first that applies counts. docs/outcomes.md defines these words.
        """
        if self.interrupted:
            return "interrupted"
        if self._exceeds_limit(self._unpreventable_mm):
            return "unavoidable"
        if self._exceeds_limit(self._caused_mm):
            return "harm"
        _, is_right_in_time = self.scored_response()
        if is_right_in_time:
            return "avoided"
        if self.halted:
            return "halted"
        is_small = max(self.peak_mm.values()) < AFFECTED_MM
        if is_small and self.cue_ms is None and self.motion_hazard() == "none":
            return "unaffected"
        return "missed"

    def score(self) -> float | None:
        """Return the score, 0 to 100, or None if the hazard is unaffected or interrupted: up to 50
        points for a prompt right response, and up to 50 for the distance to harm that is left.
        """
        if self.outcome() in ("unaffected", "interrupted"):
            return None
        response, is_right = self.scored_response()
        response_share = 0.0
        if is_right:
            # The operator who rightly continues has no reaction time, and loses no points.
            is_prompt = response == CONTINUE
            delay = 0.0 if is_prompt else max(self.reaction_ms(response) - FASTEST_MS, 0.0)
            longest_delay = max(self._within_ms - FASTEST_MS, 1.0)
            response_share = 1.0 - 0.5 * min(delay / longest_delay, 1.0)
        # The share of the remaining distance to a limit that the fault used up after a person could
        # first act. If the limit was exceeded before, it is the share of the whole limit.
        unpreventable, limits = self._unpreventable_mm, self._limits_mm
        available = limits - np.where(unpreventable < limits, unpreventable, 0.0)
        used_share = float(np.max((self._caused_mm - unpreventable) / available))
        return round(50.0 * response_share + 50.0 * max(0.0, 1.0 - used_share), 1)

    def row(self) -> Json:
        """Return the columns of hazards.csv that are known now. Before the activation, there are no
        columns of the robot's checks and of its motion.
        """
        response, is_right = self.scored_response()
        # The operator did not give the responses "" and "continue", so these have no time.
        has_time = response in self.responses
        # `min` returns the first of two equal times, and `TOLD` begins with the stronger response.
        alarms = [self.first_trips[word] for word in verdict.TOLD if word in self.first_trips]
        alarm_ms, alarm = min(alarms, key=lambda trip: trip[0], default=(None, None))
        limited_ms, limited = self.first_trips.get("limited", (None, None))
        row = {name: getattr(self.hazard, name) for name in _NAMES["of_hazard"]}
        row |= {name: getattr(self, name) for name in _NAMES["of_episode"]}
        row |= {
            "cue": "on" if self.cue_on else "off",
            "knowable_by": self.knowable_by or None,
            "alarm_ms": alarm_ms,
            "alarm": alarm,
            "limited_ms": limited_ms,
            "limited": limited,
            "limit_mm": self.harm.excursion_mm,
            "response": response or None,
            "response_ms": self.responses[response] if has_time else None,
            "reaction_ms": self.reaction_ms(response) if has_time else None,
            "right_response": " ".join(self.hazard.right_response),
            "response_ok": is_right,
            "outcome": self.outcome(),
            "score": self.score(),
        }
        if not self.is_activated:
            return row
        row["check_response"] = self.check_response
        row["check_cause"] = self.first_trips.get(self.check_response, (None, None))[1]
        row["motion_hazard"] = self.motion_hazard()
        for name, mm in self.peak_mm.items():
            row[f"{name}_mm"] = round(mm, 4) if mm >= 0.0 else None
        for name in DISTANCES:
            row[f"{name}_first_ms"] = self.first_ms.get(name)
        return row | {
            "halted_ms": self.halted_ms,
            "golden_halted_ms": self.golden_halted_ms,
            "peak_error_mm": round(self.peak_error_mm, 4),
            "deepest_mm": round(self.deepest_mm, 4) if math.isfinite(self.deepest_mm) else None,
        }

    @property
    def _within_ms(self) -> float:
        return self.hazard.within_s * 1000.0

    def _exceeds_limit(self, amounts_mm: np.ndarray) -> bool:
        return bool((amounts_mm > self._limits_mm).any())

    def record_effect(self, tick: int, kind: int, mm: float) -> None:
        """Record the unintended motion or the depth, mm, that the fault has caused so far. kind:
        `_MOTION` or `_DEPTH`. Until a person could act, nobody can prevent this effect.
        """
        self._caused_mm[kind] = max(self._caused_mm[kind], mm)
        if tick < self.origin_ms + ACTS_MS:
            self._unpreventable_mm[kind] = self._caused_mm[kind]


SLOW_SHARE = 0.25  # Hands are slow below this share of their usual speed, as in `stages.reaction`
SLOW_FOR_MS = 1000  # A slow-down counts only if it lasts this long, ms
MOVING_MM_S = 2.0  # Hands slower than this cannot slow down. Speed of the tip, mm/s.
# Share by which each ms moves the running mean of the usual and of the present speed.
_USUAL_WEIGHT, _PRESENT_WEIGHT = 1.0 / 2000.0, 1.0 / 50.0
QUIET_MS = 1000
"""A check that trips again is announced only after this time without a trip, ms."""
CUE_QUIET_MS = 250  # Time without force after which a new force counts as a new cue, ms
COUNT_EVERY_MS = 1000  # The shortest time between two events "alarm_count" of one check, ms
_MOTION_RESPONSES = ("release", "slow")
"""Responses to a robot that moves. They do not count once the robot has halted on its own."""
SEEN = ("known", "unintended", "unintended_off", "loss")
"""Distances of a frame that a person may see at the console."""


class Trip(NamedTuple):
    """One or more trips of a check since the last reading of the counters."""

    check: checks.Check
    ms: int  # ms of the session: exact for a check's first trip, otherwise the time of the reading
    exceeds_golden: bool  # Whether the check has tripped more often than in the golden run
    # Whether the check had not tripped for `QUIET_MS`, so that this is a new alarm.
    is_after_pause: bool
    count: int  # trips in the session so far


class Trips:
    """Counts the trips of each check. Call `new_trips` every few milliseconds."""

    def __init__(self):
        self._counts: Counter[str] = Counter()  # trips since the robot's last restart
        self._earlier_counts: Counter[str] = Counter()  # trips before this restart
        self._last_tick: dict[str, int] = {}  # tick of each check's last trip

    def new_trips(
        self, tick: int, robot_tick: int, outcomes: Json, golden: Json | None = None
    ) -> list[Trip]:
        """Return a `Trip` for each check that tripped since the last reading, the earliest first.
        tick, robot_tick: ms of session and robot. outcomes, golden: `check_*` columns of robot and
        golden run since the robot's last restart. Without a golden run every trip exceeds it.
        """
        trips = []
        for name in checks.check_names(outcomes):
            count, last_count = int(outcomes[f"check_{name}_count"]), self._counts[name]
            self._counts[name] = count
            if count <= last_count:
                continue
            ms = tick
            # The robot reports the time only of a check's first trip, in ms of its own clock.
            first_ms = int(outcomes.get(f"check_{name}_first_ms", -1))
            if last_count == 0 and first_ms >= 0:
                ms = tick - (robot_tick - first_ms)
            golden_count = 0 if golden is None else int(golden[f"check_{name}_count"])
            trips.append(
                Trip(
                    check=ROBOT.check(name),
                    ms=ms,
                    exceeds_golden=count > golden_count,
                    is_after_pause=ms - self._last_tick.get(name, -math.inf) > QUIET_MS,
                    # The robot counts from 0 after each restart, the session does not.
                    count=self._earlier_counts[name] + count,
                )
            )
            self._last_tick[name] = tick
        return sorted(trips, key=lambda trip: trip.ms)

    def reset(self) -> None:
        """Continue the counts after a restart of the robot, whose own counters begin at 0."""
        self._earlier_counts += self._counts
        self._counts = Counter()


@dataclasses.dataclass
class SlowdownDetector:
    """Detects that the operator slows down, from running means of the speed of both hands. Hands
    also slow down at each target, so a slow-down counts only if it lasts longer than a tip is held
    at a target. Speeds are those of the tip, mm/s.
    """

    scale: float
    _last_hands: list[float] | None = None
    usual_mm_s = present_mm_s = 0.0
    _limit_mm_s = 0.0  # The hands are slow below this speed
    slow_ms = 0.0
    """How long the hands have been slow. Minus infinity: they were slow before the activation."""

    def step(self, hands: list[float]) -> None:
        """Update speeds and `slow_ms` in each tick. hands: x, y, z of each hand in um, unscaled."""
        last_hands, self._last_hands = self._last_hands, hands
        if last_hands is None:
            return
        # um/ms is mm/s
        speed = self.scale * math.dist(hands, last_hands)
        self.usual_mm_s += _USUAL_WEIGHT * (speed - self.usual_mm_s)
        self.present_mm_s += _PRESENT_WEIGHT * (speed - self.present_mm_s)
        self.slow_ms = self.slow_ms + 1 if self.present_mm_s < self._limit_mm_s else 0

    def start_hazard(self) -> None:
        """Compare later speeds with the usual speed before the hazard that becomes active now."""
        can_slow_down = self.usual_mm_s > MOVING_MM_S
        self._limit_mm_s = SLOW_SHARE * self.usual_mm_s if can_slow_down else 0.0
        # Hands that are slow already count only after they were faster again.
        self.slow_ms = -math.inf if self.present_mm_s < self._limit_mm_s else 0

    def skip_step(self) -> None:
        """Ignore the next step of the hands, because a restart moved them elsewhere."""
        self._last_hands = None


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
    _arms: "tuple[_Arm, ...]" = ()
    _pedal_down = False
    # Whether the robot moved when the hazard became active, and the pedal was held since.
    _pedal_held_since_activation = False
    _estop_pressed = False
    # Whether the operator has handed the console over or left, and nobody has driven since.
    _operator_left = False
    _live = False
    _tick = _robot_tick = 0  # The last ticks of session and robot
    _golden_cue = False  # Whether the cue has acted in the golden run since the activation
    # ms without motion although the pedal was held: of the robot and of its golden run.
    _halted_ms = _halted_ms_at_activation = (0, 0)

    def __init__(
        self,
        scenario: Scenario,
        hazards: Sequence[Armable],
        cue_on: bool,
        record: Callable[..., None],
    ):
        """record: called with the kind and the content of each event of this tick."""
        self.scenario, self.hazards = scenario, tuple(hazards)
        self.cue_on = cue_on
        """Whether the operator feels forces. The instructor may change it at any time."""
        self._record = record
        self._ended_episodes: list[Episode] = []
        self._trips = Trips()
        # By check: a count of alarms that no event has reported, and the tick of the last report.
        self._unreported_counts: dict[str, int] = {}
        self._last_report_tick: Counter[str] = Counter()
        self._slowdown = SlowdownDetector(scenario.scale)

    def begin_hazard(self, number: int, tick: int) -> None:
        """Begin to judge a hazard, which is armed before this tick. End the one before."""
        self.end_hazard()
        hazard, harm = self.hazards[number], self.scenario.harm
        self._episode = Episode(hazard, harm, tick, self.cue_on, self._record)
        row = self._episode.row()
        known = {name: row[name] for name in _NAMES["known_when_armed"]}
        self._episode.record("hazard_armed", row=known)

    def end_hazard(self) -> None:
        """End the judgement of the armed hazard, if there is one. Record its outcome as events."""
        episode, self._episode = self._episode, None
        if episode is None:
            return
        self._ended_episodes.append(episode)
        row = episode.row()
        outcome = {name: row.get(name) for name in _NAMES["known_when_over"]}
        episode.record("hazard_over", **outcome)
        known = {name: value for name, value in row.items() if value is not None}
        self._record("hazard_row", row=known)

    def restart(self) -> None:
        """Forget the state of the robot, which was homed again without any fault."""
        self.end_hazard()
        self._trips.reset()
        self._slowdown.skip_step()
        self._estop_pressed = False
        for arm in self._arms:
            arm.reset()

    def close(self, tick: int, reason: str = "end") -> None:
        """Record what is left at the end of the session. reason: why the session ends."""
        for name, count in self._unreported_counts.items():
            self._record("alarm_count", check=name, count=count)
        self.interrupt(tick, reason)
        self.end_hazard()

    def lift_pedal(self, tick: int, reason: str) -> None:
        """Record that the pedal went up without the operator's foot. This is no release. The hazard
        is interrupted, unless the console is silent because the operator left it.
        """
        self._pedal_down = False
        if reason != "silent" or not self._operator_left:
            self.interrupt(tick, reason)

    def leave_console(self) -> None:
        """Record that the operator hands the console over or leaves. The silence until the next
        pedal-down interrupts no hazard, so that leaving avoids no score.
        """
        self._operator_left = True

    def begin_trial(self, tick: int) -> None:
        """Count the start of a trial as a lifted pedal, not as a robot that halted on its own."""
        self._respond(tick, "release")
        self._pedal_held_since_activation = False

    def record_command(self, message: Command, tick: int) -> None:
        """Record a response that the operator gives by a command other than motion."""
        match message.get("do"):
            case "estop":
                self._estop_pressed = True
                self._respond(tick, "stop")
            # The restart of a robot that follows the hands is no response.
            case "restart" if not self._live:
                self._respond(tick, "restart")
            case "note" if "convert" in str(message.get("text", "")).lower():
                self._respond(tick, "convert")

    def step(
        self, tick: int, frame: Frame, outcomes: Json | None = None, golden: Json | None = None
    ) -> None:
        """Judge one tick. outcomes, golden: outcome columns of robot and golden run so far, whose
        trips of checks are read; None: they are not read in this tick.
        """
        if not self._arms:
            self._arms = tuple(_Arm(frame, name) for name in frame.layout.arms)
        row = frame.numbers
        was_live, self._live = self._live, frame.number("live") != 0.0
        self._tick, self._robot_tick = tick, int(frame.number("tick"))
        self._slowdown.step([x for arm in self._arms for x in row[arm.hand]])
        episode = self._episode
        if episode is not None and frame.number("fault_active") and not episode.is_activated:
            self._pedal_held_since_activation = was_live and self._pedal_down
            self._activate(tick, row, episode)
        halted_ms, golden_halted_ms = frame.number("halted_ms"), frame.number("golden_halted_ms")
        self._halted_ms = int(halted_ms), int(golden_halted_ms)
        self._golden_cue = self._golden_cue or frame.number("golden_cue") != 0.0
        if outcomes is not None:
            self.read_checks(outcomes, golden)
        pedal_down = frame.number("pedal") != 0.0
        console_alive = frame.number("console_alive") != 0.0
        if self.cue_on and console_alive:
            self._record_cue(tick, row)
        if episode is not None and episode.is_activated:
            if not console_alive and not self._operator_left:
                self.interrupt(tick, "console")
            self._measure_effects(tick, row, episode)
            self._detect_halt(tick, pedal_down, episode)
            if self._pedal_down and not pedal_down and console_alive:
                self._respond(tick, "release")
            slow_ms = self._slowdown.slow_ms
            if pedal_down and self._live and slow_ms > SLOW_FOR_MS:
                # The response is dated to the beginning of the slow-down.
                self._respond(tick + 1 - int(slow_ms), "slow")
        self._pedal_down = pedal_down
        self._operator_left = self._operator_left and not pedal_down

    def rows(self, **identity: Any) -> list[Json]:
        """Return a row for each hazard, with its number in the session's list and times in ticks.
        `reader.number_hazards` changes both for hazards.csv. identity: columns that all rows share.
        """
        episodes = (*self._ended_episodes, self._episode)
        rows = [identity | episode.row() for episode in episodes if episode]
        return [{column: row.get(column) for column in COLUMNS} for row in rows]

    def _activated_episode(self) -> Episode | None:
        return self._episode if self._episode and self._episode.is_activated else None

    def _activate(self, tick: int, row: list[float], episode: Episode):
        # Begins to measure effects, because the hazard's fault acts for the first time.
        episode.struck_ms = tick
        self._slowdown.start_hazard()
        self._estop_pressed = self._golden_cue = False
        self._halted_ms_at_activation = self._halted_ms
        for arm in self._arms:
            # The depth at which the tip touches the tissue without the hazard.
            arm.depth_mm_at_activation = max(row[arm.depth], 0.0)
        episode.record("hazard_struck")

    def read_checks(self, outcomes: Json, golden: Json | None) -> None:
        """Record the trips of the robot's checks since the last reading. An alarm or stop becomes
        an event at once if it is new. Otherwise an event reports the count of trips at most every
        `COUNT_EVERY_MS`. outcomes, golden: outcome columns of robot and golden run so far; golden
        None: there is no golden run. Call it before the end of a hazard restarts the golden run.
        """
        # The operator's E-stop trips checks, too. These are no effect of the hazard.
        episode = None if self._estop_pressed else self._activated_episode()
        tick = self._tick
        for trip in self._trips.new_trips(tick, self._robot_tick, outcomes, golden):
            check, ms, is_first = trip.check, trip.ms, False
            if episode is not None and trip.exceeds_golden:
                # `ms` is of the first of several trips, which may precede the activation.
                ms = max(ms, episode.struck_ms or 0)
                is_first = episode.record_trip(ms, check)
            if check.response in verdict.TOLD:
                is_new_alarm = is_first or trip.is_after_pause
                self._report_alarm(tick, check.name, trip.count, is_new_alarm)
            if episode is not None and is_first:
                episode.record(check.response, check=check.name, ms=ms)
                if check.response in verdict.TOLD:
                    episode.record_first_sign(ms, check.name)

    def _report_alarm(self, tick: int, check: str, count: int, is_new_alarm: bool):
        # Repeated alarms would fill the record, so their count waits until the next event is due.
        is_due = tick - self._last_report_tick[check] >= COUNT_EVERY_MS
        if not is_new_alarm and not is_due:
            self._unreported_counts[check] = count
            return
        self._last_report_tick[check] = tick
        self._unreported_counts.pop(check, None)
        self._record("alarm" if is_new_alarm else "alarm_count", check=check, count=count)

    def _record_cue(self, tick: int, row: list[float]):
        # Records the start of each cue, per arm. The event's number is that of the hazard which
        # caused a cue; -1 if there is none, or if the golden run had the cue first.
        episode = self._activated_episode()
        for arm in self._arms:
            if not any(row[arm.force]):
                continue
            if tick - arm.last_force_tick > CUE_QUIET_MS:
                if episode is not None and episode.cue_ms is None and not self._golden_cue:
                    episode.record_cue(tick)
                number = -1 if episode is None or episode.cue_ms is None else episode.hazard.number
                self._record("cue", number=number, arm=arm.name)
            arm.last_force_tick = tick

    def _measure_effects(self, tick: int, row: list[float], episode: Episode):
        # Updates the distances and depths that the hazard has caused.
        for arm in self._arms:
            is_seen = any(row[index] >= SEEN_MM for index in arm.seen_distances)
            if episode.knowable_ms is None and is_seen:
                episode.record_first_sign(tick, "tip")
            for name, index in arm.distances:
                # An unknown distance is NaN, for which this comparison is false.
                if row[index] > episode.peak_mm[name]:
                    episode.record_peak(tick, name, row[index], arm.name)
            if self._live:
                unintended, depth = row[arm.unintended], row[arm.depth]
                # `max` ignores a NaN as its second argument.
                episode.peak_error_mm = max(episode.peak_error_mm, row[arm.error])
                episode.deepest_mm = max(episode.deepest_mm, depth)
                # The fault added at most as much depth as it added motion.
                added_depth = min(unintended, depth - arm.depth_mm_at_activation)
                episode.record_effect(tick, _DEPTH, added_depth)

    def _detect_halt(self, tick: int, pedal_down: bool, episode: Episode):
        # Detects that the robot left pedal-down on its own. Measures for how long the robot and its
        # golden run have stood still since the activation.
        self._pedal_held_since_activation = self._pedal_held_since_activation and pedal_down
        if self._estop_pressed:
            return
        if self._pedal_held_since_activation and not self._live and not episode.halted:
            episode.halted = True
            episode.record_first_sign(tick, "runlevel")
        halted, golden_halted = np.subtract(self._halted_ms, self._halted_ms_at_activation).tolist()
        if (halted, golden_halted) != (episode.halted_ms, episode.golden_halted_ms):
            episode.record_halt(halted, golden_halted)

    def _respond(self, began_ms: int, response: str):
        if episode := self._activated_episode():
            episode.record_response(response, began_ms)

    def interrupt(self, tick: int, cause: str) -> None:
        """Record that something other than the operator ended the active, undecided hazard."""
        episode = self._activated_episode()
        if episode and not episode.interrupted and not episode.is_decided(tick):
            episode.interrupted = True
            episode.record("interrupted", by=cause)


class _Arm:
    """State of one arm, and the indices or slices of its channels in a frame's row."""

    def __init__(self, frame: Frame, name: str):
        places = frame.layout.places
        self.name = name

        def find_index(distance: str) -> int:
            return places[f"{name}/{distance}_mm"].start

        self.error, self.depth = find_index("error"), find_index("depth")
        self.unintended = find_index("unintended")
        self.seen_distances = tuple(map(find_index, SEEN))
        self.distances = tuple((distance, find_index(distance)) for distance in PEAKS)
        self.force, self.hand = places[f"{name}/force"], places[f"{name}/hand"]
        self.reset()

    def reset(self) -> None:
        """Forget the last cue, so that the next force counts as a new cue."""
        self.last_force_tick = -CUE_QUIET_MS - 1
        self.depth_mm_at_activation = 0.0
