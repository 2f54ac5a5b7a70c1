"""Figures of time: how soon cue and built-in response come, and which comes first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.report import tables
from ravenjax.report.style import CUE, GRID, RESPONSE, SAME, faded, json_of, look, round_step
from ravenjax.stats.latency import Incidence, incidence
from ravenjax.store.manifest import Manifest

HEIGHT = 360  # px
BINS = 40


def incidence_curves(facts: pd.DataFrame, manifest: Manifest) -> tuple[str, dict[str, Any]]:
    """Figure of how soon cue and built-in response come after the fault's first effect, and its numbers."""
    share = {"title": {"text": "share of activated faults"}, "tickformat": ".0%", "rangemode": "tozero"}
    layout = look(HEIGHT) | {"xaxis": _log_time(), "yaxis": share | {"gridcolor": GRID, "zeroline": False}}
    traces: list[dict[str, Any]] = []
    numbers: dict[str, Any] = {}
    for key, name, column, colour in (
        ("cue", "haptic cue", "cue_ms", CUE),
        ("response", "built-in response", "response_ms", RESPONSE),
    ):
        delay, came, early = tables.delays(facts, facts[column].to_numpy(), manifest.duration_ms)
        curve = incidence(delay, came)
        numbers[key] = {"curve": curve, "early": early, "quarter": curve.quantile(0.25), "half": curve.quantile(0.5)}
        traces += _curve(curve, name, colour, manifest.duration_ms)
    return json_of(traces, layout), numbers


def _log_time() -> dict[str, Any]:
    return {
        "title": {"text": "time after the fault's first effect, ms"},
        "type": "log",
        "tickvals": [1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 30_000],
        "gridcolor": GRID,
        "zeroline": False,
    }


def _curve(curve: Incidence, name: str, colour: str, end_ms: int) -> list[dict[str, Any]]:
    time = np.maximum(np.append(curve.time, end_ms), 1.0)  # a log axis has no zero: the first tick stands for it

    def held(values: np.ndarray) -> np.ndarray:
        return np.append(values, values[-1]).round(6)

    band = {
        "type": "scatter",
        "x": np.concatenate([time, time[::-1]]).tolist(),
        "y": np.concatenate([held(curve.high), held(curve.low)[::-1]]).tolist(),
        "fill": "toself",
        "fillcolor": faded(colour),
        "line": {"width": 0, "shape": "hv"},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    line = {
        "type": "scatter",
        "mode": "lines",
        "x": time.tolist(),
        "y": held(curve.fraction).tolist(),
        "name": f"{name} ({curve.events:,} of {curve.n:,})",
        "line": {"color": colour, "width": 2.2, "shape": "hv"},
        "hovertemplate": f"{name} by %{{x:.0f}} ms: %{{y:.1%}}<extra></extra>",
    }
    return [band, line]


def lead_histogram(facts: pd.DataFrame) -> str | None:
    """Figure of response time minus cue time where both came; None where they never both did.

    Runs in which both came in the same millisecond stand in grey on those of the bin from 0 in which the cue was first.
    """
    both = facts.loc[facts["faulty"] & ~facts["failed"] & (facts["cue_ms"] >= 0) & (facts["response_ms"] >= 0)]
    if both.empty:
        return None
    lead = (both["response_ms"] - both["cue_ms"]).to_numpy(float)
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
        ("response first", RESPONSE, lead[lead < 0]),
        ("cue first", CUE, lead[lead > 0]),
        ("same millisecond", SAME, lead[lead == 0]),
    )
    return json_of([_bars(name, colour, leads, edges) for name, colour, leads in parts], layout)


def _bars(name: str, colour: str, leads: np.ndarray, edges: np.ndarray) -> dict[str, Any]:
    counts, _ = np.histogram(leads, edges)
    filled = counts > 0
    low, high = edges[:-1][filled], edges[1:][filled]
    told = ["0 ms" if name == "same millisecond" else f"{a:g} to {b:g} ms" for a, b in zip(low, high, strict=True)]
    return {
        "type": "bar",
        "name": f"{name} ({len(leads):,})",
        "x": ((low + high) / 2).tolist(),
        "y": counts[filled].tolist(),
        "width": (edges[1] - edges[0]) * 0.94,
        "marker": {"color": colour},
        "customdata": told,
        "hovertemplate": f"{name}: %{{y}} runs<br>%{{customdata}}<extra></extra>",
    }
