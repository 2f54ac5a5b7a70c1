"""Computes response, hazard and verdict of each run from an engine's output, with NumPy.

The docstring of `ravenjax.outcomes` defines these words.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot

PUBLISHED_CUE_MM = 3.0
"""Distance between nominal model and robot above which the published cue is on (IROS 2016), mm."""

LIMIT_MM = PUBLISHED_CUE_MM
"""Default of a campaign's `[outcomes] limit_mm`: the distance at which a hazard begins."""

HALT_MS = 200
"""Total time out of pedal-down above which a run has a loss of motion, ms. The largest visual delay
that operators accept is 150 to 200 ms.

A flickering pedal is up for tens of ms in total, but only a few ms at a time, so no brake closes.
"""

RESPONSES = ("stopped", "flagged", "limited", "silent")
"""Responses of the checks that do more than watch, strongest first."""

HAZARDS = ("unintended motion", "loss of motion", "false report", "none")
"""Hazards of a run, gravest first."""

CUES = ("cue", "no cue")

VERDICTS = tuple(
    f"{response}/{hazard}/{cue}" for response in RESPONSES for hazard in HAZARDS for cue in CUES
)

TOLD = ("stopped", "flagged")
"""Responses that a person notices: a stop or an alarm."""

UNTOLD = ("limited", "silent")
"""Responses that nobody notices."""

SILENT = RESPONSES.index("silent")
_NONE = HAZARDS.index("none")
_TOLD = tuple(RESPONSES.index(response) for response in TOLD)

Outcomes = Mapping[str, Any]
"""Columns by name, arrays [rows]."""


class Response(NamedTuple):
    """The response of the checks in each run, arrays [rows]."""

    response: np.ndarray  # index in RESPONSES
    cause: np.ndarray  # index in `causes`
    ms: np.ndarray  # first time of the strongest response; -1: silent
    told_ms: np.ndarray  # first time of an alarm or a stop; -1: none
    causes: tuple[str, ...]  # "" for none, then the cause of each check


def classify_responses(outcomes: Outcomes, golden: Outcomes, robot: Robot) -> Response:
    """Return the response of the checks in each run, compared with its golden run. Checks also trip
    in fault-free motion, for example if a command is clipped. So a check counts only if it tripped
    more often than in the golden run, or sooner. `golden`: columns `check_*_count` and
    `check_*_first_ms` of the golden runs.
    """
    counted = [name for name in checks.check_names(outcomes) if robot.check(name).action != "watch"]
    return _responses(outcomes, golden, robot, counted, None)


def built_in_responses(
    outcomes: Outcomes, golden: Outcomes, robot: Robot, detectors: Iterable[int] = ()
) -> Response:
    """Return the response of the built-in checks alone. A stop by an added check makes built-in
    checks trip too: the software E-stop, then the PLC. So if an added check or detector changed the
    course of a run, only trips before this change count. `detectors`: numbers of detectors that may
    stop the robot; `golden` needs their columns `detector<d>_threshold0_*`.
    """
    names = checks.check_names(outcomes)
    # Columns of the number of trips and of the first trip, of all that may change the course:
    # checks that a user added (`own`) and that act, and detectors that may stop.
    columns = [
        (f"check_{name}_count", f"check_{name}_first_ms")
        for name in names
        if robot.check(name).own and robot.check(name).acts
    ]
    columns += [
        (f"detector{d}_threshold0_alarms", f"detector{d}_threshold0_first_ms") for d in detectors
    ]
    onset, never = np.asarray(outcomes["first_active_ms"]), np.iinfo(np.int32).max
    # Time at which an added check or detector first acted differently than in the golden run, ms.
    # Before its fault a run equals the golden run, so this time is not before the fault.
    changed_ms = np.full(len(onset), never)
    for count_column, ms_column in columns:
        count, ms = np.asarray(outcomes[count_column]), np.asarray(outcomes[ms_column])
        same = (count == np.asarray(golden[count_column])) & (ms == np.asarray(golden[ms_column]))
        earliest_ms = np.minimum(changed_ms, np.maximum(ms, onset))
        changed_ms = np.where(~same & (ms >= 0), earliest_ms, changed_ms)
    built_in = [name for name in names if not robot.check(name).own]
    end_ms = np.where(changed_ms < never, changed_ms, -1)
    return _responses(outcomes, golden, robot, built_in, end_ms)


def _responses(
    outcomes: Outcomes, golden: Outcomes, robot: Robot, names: list[str], end_ms: np.ndarray | None
) -> Response:
    # Returns the response of the checks `names`. end_ms: [rows] last time at which a trip counts;
    # -1 or None: all trips count. A check that also trips because another check stopped the robot
    # (`Check.follows`) must trip before this time.
    onset = np.asarray(outcomes["first_active_ms"])
    response = np.full(len(onset), SILENT, np.int8)
    cause = np.zeros(len(onset), np.int8)
    response_ms, told_ms = np.full((2, len(onset)), -1, np.int32)
    for number, name in enumerate(names, start=1):
        rank = RESPONSES.index(robot.check(name).response)
        count_column, ms_column = f"check_{name}_count", f"check_{name}_first_ms"
        count, golden_count = np.asarray(outcomes[count_column]), np.asarray(golden[count_column])
        ms, golden_ms = np.asarray(outcomes[ms_column]), np.asarray(golden[ms_column])
        # This shortcut applies to most checks.
        if np.array_equal(count, golden_count) and np.array_equal(ms, golden_ms):
            continue
        sooner = beyond_golden(ms, golden_ms) >= 0
        is_response = (count > golden_count) | sooner
        # If only the count is higher, the first trip may equal that of the golden run. The time of
        # the added trip is unknown, but it is not before the fault.
        ms = np.where(sooner, ms, np.maximum(ms, onset))
        if end_ms is not None:
            is_in_time = ms < end_ms if robot.check(name).follows else ms <= end_ms
            is_response &= (end_ms < 0) | is_in_time
        # A smaller rank is a stronger response.
        stronger = is_response & ((response > rank) | ((response == rank) & (ms < response_ms)))
        response[stronger] = rank
        cause[stronger] = number
        response_ms[stronger] = ms[stronger]
        # A person notices a stop or an alarm.
        if rank in _TOLD:
            earlier = is_response & ((told_ms < 0) | (ms < told_ms))
            told_ms[earlier] = ms[earlier]
    causes = ("", *(robot.check(name).named_cause for name in names))
    return Response(response, cause, response_ms, told_ms, causes)


def classify_hazards(outcomes: Any, stopped: np.ndarray) -> np.ndarray:
    """Return the gravest hazard of each run as an index in HAZARDS. `outcomes`: columns
    unintended_first_ms, loss_first_ms, false_report_first_ms, halted_ms, golden_halted_ms.
    `stopped`: bool [rows], True if a check stopped the robot.
    """
    unintended, loss, false_report = (
        np.asarray(outcomes[f"{name}_first_ms"]) >= 0
        for name in ("unintended", "loss", "false_report")
    )
    halted_ms = np.asarray(outcomes["halted_ms"])
    loss |= is_halt(halted_ms, np.asarray(outcomes["golden_halted_ms"]), stopped)
    # The first condition that is true decides, in the order of HAZARDS.
    return np.select([unintended, loss, false_report], range(3), _NONE).astype(np.int8)


def is_halt(halted_ms: Any, golden_halted_ms: Any, stopped: Any) -> Any:
    """Return whether a run has a loss of motion because the robot was not live for too long.
    halted_ms, golden_halted_ms: time in which the robot was not live although the operator held the
    pedal down, in the run and in its golden run, ms. stopped: True if a check stopped the robot,
    which is no loss of motion. All arguments are numbers or arrays [rows].
    """
    return (halted_ms - golden_halted_ms > HALT_MS) & np.logical_not(stopped)


def beyond_golden(first_ms: Any, golden_first_ms: Any) -> np.ndarray:
    """Return the time [rows] of an event in ms; -1 if the event never occurs, or if it had occurred
    in the golden run by that time. A time of -1 in the arguments means that the event never occurs.
    """
    ms, golden_ms = np.asarray(first_ms), np.asarray(golden_first_ms)
    return np.where((ms >= 0) & ~((golden_ms >= 0) & (golden_ms <= ms)), ms, -1)


def classify_verdicts(
    response: np.ndarray, hazard: np.ndarray, cue: np.ndarray, valid: np.ndarray
) -> np.ndarray:
    """Return the verdict of each run as an index in (*VERDICTS, ""); "" if the run is not valid.
    response, hazard: indices in RESPONSES and HAZARDS. cue: bool, True for a cue that the golden
    run does not have. valid: bool. All arrays are [rows].
    """
    # The index of "cue" in CUES is 0.
    index = (response.astype(np.int16) * len(HAZARDS) + hazard) * len(CUES) + ~cue
    return np.where(valid, index, len(VERDICTS))
