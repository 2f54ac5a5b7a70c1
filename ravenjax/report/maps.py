"""Maps of evasion: which onsets, durations and magnitudes slip past the built-in checks and move the instrument."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.report import tables
from ravenjax.report.style import round_step

MIN_BINS, MAX_BINS = 4, 8
RUNS_PER_BIN = 8
"""Aimed at in each bin of a two-dimensional map: with fewer, an interval spans most of 0 to 100 %."""
MIN_RUNS = 20
"""Fewer runs of one site and effect than this fill too few bins for a map."""
UNTIL_END = -1
"""Duration of a fault that lasts until the run ends."""
TO_THE_END = "to the end"

Axis = tuple[np.ndarray, list[str]]
"""Bin number of each run, and the label of each bin."""


def evasion_maps(facts: pd.DataFrame) -> list[dict[str, Any]]:
    """One map per site and effect that can be drawn, most evasive first: share that evaded over the varied inputs.

    Each item: name, n, evaded (Rate), panels. A panel is one pair of inputs: across and up (their titles), columns
    (labels), rows (label and cells, highest first); a cell is a Rate, or None where no run fell.
    """
    chosen = facts.loc[facts["faulty"] & ~facts["failed"]]
    maps = []
    for name, part in chosen.groupby("block", observed=True) if len(chosen) else ():
        axes = _axes(part) if len(part) >= MIN_RUNS else {}
        if len(axes) >= 2:
            hits = part["evaded"].to_numpy(bool)
            panels = [_panel(hits, axes, across, up) for across, up in itertools.combinations(axes, 2)]
            maps.append({"name": name, "n": len(part), "evaded": tables.rate(hits), "panels": panels})
    return sorted(maps, key=lambda item: -item["evaded"].value)


def cells(made: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Maps cell by cell, those without runs left out."""
    return [
        {"block": item["name"], "across": panel["across"], "column": column, "up": panel["up"], "row": row["label"]}
        | {"evaded": cell}
        for item in made
        for panel in item["panels"]
        for row in panel["rows"]
        for column, cell in zip(panel["columns"], row["cells"], strict=True)
        if cell is not None
    ]


def _axes(part: pd.DataFrame) -> dict[str, Axis]:
    """{title: (bin number of each run, label of each bin)} of the inputs that vary."""
    axes = {}
    for column, title in (("onset_ms", "onset, ms"), ("length_ms", "duration, ms"), ("magnitude", "magnitude")):
        values = part[column].to_numpy(float)
        if np.isfinite(values).all() and len(np.unique(values)) > 1:
            axes[title] = _durations(values) if column == "length_ms" else bins(values)
    return axes


def _durations(values: np.ndarray) -> Axis:
    """Bins of durations, the last for those that last until the run ends."""
    endless = values == UNTIL_END
    if not endless.any():
        return bins(values)
    number, labels = bins(values[~endless]) if not endless.all() else (np.zeros(0, int), [])
    numbers = np.full(len(values), len(labels))
    numbers[~endless] = number
    return numbers, [*labels, TO_THE_END]


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


def _panel(hits: np.ndarray, axes: dict[str, Axis], across: str, up: str) -> dict[str, Any]:
    (x, columns), (y, rows) = axes[across], axes[up]
    shape = (len(rows), len(columns))
    place = np.ravel_multi_index((y, x), shape)
    k, n = (np.bincount(chosen, minlength=shape[0] * shape[1]).reshape(shape) for chosen in (place[hits], place))
    cells = [
        [tables.rate_of(int(k[i, j]), int(n[i, j])) if n[i, j] else None for j in range(shape[1])]
        for i in range(shape[0])
    ]
    return {
        "across": across,
        "up": up,
        "columns": columns,
        "rows": [{"label": label, "cells": row} for label, row in zip(rows, cells, strict=True)][::-1],
    }
