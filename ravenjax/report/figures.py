"""Figures of time: how soon cue and built-in response come, and which comes first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ravenjax.figure_style import GRID, json_of, look
from ravenjax.report import tables
from ravenjax.report.counted import incidence
from ravenjax.report.facts import FACTS
from ravenjax.report.runs import Runs
from ravenjax.report.style import CUE, RESPONSE, SAME, band, round_step, stepped, thinned
from ravenjax.stats.latency import Incidence
from ravenjax.store.manifest import Manifest

HEIGHT = 360  # px
BINS = 40


def incidence_curves(runs: Runs, manifest: Manifest) -> tuple[str, dict[str, Any]]:
    """Figure of how soon cue and built-in response come after the fault's first effect, and its numbers."""
    share = {"title": {"text": "share of activated faults"}, "tickformat": ".0%", "rangemode": "tozero"}
    layout = look(HEIGHT) | {"xaxis": log_time(), "yaxis": share | {"gridcolor": GRID, "zeroline": False}}
    traces: list[dict[str, Any]] = []
    numbers: dict[str, Any] = {}
    for key, name, column, colour in (
        ("cue", "haptic cue", "cue_ms", CUE),
        ("response", "built-in response", "response_ms", RESPONSE),
    ):
        found, early = tables.delays(runs, column, manifest.duration_ms)
        curve = incidence(found)
        numbers[key] = {"curve": curve, "early": early, "quarter": curve.quantile(0.25), "half": curve.quantile(0.5)}
        traces += _curve(curve, name, colour, manifest.duration_ms)
    return json_of(traces, layout), numbers


def points(curve: Incidence) -> list[dict[str, float]]:
    """A curve point by point, thinned as it is drawn."""
    kept = thinned(len(curve.time))
    columns = (curve.time[kept], curve.fraction[kept], curve.low[kept], curve.high[kept])
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [dict(zip(("ms", "share", "low", "high"), row, strict=True)) for row in rows]


def log_time() -> dict[str, Any]:
    """Axis of delays after a fault's first effect."""
    return {
        "title": {"text": "time after the fault's first effect, ms"},
        "type": "log",
        "tickvals": [1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 30_000],
        "gridcolor": GRID,
        "zeroline": False,
    }


def _curve(curve: Incidence, name: str, colour: str, end_ms: int) -> list[dict[str, Any]]:
    drawn = stepped(curve, end_ms, start=1.0)  # a log axis has no zero: the first tick stands for it
    line = {
        "type": "scatter",
        "mode": "lines",
        "x": drawn["x"].tolist(),
        "y": drawn["y"].tolist(),
        "name": f"{name} ({curve.events:,} of {curve.n:,})",
        "line": {"color": colour, "width": 2.2, "shape": "hv"},
        "hovertemplate": f"{name} by %{{x:.0f}} ms: %{{y:.1%}}<extra></extra>",
    }
    return [band(drawn["x"], drawn["low"], drawn["high"], colour, "hv"), line]


def lead_histogram(runs: Runs) -> str | None:
    """Figure of response time minus cue time where both came; None where they never both did.

    Runs in which both came in the same millisecond stand in grey on those of the bin from 0 in which the cue was first.
    """
    found = runs.table.frame(
        f"SELECT response_ms - cue_ms AS lead, count(*) AS runs FROM {FACTS} "
        "WHERE faulty AND NOT failed AND cue_ms >= 0 AND response_ms >= 0 GROUP BY lead ORDER BY lead"
    )
    if found.empty:
        return None
    lead, count = found["lead"].to_numpy(float), found["runs"].to_numpy()
    step = max(1.0, round_step((lead.max() - lead.min()) / BINS))  # ms, at least the tick
    edges = np.arange(math.floor(lead.min() / step), math.floor(lead.max() / step) + 2) * step
    layout = look(HEIGHT) | {
        "bargap": 0.06,
        "barmode": "stack",
        "xaxis": {
            "title": {"text": "built-in response minus cue, ms"},
            "zeroline": True,
            "zerolinecolor": "rgba(128,128,128,0.8)",
            "showgrid": False,
        },
        "yaxis": {"title": {"text": "runs"}, "gridcolor": GRID},
    }
    parts = (
        ("response first", RESPONSE, lead < 0),
        ("cue first", CUE, lead > 0),
        ("same millisecond", SAME, lead == 0),
    )
    traces = [_bars(name, colour, lead[chosen], count[chosen], edges) for name, colour, chosen in parts]
    return json_of(traces, layout)


def _bars(name: str, colour: str, leads: np.ndarray, runs: np.ndarray, edges: np.ndarray) -> dict[str, Any]:
    counts, _ = np.histogram(leads, edges, weights=runs)
    filled = counts > 0
    low, high = edges[:-1][filled], edges[1:][filled]
    told = ["0 ms" if name == "same millisecond" else f"{a:g} to {b:g} ms" for a, b in zip(low, high, strict=True)]
    return {
        "type": "bar",
        "name": f"{name} ({runs.sum():,})",
        "x": ((low + high) / 2).tolist(),
        "y": counts[filled].tolist(),
        "width": (edges[1] - edges[0]) * 0.94,
        "marker": {"color": colour},
        "customdata": told,
        "hovertemplate": f"{name}: %{{y}} runs<br>%{{customdata}}<extra></extra>",
    }
