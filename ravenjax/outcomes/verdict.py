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

A flickering pedal is up for tens of ms in total, but only for a few ms at a time, so that no brake
closes.
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
    """Return the response of the checks in each run, compared with its golden run.

    Checks also trip in fault-free motion, for example if a command is clipped. So a check counts
    only if it tripped more often than in the golden run, or sooner. `golden`: columns
    `check_*_count` and `check_*_first_ms` of the golden runs.
    """
    counted = [name for name in checks.check_names(outcomes) if robot.check(name).action != "watch"]
    return _responses(outcomes, golden, robot, counted, None)


def built_in_responses(
    outcomes: Outcomes, golden: Outcomes, robot: Robot, detectors: Iterable[int] = ()
) -> Response:
    """Return the response of the built-in checks alone.

    A stop by an added check makes built-in checks trip too: the software E-stop, then the PLC. So
    if an added check or detector changed the course of a run, only trips before this change count.
    `detectors`: numbers of detectors that may stop the robot; `golden` needs their columns
    `detector<d>_threshold0_*`.
    """
    names = checks.check_names(outcomes)
    acting = [name for name in names if robot.check(name).own and robot.check(name).acts]
    added = [(f"check_{name}_count", f"check_{name}_first_ms") for name in acting]
    levels = [f"detector{d}_threshold0" for d in detectors]
    added += [(f"{level}_alarms", f"{level}_first_ms") for level in levels]
    onset, never = np.asarray(outcomes["first_active_ms"]), np.iinfo(np.int32).max
    # Time at which an added check or detector first acted differently than in the golden run, ms.
    acted = np.full(len(onset), never)
    for often, when in added:
        count, ms = np.asarray(outcomes[often]), np.asarray(outcomes[when])
        otherwise = (count != np.asarray(golden[often])) | (ms != np.asarray(golden[when]))
        acted = np.where(otherwise & (ms >= 0), np.minimum(acted, np.maximum(ms, onset)), acted)
    built_in = [name for name in names if not robot.check(name).own]
    until = np.where(acted < never, acted, -1)
    return _responses(outcomes, golden, robot, built_in, until)


def _responses(
    outcomes: Outcomes, golden: Outcomes, robot: Robot, names: list[str], until: np.ndarray | None
) -> Response:
    """Return the response of the checks `names`.

    `until`: ms [rows], last time at which trips count (with `follows`: before it); -1: all count.
    """
    onset = np.asarray(outcomes["first_active_ms"])
    response = np.full(len(onset), SILENT, np.int8)
    cause = np.zeros(len(onset), np.int8)
    first, alarm = np.full((2, len(onset)), -1, np.int32)
    for place, name in enumerate(names, start=1):
        rank = RESPONSES.index(robot.check(name).response)
        (count, ms), (usual_count, usual_ms) = (
            [np.asarray(columns[f"check_{name}_{what}"]) for what in ("count", "first_ms")]
            for columns in (outcomes, golden)
        )
        # This shortcut applies to most checks.
        if np.array_equal(count, usual_count) and np.array_equal(ms, usual_ms):
            continue
        sooner = beyond_golden(ms, usual_ms) >= 0
        more = (count > usual_count) | sooner
        # The first trip may be that of the golden run, but the response is not before the fault.
        ms = np.where(sooner, ms, np.maximum(ms, onset))
        if until is not None:
            more = more & ((until < 0) | (ms < until + (not robot.check(name).follows)))
        stronger = more & ((response > rank) | ((response == rank) & (ms < first)))
        response[stronger], cause[stronger], first[stronger] = rank, place, ms[stronger]
        if rank in _TOLD:
            earlier = more & ((alarm < 0) | (ms < alarm))
            alarm[earlier] = ms[earlier]
    causes = "", *(robot.check(name).named_cause for name in names)
    return Response(response, cause, first, alarm, causes)


def classify_hazards(outcomes: Any, stopped: np.ndarray) -> np.ndarray:
    """Return the gravest hazard of each run as an index in HAZARDS.

    `outcomes`: columns unintended_first_ms, loss_first_ms, false_report_first_ms, halted_ms,
    golden_halted_ms. `stopped`: bool [rows], True if a check stopped the robot.
    """
    names = ("unintended", "loss", "false_report")
    came = [np.asarray(outcomes[f"{name}_first_ms"]) >= 0 for name in names]
    halted, golden = (np.asarray(outcomes[f"{of}halted_ms"]) for of in ("", "golden_"))
    came[1] |= is_halt(halted, golden, stopped)
    return np.select(came, range(3), _NONE).astype(np.int8)


def is_halt(halted_ms: Any, golden_halted_ms: Any, stopped: Any) -> Any:
    """Return whether a run lost motion by a halt while the pedal was down; bool or arrays [rows].

    `stopped`: True if a check stopped the robot; this is no loss of motion.
    """
    return (halted_ms - golden_halted_ms > HALT_MS) & np.logical_not(stopped)


def beyond_golden(first_ms: Any, golden_first_ms: Any) -> np.ndarray:
    """Return the time [rows] of an event; -1: never, or not later than in the golden run."""
    here, golden = np.asarray(first_ms), np.asarray(golden_first_ms)
    return np.where((here >= 0) & ~((golden >= 0) & (golden <= here)), here, -1)


def classify_verdicts(
    response: np.ndarray, hazard: np.ndarray, cue: np.ndarray, valid: np.ndarray
) -> np.ndarray:
    """Return the verdict of each run as an index in (*VERDICTS, ""); "" if the run is not valid.

    `cue`: bool [rows], a cue that the golden run does not have.
    """
    place = (response.astype(np.int16) * len(HAZARDS) + hazard) * len(CUES) + ~cue
    return np.where(valid, place, len(VERDICTS))
