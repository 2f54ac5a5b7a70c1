"""Figures of time: how soon cue and built-in response come, and which comes first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from ravenjax.report import tables
from ravenjax.report.style import CUE, GRID, RESPONSE, faded, json_of, look, round_step
from ravenjax.stats.latency import Incidence, incidence
from ravenjax.store.manifest import Manifest


def incidence_curves(facts: pd.DataFrame, manifest: Manifest) -> tuple[str, dict[str, Any]]:
    """Figure of how soon cue and built-in response come after the fault's first effect, and its numbers."""
    figure = go.Figure(layout=look(360))
    figure.update_layout(xaxis=_log_time(), yaxis={"title": "share of activated faults", "tickformat": ".0%"})
    figure.update_yaxes(rangemode="tozero", gridcolor=GRID, zeroline=False)
    numbers: dict[str, Any] = {}
    for key, name, column, colour in (
        ("cue", "haptic cue", "cue_ms", CUE),
        ("response", "built-in response", "response_ms", RESPONSE),
    ):
        delay, came, early = tables.delays(facts, facts[column].to_numpy(), manifest.duration_ms)
        curve = incidence(delay, came)
        numbers[key] = {"curve": curve, "early": early, "quarter": curve.quantile(0.25), "half": curve.quantile(0.5)}
        for trace in _curve(curve, name, colour, manifest.duration_ms):
            figure.add_trace(trace)
    return json_of(figure), numbers


def _log_time() -> dict[str, Any]:
    ticks = [1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 30_000]
    return {
        "title": "time after the fault's first effect, ms",
        "type": "log",
        "tickvals": ticks,
        "gridcolor": "rgba(128,128,128,0.12)",
        "zeroline": False,
    }


def _curve(curve: Incidence, name: str, colour: str, end_ms: int) -> list[go.Scatter]:
    time = np.maximum(np.append(curve.time, end_ms), 1.0)  # a log axis has no zero: the first tick stands for it

    def held(values: np.ndarray) -> np.ndarray:
        return np.append(values, values[-1])

    band = go.Scatter(
        x=np.concatenate([time, time[::-1]]),
        y=np.concatenate([held(curve.high), held(curve.low)[::-1]]),
        fill="toself",
        fillcolor=faded(colour),
        line={"width": 0, "shape": "hv"},
        hoverinfo="skip",
        showlegend=False,
    )
    line = go.Scatter(
        x=time,
        y=held(curve.fraction),
        name=f"{name} ({curve.events:,} of {curve.n:,})",
        line={"color": colour, "width": 2.2, "shape": "hv"},
        hovertemplate=f"{name} by %{{x:.0f}} ms: %{{y:.1%}}<extra></extra>",
    )
    return [band, line]


def lead_histogram(facts: pd.DataFrame) -> str | None:
    """Figure of response time minus cue time where both came; None where they never both did."""
    both = facts.loc[facts["faulty"] & ~facts["failed"] & (facts["cue_ms"] >= 0) & (facts["response_ms"] >= 0)]
    if both.empty:
        return None
    lead = (both["response_ms"] - both["cue_ms"]).to_numpy(float)
    step = max(1.0, round_step((lead.max() - lead.min()) / 40))  # ms, at least the tick
    edges = np.arange(math.floor(lead.min() / step), math.floor(lead.max() / step) + 2) * step
    counts, _ = np.histogram(lead, edges)
    middle = (edges[:-1] + edges[1:]) / 2
    figure = go.Figure(layout=look(360))
    figure.update_layout(
        bargap=0.06,
        showlegend=False,
        xaxis={"title": "built-in response minus cue, ms", "zeroline": True, "zerolinecolor": "rgba(128,128,128,0.8)"},
        yaxis={"title": "runs", "gridcolor": GRID},
    )
    first = np.where(middle > 0, "cue first", "response first")
    figure.add_trace(
        go.Bar(
            x=middle,
            y=counts,
            width=step,
            marker_color=[CUE if m > 0 else RESPONSE for m in middle],
            customdata=np.stack([edges[:-1], edges[1:], first], axis=1, dtype=object).tolist(),
            hovertemplate="%{customdata[2]}: %{y} runs<br>%{customdata[0]} to %{customdata[1]} ms<extra></extra>",
        )
    )
    for x, text, colour, anchor in ((0.01, "response first", RESPONSE, "left"), (0.99, "cue first", CUE, "right")):
        figure.add_annotation(
            x=x, y=1.07, xref="paper", yref="paper", text=text, showarrow=False, font_color=colour, xanchor=anchor
        )
    return json_of(figure)
