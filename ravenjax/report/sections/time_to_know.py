"""Charts of time: how soon the cue comes and a check tells, and which comes first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.document.chart import Bars, Chart, ChartAxis, round_values
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.drawing import incidence_curve, log_time, points, share_axis
from ravenjax.report.sections import Section, answers, tables
from ravenjax.stats.latency import Incidence, incidence

BINS = 60


def incidence_curves(runs: Runs, known: Incidence) -> tuple[Chart | None, dict[str, Any]]:
    """Chart of how soon the cue comes and a check tells after the fault's first effect, and its
    numbers; of one run of each fault. None where no fault had an effect.

    known: of the delay until anyone could know of an unintended motion.
    """
    numbers: dict[str, Any] = {}
    for key, column in (("cue", "warned_ms"), ("told", "told_ms")):
        delays, early = tables.delays(runs, column)
        numbers[key] = {"curve": incidence(delays), "early": early}
    named = (
        ("haptic cue", CUE, numbers["cue"]["curve"]),
        ("check that tells a person or stops", RESPONSE, numbers["told"]["curve"]),
        ("anyone, of unintended motions", SAME, known),
    )
    end_ms = runs.manifest.duration_ms
    curves = [
        incidence_curve(
            one, f"{name} ({one.events:,} of {one.n:,})", colour, end_ms, runs.sampled()
        )
        for name, colour, one in named
        if one.n
    ]
    if not curves:
        return None, numbers
    share = share_axis("share of faults", curves)
    return Chart("How soon", log_time(end_ms), share, tuple(curves)), numbers


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
    edges = np.array(round_values(lead.min(), lead.max() + 1, BINS, whole=True))
    marks, below = [], np.zeros(len(edges) - 1)
    for name, colour, part in (
        ("check first", RESPONSE, lead < 0),
        ("cue first", CUE, lead > 0),
        ("same millisecond", SAME, lead == 0),
    ):
        heights, _ = np.histogram(lead[part], edges, weights=count[part])
        filled = heights > 0
        low, high, base = edges[:-1][filled], edges[1:][filled], below[filled]
        below = below + heights
        where = [
            "0 ms" if name == "same millisecond" else f"{a:g} to {b:g} ms"
            for a, b in zip(low, high, strict=True)
        ]
        tips = tuple(
            f"{name}: {n:,.0f} runs, {at}" for n, at in zip(heights[filled], where, strict=True)
        )
        label = f"{name} ({heights.sum():,.0f})"
        marks.append(Bars(label, colour, low, high, base, below[filled], tips))
    time = ChartAxis("check minus cue, ms", edges[0], edges[-1], unit="ms", line=0.0)
    most = max(1.05 * float(below.max()), 2.0)
    return Chart("Which first", time, ChartAxis("runs", 0.0, most, whole=True), tuple(marks))


def _content(runs: Runs, _: Path) -> dict[str, Any]:
    curves, timing = incidence_curves(runs, runs.once(answers.knowledge).delay)
    return {
        "curves": curves,
        "timing": timing,
        "curve_csv": {name: points(timing[name]["curve"]) for name in ("cue", "told")},
        "lead": lead_histogram(runs),
    }


SECTIONS = (Section("time", "Time to know", 40, _content),)
