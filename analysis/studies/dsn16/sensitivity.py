"""What each open question of the targeted attacks is worth: every variant beside the baseline,
cell by cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from studies.dsn16 import cells as dsn16_cells
from studies.dsn16.cells import DURATIONS
from studies.dsn16.runs import VariantRuns
from studies.framework.study import Table

NOTE = (
    "Points are means over all cells of the fixed grid, each variant's cell against the same cell"
    " of the baseline. A cell changes where at least half of its runs come out the other way."
)

INSIDE = "jumps only inside t1 .. t1 + d + 1"
"""The published window of a fault that begins in packet t1 and lasts d."""


class VariantCase(NamedTuple):
    """One way to answer the open questions."""

    runs: VariantRuns
    question: str
    hit: str = "jump"  # column of the runs that is counted
    label: str = ""  # where it is not the variant's name

    @property
    def name(self) -> str:
        """As it stands in tables."""
        return self.label or self.runs.name


def rules(base: VariantRuns, leaps: np.ndarray) -> list[VariantCase]:
    """The baseline's own runs with other rules of what a jump is; leaps: bool [runs], the
    text's.
    """
    return [
        VariantCase(base, INSIDE, "inside", "inside_window"),
        VariantCase(
            base.counting(leap=leaps),
            "text's rule: the tip moves over 1 mm within two packets",
            "leap",
            "jump_text",
        ),
    ]


def shifts(case: VariantCase, baseline: VariantRuns, hit: str = "jump") -> tuple[float, int]:
    """Mean difference to the baseline over all cells, in points, and how many cells change sides.

    NaN and 0 where the two have different numbers of cells.
    """
    cells, base = case.runs.share(case.hit).by_size, baseline.share(hit).by_size
    if cells.shape != base.shape:
        return math.nan, 0
    return 100.0 * float((cells - base).mean()), int(((cells >= 0.5) != (base >= 0.5)).sum())


def table(
    title: str,
    cases: Sequence[VariantCase],
    baseline: VariantRuns,
    published: np.ndarray | None = None,
    bands: Sequence[tuple[float, float]] | None = None,
    reading_error: float = 0.0,
    hit: str = "jump",
    note: str = "",
) -> Table:
    """Percent by duration of each case, and its distance from the baseline and, where it is
    given, the publication.
    """
    heads = [
        "variant",
        "open question answered otherwise",
        "lever",
        *(f"{d} packets" for d in DURATIONS),
    ]
    heads += ["cells changed", "points from baseline"]
    if published is not None:
        heads += ["points from publication", "above / below", "sign test p"]
    if bands is not None:
        heads += ["in band"]
    rows = []
    if published is not None:
        rows.append(
            (
                "published",
                "",
                "",
                *(round(float(p), 1) for p in published),
                *("",) * (len(heads) - 11),
            )
        )
    for case in cases:
        percent = case.runs.percent(case.hit)
        apart, changed = shifts(case, baseline, hit)
        row: list[str | int | float] = [case.name, case.question, case.runs.lever.words]
        row += [round(float(p), 1) for p in percent]
        row += [changed, _points(apart)]
        if published is not None:
            sign = dsn16_cells.bias(percent, published, reading_error)
            row += [
                f"{float(np.mean(percent - published)):+.1f}",
                f"{sign.above} / {sign.below}",
                round(sign.p, 3),
            ]
        if bands is not None:
            row += [
                f"{sum(dsn16_cells.in_band(p, b) for p, b in zip(percent, bands, strict=True))} of"
                f" {len(bands)}"
            ]
        rows.append(tuple(row))
    return Table(title, tuple(heads), tuple(rows), note)


def _points(apart: float) -> str:
    if math.isnan(apart):
        return ""
    points = round(apart, 1)
    return f"{points:+.1f}" if points else "0"


def ranked(cases: Iterable[VariantCase], baseline: VariantRuns) -> list[tuple[str, float, int]]:
    """Name, mean difference in points and changed cells of each case, the largest difference
    first.
    """
    differences = [(case.name, *shifts(case, baseline)) for case in cases]
    return sorted((f for f in differences if not math.isnan(f[1])), key=lambda f: -abs(f[1]))
