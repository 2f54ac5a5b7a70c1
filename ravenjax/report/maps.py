"""Maps of evasion: which onsets, durations and magnitudes slip past the built-in checks and move the instrument."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import tables
from ravenjax.report.facts import FACTS
from ravenjax.report.runs import Runs
from ravenjax.report.style import round_step
from ravenjax.store.query import text

MIN_BINS, MAX_BINS = 4, 8
RUNS_PER_BIN = 8
"""Aimed at in each bin of a two-dimensional map: with fewer, an interval spans most of 0 to 100 %."""
MIN_RUNS = 20
"""Fewer runs of one site and effect than this fill too few bins for a map."""
UNTIL_END = -1
"""Duration of a fault that lasts until the run ends."""
TO_THE_END = "to the end"
MANY = 100
"""Different values of an input, counted roughly, from which on they are not looked at one by one."""
CHOSEN = "plain AND faulty AND NOT failed"

INPUTS = {"onset_ms": "onset, ms", "length_ms": "duration, ms", "magnitude": "magnitude"}
"""Columns of facts, and what they are called."""


class Axis(NamedTuple):
    """Bins of one input: each from its edge to the next, and one more for durations without an end."""

    edges: np.ndarray
    labels: list[str]
    endless: bool = False

    def number(self, values: np.ndarray) -> np.ndarray:
        """Bin of each value."""
        inside = np.searchsorted(self.edges, values, side="right") - 1
        return np.where((values == UNTIL_END) & self.endless, len(self.labels) - 1, inside)

    def sql(self, column: str) -> str:
        """The same of a column."""
        inside = " + ".join(f"({column} >= {edge!r})::INTEGER" for edge in self.edges.tolist()) or "0"
        ends = f"WHEN {column} = {UNTIL_END} THEN {len(self.labels) - 1} " if self.endless else ""
        return f"CASE {ends}ELSE {inside} - 1 END" if ends else f"{inside} - 1"


def evasion_maps(runs: Runs) -> list[dict[str, Any]]:
    """One map per site and effect that can be drawn, most evasive first: share that evaded over the varied inputs, of
    plain runs.

    Each item: name, n, evaded (Rate), panels. A panel is one pair of inputs: across and up (their titles), columns
    (labels), rows (label and cells, highest first); a cell is a Rate, or None where no run fell.
    """
    maps = []
    for name, n, axes in _blocks(runs):
        if len(axes) >= 2:
            counted = _binned(runs, name, axes)
            panels = [_panel(counted, axes, across, up) for across, up in itertools.combinations(axes, 2)]
            evaded = tables.rate_of(int(counted["evaded"].to_numpy().sum()), n)
            maps.append({"name": name, "n": n, "evaded": evaded, "panels": panels})
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


def _blocks(runs: Runs) -> Iterator[tuple[str, int, dict[str, Axis]]]:
    """Sites and effects with enough runs: name, runs, and the axes of the inputs that vary, by column."""
    if "block" not in runs.facts:
        return
    asked = []
    for name in INPUTS:
        some = f"FILTER ({name} <> {UNTIL_END})" if name == "length_ms" else ""
        asked += [f"bool_and({name} IS NOT NULL AND isfinite({name}::DOUBLE))", f"approx_count_distinct({name})"]
        asked += [f"min({name}) {some}", f"max({name}) {some}", f"count(*) {some}"]
    found = runs.table.rows(
        f"SELECT block::VARCHAR AS name, count(*), {', '.join(asked)} FROM {FACTS} WHERE {CHOSEN} "
        f"GROUP BY name HAVING count(*) >= {MIN_RUNS} ORDER BY name"
    )
    for block, n, *told in found:
        axes = {}
        for place, name in enumerate(INPUTS):
            finite, different, low, high, bounded = told[5 * place : 5 * place + 5]
            if finite and (axis := _axis(runs, block, name, (different, low, high, bounded, n))) is not None:
                axes[name] = axis
        yield block, n, axes


def _axis(runs: Runs, block: str, name: str, told: tuple[int, Any, Any, int, int]) -> Axis | None:
    """told: about how many different values, least, greatest and number of those that have an end, number of all."""
    different, low, high, bounded, n = told
    values = None
    if different <= MANY:
        rows = runs.table.rows(f"SELECT DISTINCT {name} FROM {FACTS} WHERE {CHOSEN} AND block = {text(block)}")
        values = np.sort(np.array([value for (value,) in rows], float))
        if len(values) < 2:
            return None
        values = values[values != UNTIL_END] if name == "length_ms" else values
    axis = Axis(np.zeros(0), []) if low is None else _bins(values, float(low), float(high), bounded)
    return axis._replace(labels=[*axis.labels, TO_THE_END], endless=True) if bounded < n else axis


def _bins(unique: np.ndarray | None, low: float, high: float, n: int) -> Axis:
    """Bins of n values: one per value if few, by powers of two if wide, else even. unique: None if very many."""
    if unique is not None and len(unique) <= MAX_BINS + 4:
        return Axis(unique, [compact(value) for value in unique])
    edges = _edges(low, high, min(MAX_BINS, max(MIN_BINS, round(math.sqrt(n / RUNS_PER_BIN)))))
    return Axis(edges[:-1], [f"{compact(a)} to {compact(b)}" for a, b in pairwise(edges)])


def bins(values: np.ndarray) -> Axis:
    """The bins of values in memory."""
    unique = np.unique(values)
    return _bins(unique, float(unique[0]), float(unique[-1]), len(values))


def _binned(runs: Runs, block: str, axes: dict[str, Axis]) -> pd.DataFrame:
    """Runs of a block, and those that evaded, by bin of each input; columns named as the inputs."""
    asked = "".join(f"{axis.sql(name)} AS {name}, " for name, axis in axes.items())
    return runs.table.frame(
        f"SELECT {asked}count(*) AS runs, count(*) FILTER (evaded) AS evaded FROM {FACTS} "
        f"WHERE {CHOSEN} AND block = {text(block)} GROUP BY ALL"
    )


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


def _panel(counted: pd.DataFrame, axes: dict[str, Axis], across: str, up: str) -> dict[str, Any]:
    columns, rows = axes[across].labels, axes[up].labels
    shape = (len(rows), len(columns))
    place = np.ravel_multi_index((counted[up].to_numpy(), counted[across].to_numpy()), shape)
    k, n = (
        np.bincount(place, counted[name], minlength=shape[0] * shape[1]).reshape(shape) for name in ("evaded", "runs")
    )
    cells = [
        [tables.rate_of(int(k[i, j]), int(n[i, j])) if n[i, j] else None for j in range(shape[1])]
        for i in range(shape[0])
    ]
    return {
        "across": INPUTS[across],
        "up": INPUTS[up],
        "columns": columns,
        "rows": [{"label": label, "cells": row} for label, row in zip(rows, cells, strict=True)][::-1],
    }
