"""Computes response, hazard and verdict of each run from an engine's output, with NumPy.

The docstring of `ravenjax.outcomes` defines these words.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot

PUBLISHED_CUE_MM = 3.0
"""Distance between nominal model and robot at which the published cue fires (IROS 2016)."""

LIMIT_MM = PUBLISHED_CUE_MM
"""Default of a campaign's `[outcomes] limit_mm`: the distance at which a hazard begins."""

HALT_MS = 200
"""Time out of pedal-down that counts as noticeable. The largest visual delay that operators accept
is 150 to 200 ms.

The time is a sum: a flickering pedal is up for a few ms at a time, in which no brake closes, and
for tens of ms in total.
"""

RESPONSES = ("stopped", "flagged", "limited", "silent")
"""What the built-in checks, and added checks that do more than watch, did, strongest first."""

HAZARDS = ("unintended motion", "loss of motion", "false report", "none")
"""What became of the motion, gravest first."""

CUES = ("cue", "no cue")

VERDICTS = tuple(
    f"{response}/{hazard}/{cue}" for response in RESPONSES for hazard in HAZARDS for cue in CUES
)

TOLD = ("stopped", "flagged")
"""Responses that a person learns of."""

UNTOLD = ("limited", "silent")
"""Responses that nobody learns of."""

SILENT = RESPONSES.index("silent")
_NONE = HAZARDS.index("none")
_TOLD = tuple(RESPONSES.index(response) for response in TOLD)

Outcomes = Mapping[str, Any]
"""Columns by name, arrays [rows]."""


class Response(NamedTuple):
    """What the checks did, arrays [rows]."""

    response: np.ndarray  # index of RESPONSES
    cause: np.ndarray  # index of `causes`
    ms: np.ndarray  # when first, of the strongest kind; -1: silent
    told_ms: np.ndarray  # time of the first flag or stop; -1: none
    causes: tuple[str, ...]  # "" for none, then the cause of each check


def classify_responses(outcomes: Outcomes, golden: Outcomes, robot: Robot) -> Response:
    """Return what the checks did in each run beyond what they did in its golden run.

    Checks trip on fault-free motion too: a command is clipped, or the first packet of a stream is
    lost. A check counts only if it tripped more often than in the golden run, or first tripped
    sooner. `golden`: its `check_*_count` and `check_*_first_ms`.
    """
    counted = [name for name in checks.check_names(outcomes) if robot.check(name).action != "watch"]
    return _responses(outcomes, golden, robot, counted, None)


def built_in_responses(
    outcomes: Outcomes, golden: Outcomes, robot: Robot, detectors: Iterable[int] = ()
) -> Response:
    """Return what the built-in checks did. In a run whose course an added part changed, only their
    actions before that change count.

    `detectors`: numbers of those that may stop the robot; `golden` has their
    `detector<d>_threshold0_*`. A stop by an added check makes built-in checks trip too: the
    software E-stop, then the PLC. Only a run without that part shows what the robot would have done
    without it. Trips before the change would have come anyway.
    """
    names = checks.check_names(outcomes)
    added = [
        (f"check_{name}_count", f"check_{name}_first_ms")
        for name in names
        if robot.check(name).own and robot.check(name).acts
    ]
    added += [
        (f"detector{d}_threshold0_alarms", f"detector{d}_threshold0_first_ms") for d in detectors
    ]
    onset, never = np.asarray(outcomes["first_active_ms"]), np.iinfo(np.int32).max
    acted = np.full(len(onset), never)  # ms, when an added part left the golden run's course
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
    """Return what these checks did.

    `until`: ms [rows] of the last trips that count (those of `follows` before it); -1: all.
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
        # True for most checks
        if np.array_equal(count, usual_count) and np.array_equal(ms, usual_ms):
            continue
        sooner = beyond_golden(ms, usual_ms) >= 0
        more = (count > usual_count) | sooner
        # If the golden run had tripped by then, the first trip may precede the fault. The response
        # may not.
        ms = np.where(sooner, ms, np.maximum(ms, onset))
        if until is not None:
            more = more & ((until < 0) | (ms < until + (not robot.check(name).follows)))
        stronger = more & ((response > rank) | ((response == rank) & (ms < first)))
        response[stronger], cause[stronger], first[stronger] = rank, place, ms[stronger]
        if rank in _TOLD:
            earlier = more & ((alarm < 0) | (ms < alarm))
            alarm[earlier] = ms[earlier]
    return Response(
        response, cause, first, alarm, ("", *(robot.check(name).named_cause for name in names))
    )


def classify_hazards(outcomes: Any, stopped: np.ndarray) -> np.ndarray:
    """Return the gravest hazard of each run as an index of HAZARDS.

    `outcomes`: unintended_first_ms, loss_first_ms, false_report_first_ms, halted_ms,
    golden_halted_ms. `stopped`: bool [rows], True if a check stopped the robot.
    """
    names = ("unintended", "loss", "false_report")
    came = [np.asarray(outcomes[f"{name}_first_ms"]) >= 0 for name in names]
    halted, golden = (np.asarray(outcomes[f"{of}halted_ms"]) for of in ("", "golden_"))
    came[1] |= is_halt(halted, golden, stopped)
    return np.select(came, range(3), _NONE).astype(np.int8)


def is_halt(halted_ms: Any, golden_halted_ms: Any, stopped: Any) -> Any:
    """Return whether the time out of pedal-down with the pedal held is a loss of motion: bool,
    arrays [rows] or numbers.

    `stopped`: a check stopped the robot.
    """
    return (halted_ms - golden_halted_ms > HALT_MS) & np.logical_not(stopped)


def beyond_golden(first_ms: Any, golden_first_ms: Any) -> np.ndarray:
    """Return the time [rows] of an event's beginning; -1: never, or in the golden run by then."""
    here, golden = np.asarray(first_ms), np.asarray(golden_first_ms)
    return np.where((here >= 0) & ~((golden >= 0) & (golden <= here)), here, -1)


def classify_verdicts(
    response: np.ndarray, hazard: np.ndarray, cue: np.ndarray, valid: np.ndarray
) -> np.ndarray:
    """Return the verdict of each run as an index of (*VERDICTS, ""); "" if it has no valid outcome.
    `cue`: bool, beyond the golden run.
    """
    place = (response.astype(np.int16) * len(HAZARDS) + hazard) * len(CUES) + ~cue
    return np.where(valid, place, len(VERDICTS))
