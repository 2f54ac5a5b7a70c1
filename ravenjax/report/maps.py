"""Maps of evasion: which onsets, durations and magnitudes pass the built-in checks and trip the cue."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ravenjax.report import tables
from ravenjax.report.style import RATE_SCALE, json_of, look, round_step
from ravenjax.stats.intervals import Rate, rate_table

MIN_BINS, MAX_BINS = 4, 8
RUNS_PER_BIN = 8
"""Aimed at in each bin of a two-dimensional map: with fewer, an interval spans most of 0 to 100 %."""
MIN_RUNS = 20
"""Fewer runs of one site and effect than this fill too few bins for a map."""

Axis = tuple[np.ndarray, list[str]]
"""Bin number of each run, and the label of each bin."""


def evasion_maps(facts: pd.DataFrame) -> list[dict[str, Any]]:
    """One figure per site and effect, most runs first: share that evaded over onset, length and magnitude.

    Each item: name, n, evaded (Rate), figure (plotly JSON). Binned; a bin without runs is hatched, not coloured.
    """
    chosen = facts.loc[facts["faulty"] & ~facts["failed"]].assign(felt=facts["outcome"] == "felt")
    maps = []
    for name, part in chosen.groupby("block", observed=True):
        if len(part) >= MIN_RUNS:
            axes = _axes(part)
            if len(axes) >= 2:
                figure = _map_row(part, axes)
                evaded = tables.rate(part["felt"])
                maps.append({"name": name, "n": len(part), "evaded": evaded, "figure": json_of(figure)})
    return sorted(maps, key=lambda item: -item["evaded"].value)


def _axes(part: pd.DataFrame) -> dict[str, Axis]:
    """{title: (bin number of each run, label of each bin)} of the inputs that vary."""
    axes = {}
    for column, title in (("onset_ms", "onset, ms"), ("length_ms", "duration, ms"), ("magnitude", "magnitude")):
        values = part[column].to_numpy(float)
        if np.isfinite(values).all() and len(np.unique(values)) > 1:
            axes[title] = bins(values)
    return axes


def bins(values: np.ndarray) -> Axis:
    """Bin number of each value and the bins' labels: one per value if few, by powers of two if wide, else even."""
    unique = np.unique(values)
    if len(unique) <= MAX_BINS + 4:
        return np.searchsorted(unique, values), [compact(value) for value in unique]
    wanted = min(MAX_BINS, max(MIN_BINS, round(math.sqrt(len(values) / RUNS_PER_BIN))))
    edges = _edges(float(unique[0]), float(unique[-1]), wanted)
    number = np.searchsorted(edges, values, side="right") - 1
    return number, [f"{compact(a)} to {compact(b)}" for a, b in pairwise(edges)]


def _edges(low: float, high: float, wanted: int) -> np.ndarray:
    """Round edges of about `wanted` bins, from at most `low` to above `high`."""
    if low > 0 and high / low > 30:
        step = math.ceil(math.log2(high / low) / (wanted + 2))
        powers = np.arange(math.floor(math.log2(low)), math.log2(high) + step + 1e-9, step)
        return 2.0**powers
    step = round_step((high - low) / wanted)
    first = math.floor(low / step)
    return np.arange(first, math.floor(high / step) + 2) * step


def compact(value: float) -> str:
    """12000 -> 12k, 0.123 -> 0.12, so that axis labels stay short."""
    if value and abs(value) >= 10_000:
        return f"{value / 1000:.3g}k".replace("-", "−")
    return f"{value:.3g}".replace("-", "−") if abs(value) < 1000 else f"{value:.0f}".replace("-", "−")


def _map_row(part: pd.DataFrame, axes: dict[str, Axis]) -> go.Figure:
    names = list(axes)
    pairs = [(names[i], names[j]) for i in range(len(names)) for j in range(i + 1, len(names))]
    figure = make_subplots(rows=1, cols=3, horizontal_spacing=0.14)
    figure.update_layout(**look(330), showlegend=False)
    figure.update_layout(margin={"l": 100, "r": 64, "t": 8, "b": 84})
    top = max(0.05, _top(part, axes, pairs))
    for place, (across, up) in enumerate(pairs, start=1):
        for trace in _heat_map(part, axes[across], axes[up], across, up, top):
            figure.add_trace(trace, row=1, col=place)
        figure.update_xaxes(title_text=across, tickangle=-45, row=1, col=place)
        figure.update_yaxes(title_text=up, row=1, col=place)
    end = figure.to_dict()["layout"][f"xaxis{len(pairs) if len(pairs) > 1 else ''}"]["domain"][1]
    figure.update_traces(colorbar_x=end + 0.01, selector={"showscale": True})
    look_of_axis = {"type": "category", "showgrid": False, "ticks": "", "tickfont_size": 10, "title_font_size": 11.5}
    figure.update_xaxes(**look_of_axis, title_standoff=8)
    figure.update_yaxes(**look_of_axis, title_standoff=4)
    return figure


def _cells(part: pd.DataFrame, across: Axis, up: Axis) -> dict[tuple[int, int], Rate]:
    """Rate of evasion of each bin that has runs, by its numbers across and up."""
    keys = [pd.Series(number, index=part.index) for number in (across[0], up[0])]
    table = rate_table(part["felt"], keys)
    return {key: Rate(*row) for key, row in zip(table.index, table.itertuples(index=False), strict=True)}


def _top(part: pd.DataFrame, axes: dict[str, Axis], pairs: list[tuple[str, str]]) -> float:
    return max(rate.value for a, b in pairs for rate in _cells(part, axes[a], axes[b]).values())


def _heat_map(part: pd.DataFrame, across: Axis, up: Axis, name_x: str, name_y: str, top: float) -> list[go.Heatmap]:
    shape = (len(up[1]), len(across[1]))
    share, hover = np.full(shape, np.nan), np.full(shape, "no runs here", object)
    text = np.full(shape, "", object)
    for (x, y), rate in _cells(part, across, up).items():
        share[y, x] = rate.value
        text[y, x] = f"{100 * rate.value:.0f}"
        hover[y, x] = (
            f"{rate.k} of {rate.n} evaded: {rate.value:.1%}<br>95 % interval {rate.low:.1%} to {rate.high:.1%}"
        )
    empty = np.where(np.isnan(share), 0.0, np.nan)
    label = f"{name_x.partition(',')[0]} %{{x}}<br>{name_y.partition(',')[0]} %{{y}}<br>%{{hovertext}}<extra></extra>"
    common = {"x": across[1], "y": up[1], "xgap": 1, "ygap": 1, "hovertemplate": label, "hovertext": hover.tolist()}
    nothing = go.Heatmap(
        z=empty,
        colorscale=[[0, "rgba(128,128,128,0.10)"], [1, "rgba(128,128,128,0.10)"]],
        showscale=False,
        text=np.where(np.isnan(share), "╱", "").tolist(),
        texttemplate="%{text}",
        textfont={"color": "rgba(128,128,128,0.55)", "size": 11},
        **common,
    )
    coloured = go.Heatmap(
        z=share,
        zmin=0,
        zmax=top,
        showscale=True,
        colorscale=RATE_SCALE,
        colorbar={"thickness": 10, "len": 0.9, "tickformat": ".0%", "outlinewidth": 0},
        text=text.tolist(),
        texttemplate="%{text}",
        textfont={"size": 10},
        **common,
    )
    return [nothing, coloured]
