"""What the text of the publication says in words, as lines that hold or do not; each says how it
was made countable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.dsn16.cells import DURATIONS
from studies.dsn16.runs import VariantRuns, stored
from studies.framework.study import Line, StudyEstimate

SMALL_COUNTS = 800
"""DAC: on the published trajectory the nominal shoulder command stays within it (comment in the
fork's code).
"""
LARGE_COUNTS = 10000
"""DAC: what the fork's own check lets pass to the shoulder."""


HOLDS = " (1: holds)"
"""How the quantity of a statement ends."""


def holds(quantity: str, published: bool | None, predicted: bool, reason: str) -> Line:
    """A statement: 1 holds, 0 does not. published: whether the published counts bear it out,
    None: there are none.
    """
    stated = StudyEstimate(
        1.0,
        of="stated" if published is None else f"stated; in the published counts: {int(published)}",
    )
    return Line(
        f"{quantity}{HOLDS}", "", stated, StudyEstimate(float(predicted)), (1.0, 1.0), "", reason
    )


def scenario_b(
    runs: VariantRuns, moved: np.ndarray, jumps: np.ndarray, stops: np.ndarray
) -> tuple[Line, ...]:
    """The four statements on scenario B.

    moved: [runs] largest step of motor velocity in the window over its fault-free 99.9 % threshold.
    jumps, stops: published percent by duration.
    """
    size, duration = np.abs([stored(value) for value in runs.value]), runs.duration
    jumped = runs.hits["jump"]
    affected = jumped | runs.hits["stop"]
    small = (size <= SMALL_COUNTS) & (duration <= 64)
    short = (size <= LARGE_COUNTS) & ((duration == 2) | (duration == 4))
    disturbed = float((moved[short] > 1.0).mean())
    return (
        holds(
            "small DAC errors have no effect unless held longer than 64 ms",
            None,
            not affected[small].any(),
            f"{int(affected[small].sum())} of {int(small.sum())} runs of up to {SMALL_COUNTS}"
            " counts and 64 packets jump or stop",
        ),
        holds(
            "2-4 ms bursts disturb motor velocity but not positions, unless large",
            None,
            disturbed > 0.5 and not jumped[short].any(),
            f"of runs of up to {LARGE_COUNTS} counts and 2 or 4 packets {100 * disturbed:.0f} %"
            " move the motor velocity beyond its fault-free 99.9 percentile,"
            f" {100 * jumped[short].mean():.0f} % jump",
        ),
        *of_attack(runs, jumps, stops),
    )


def of_attack(
    runs: VariantRuns, jumps: np.ndarray | None = None, stops: np.ndarray | None = None
) -> tuple[Line, ...]:
    """The two statements on either scenario; jumps, stops: published percent by duration, None
    where withheld.
    """
    jumped, stopped, missed = (runs.percent(hit) for hit in ("jump", "stop", "missed"))
    window = np.isin(DURATIONS, (2, 4, 8, 16))
    open_at = [d for d, share in zip(DURATIONS, missed, strict=True) if share > 0]
    lower = opened = None
    beside = ""
    if jumps is not None and stops is not None:
        lower = bool((stops <= jumps).all())
        opened = bool((jumps[window] > 0).all())
        beside = f"; published {_listed(stops - jumps)}"
    return (
        holds(
            "P(RAVEN detects) is lower than P(impact) at every duration",
            lower,
            bool((stopped <= jumped).all()),
            f"E-stop minus jump by duration, points: predicted {_listed(stopped - jumped)}{beside}",
        ),
        holds(
            "the attacker's undetected window is 2-16 ms",
            opened,
            bool((missed[window] > 0).all()),
            "counted as: at each of 2, 4, 8 and 16 packets some runs jump without an E-stop;"
            f" predicted for {', '.join(map(str, open_at)) or 'no'} packets, by duration"
            f" {_listed(missed)} %",
        ),
    )


def verdict(scenario: str, lines: Sequence[Line]) -> str:
    """How a scenario fares against what the text states, in words; lines without a verdict do
    not count.
    """
    judged = [line for line in lines if line.passed is not None]
    fail = [line.quantity.removesuffix(HOLDS) for line in judged if not line.passed]
    if not fail:
        return (
            f"{scenario} is as the text states it: {len(judged)} of {len(judged)} statements hold."
        )
    return (
        f"{scenario} is not reproduced: {len(judged) - len(fail)} of {len(judged)} statements hold."
        f" The prediction contradicts that {'; that '.join(fail)}."
    )


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.0f}" for x in numbers)
