"""Charts of time: how soon the cue comes and a check tells, and which comes first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ravenjax.document.chart import Bars, Chart, ChartAxis, Curve
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.document.steps import steps
from ravenjax.document.ticks import above
from ravenjax.report.bins import round_step
from ravenjax.report.data.counted import incidence
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs, end_of
from ravenjax.report.sections import tables
from ravenjax.stats.latency import Incidence
from ravenjax.store.manifest import Manifest

BINS = 40
FIRST_MS = 1.0
"""Where a logarithmic axis of time begins; times are whole milliseconds."""


def incidence_curves(
    runs: Runs, manifest: Manifest, known: Incidence
) -> tuple[Chart | None, dict[str, Any]]:
    """Chart of how soon the cue comes and a check tells after the fault's first effect, and its
    numbers; of one run of each fault. None where no fault had an effect.

    known: of the delay until anyone could know of an unintended motion.
    """
    curves: list[Curve] = []
    numbers: dict[str, Any] = {}
    for key, name, column, colour in (
        ("cue", "haptic cue", "warned_ms", CUE),
        ("told", "check that tells a person or stops", "told_ms", RESPONSE),
    ):
        delays, early = tables.delays(runs, column, end_of(manifest), "sample")
        curve = incidence(delays)
        numbers[key] = {
            "curve": curve,
            "early": early,
            "quarter": curve.quantile(0.25),
            "half": curve.quantile(0.5),
        }
        if curve.n:
            label = f"{name} ({curve.events:,} of {curve.n:,})"
            curves.append(of_incidence(curve, label, colour, manifest.duration_ms, runs.sampled()))
    if known.n:
        name = f"anyone, of unintended motions ({known.events:,} of {known.n:,})"
        curves.append(of_incidence(known, name, SAME, manifest.duration_ms, runs.sampled()))
    if not curves:
        return None, numbers
    share = share_axis("share of faults", curves)
    return Chart("How soon", log_time(manifest.duration_ms), share, tuple(curves)), numbers


def of_incidence(curve: Incidence, name: str, colour: str, end_ms: int, band: bool = True) -> Curve:
    """The curve of delays on an axis of `log_time`: it begins with the share that came within the
    first millisecond.

    band: with its own; of enumerated faults it has none.
    """
    line = steps(curve.time, curve.fraction, curve.low, curve.high, start=FIRST_MS, end=end_ms)
    return Curve.of(line, name, colour, band)


def points(curve: Incidence) -> list[dict[str, float]]:
    """A curve point by point, as it is drawn, and from 0 ms."""
    line = steps(curve.time, curve.fraction, curve.low, curve.high)
    rows = zip(*(part.tolist() for part in line), strict=True)
    return [dict(zip(("ms", "share", "low", "high"), row, strict=True)) for row in rows]


def log_time(end_ms: int) -> ChartAxis:
    """Axis of delays after a fault's first effect."""
    end = max(float(end_ms), 10 * FIRST_MS)
    return ChartAxis("time after the fault's first effect, ms", FIRST_MS, end, log=True, unit="ms")


def share_axis(title: str, curves: list[Curve]) -> ChartAxis:
    """From 0 to above all curves, at most to 1."""
    most = max((float(curve.y.max()) for curve in curves if len(curve.y)), default=0.0)
    return ChartAxis(title, 0.0, min(1.0, above(1.05 * most)) if most else 1.0, share=True)


def lead_histogram(runs: Runs) -> Chart | None:
    """Chart of the time from the cue to the check that tells, where both came; None where they
    never both did.

    Runs in which both came in the same millisecond stand in grey on those of the bin from 0 in
    which the cue was first.
    """
    rows = runs.table.frame(
        f"SELECT told_ms - warned_ms AS lead, count(*) AS runs FROM {FACTS} "
        "WHERE sample AND faulty AND warned_ms >= 0 AND told_ms >= 0 GROUP BY lead ORDER BY lead"
    )
    if rows.empty:
        return None
    lead, count = rows["lead"].to_numpy(float), rows["runs"].to_numpy()
    step = max(1.0, round_step((lead.max() - lead.min()) / BINS))  # ms, at least the tick
    edges = np.arange(math.floor(lead.min() / step), math.floor(lead.max() / step) + 2) * step
    parts = (
        ("check first", RESPONSE, lead < 0),
        ("cue first", CUE, lead > 0),
        ("same millisecond", SAME, lead == 0),
    )
    marks, below = [], np.zeros(len(edges) - 1)
    for name, colour, part in parts:
        heights, _ = np.histogram(lead[part], edges, weights=count[part])
        marks.append(_bars(name, colour, edges, below, heights))
        below = below + heights
    time = ChartAxis("check minus cue, ms", edges[0], edges[-1], unit="ms", line=0.0)
    most = float(below.max())
    return Chart(
        "Which first",
        time,
        ChartAxis("runs", 0.0, max(above(1.02 * most), 2.0), whole=True),
        tuple(marks),
    )


def _bars(
    name: str, colour: str, edges: np.ndarray, below: np.ndarray, heights: np.ndarray
) -> Bars:
    filled = heights > 0
    low, high, base, top = (
        edges[:-1][filled],
        edges[1:][filled],
        below[filled],
        (below + heights)[filled],
    )
    where = [
        "0 ms" if name == "same millisecond" else f"{a:g} to {b:g} ms"
        for a, b in zip(low, high, strict=True)
    ]
    tips = tuple(
        f"{name}: {n:,.0f} runs, {at}" for n, at in zip(heights[filled], where, strict=True)
    )
    return Bars(f"{name} ({heights.sum():,.0f})", colour, low, high, base, top, tips)
