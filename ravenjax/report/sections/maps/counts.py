"""Counts of a sweep by pairs of inputs, and which pair tells most of what happened."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.report.sections.maps import axes as map_axes
from ravenjax.report.sections.maps import inputs
from ravenjax.report.sections.maps.axes import MapAxis
from ravenjax.report.sections.maps.inputs import TABLE, Sweep
from ravenjax.store.access.query import text

RUNS_PER_CELL = 3
"""Bins are joined until so many runs fall into a cell, at the mean."""
MOST_INPUTS = 6
"""Inputs of which every pair is tried; of more, those that tell most alone."""
MOST_ROWS = 24
"""Sites and effects in the map of all faults; the others share a row."""
PLACE = "site and effect"


class PairCounts(NamedTuple):
    """Faults by two axes, and those in which each measure came."""

    up: MapAxis
    across: MapAxis
    n: np.ndarray  # [up, across]
    k: np.ndarray  # [measures, up, across]


def of_block(sweep: Sweep, name: str) -> list[PairCounts]:
    """Counts of one site and effect by each pair of its inputs, those that tell most first."""
    where = f"block = {text(name)}"
    axes = inputs.axes(sweep, sweep.inputs, where)
    if len(axes) > MOST_INPUTS:
        alone = _counts(sweep, axes, [(column, column) for column in axes], where)
        best = sorted(range(len(alone)), key=lambda place: -gain(alone[place]))[:MOST_INPUTS]
        axes = {column: axis for place, (column, axis) in enumerate(axes.items()) if place in best}
    pairs = list(itertools.combinations(axes, 2)) or [(column, column) for column in axes]
    return _best_first(_counts(sweep, axes, pairs, where))


def of_all(sweep: Sweep) -> list[PairCounts]:
    """Counts of all faults by site and effect and each input that means the same at all of them,
    those that tell most first."""
    axes = inputs.axes(sweep, [one for one in sweep.inputs if one.common], "true")
    rows = sweep.runs.table.rows(
        f"SELECT block::VARCHAR FROM {TABLE} GROUP BY block ORDER BY avg(m0::INTEGER) DESC, block"
    )
    names = [name for (name,) in rows]
    rest = names[MOST_ROWS:] if len(names) > MOST_ROWS + 1 else []
    first = names[: len(names) - len(rest)]
    axes["block"] = MapAxis(
        PLACE, [*first, *([map_axes.OTHERS] if rest else [])], words=tuple(first)
    )
    pairs = [(column, "block") for column in axes if column != "block"] or [("block", "block")]
    return _best_first(_counts(sweep, axes, pairs, "true"))


def gain(counts: PairCounts) -> float:
    """How much more the cells tell of the measures than their overall shares do: the gain in
    log-likelihood, twice, less what as many free numbers cost (Schwarz's criterion)."""
    n, cells = counts.n, int((counts.n > 0).sum())
    total, sum_of_gains = n.sum(), 0.0
    for k in counts.k:
        if 0 < k.sum() < total:
            share = k.sum() / total
            sum_of_gains += 2 * float((_log(k, n * share) + _log(n - k, n * (1 - share))).sum())
            sum_of_gains -= (cells - 1) * math.log(total)
    return sum_of_gains


def _counts(
    sweep: Sweep, axes: dict[str, MapAxis], pairs: Sequence[tuple[str, str]], where: str
) -> list[PairCounts]:
    """Counts by pairs of inputs; of one input twice those by it alone."""
    if not pairs:
        return []
    columns, sums = list(axes), [f"m{place}" for place in range(len(sweep.measures))]
    binned = ", ".join(f"{axis.sql(column)} AS {column}" for column, axis in axes.items())
    sets = ", ".join(f"({', '.join(dict.fromkeys(pair))})" for pair in pairs)
    table = sweep.runs.table.frame(
        f"SELECT {', '.join(columns)}, grouping({', '.join(columns)}) AS which, count(*) AS n,"
        f" {', '.join(f'count(*) FILTER ({name}) AS {name}' for name in sums)} FROM (SELECT"
        f" {binned}, {', '.join(sums)} FROM {TABLE} WHERE {where}) GROUP BY GROUPING SETS ({sets})"
    )
    of_pairs = []
    for pair in pairs:
        # a bit of `which` is 0 for the columns that are grouped by, the first column the highest
        # bit
        bits = sum(
            2 ** (len(columns) - 1 - place)
            for place, column in enumerate(columns)
            if column not in pair
        )
        mine = table.loc[table["which"] == bits]
        across, up = (axes[column] for column in pair)
        place = mine[pair[0]].to_numpy(int), mine[pair[1]].to_numpy(int)
        if pair[0] == pair[1]:
            up, place = MapAxis("", [""]), (place[0], np.zeros(len(mine), int))
        if across.words and not up.words:  # words stand better beside the rows
            across, up, place = up, across, place[::-1]
        counts = np.zeros((1 + len(sums), len(up.labels), len(across.labels)), int)
        for row, name in enumerate(["n", *sums]):
            np.add.at(counts[row], (place[1], place[0]), mine[name].to_numpy(int))
        one = PairCounts(up, across, counts[0], counts[1:])
        whole = len(axes) <= 2 and not (
            up.ranges or across.ranges
        )  # nothing else varies: a cell is one run
        of_pairs.append(one if whole else _coarser(one))
    return of_pairs


def _coarser(counts: PairCounts) -> PairCounts:
    """With bins joined until RUNS_PER_CELL runs fall into a cell at the mean, the longer axis
    first.
    """
    most = max(4.0, float(counts.n.sum()) / RUNS_PER_CELL)
    while counts.n.size > most:
        axis = max((counts.up, counts.across), key=lambda one: one.joinable)
        if axis.joinable <= 2:
            break
        new, place = axis.join(axis.joinable - 1 if axis.joinable < 6 else axis.joinable // 2)
        dimension = 0 if axis is counts.up else 1
        n, k = (_sums(part, place, part.ndim - 2 + dimension) for part in (counts.n, counts.k))
        counts = (
            PairCounts(new, counts.across, n, k)
            if dimension == 0
            else PairCounts(counts.up, new, n, k)
        )
    return counts


def _sums(values: np.ndarray, place: np.ndarray, dimension: int) -> np.ndarray:
    """Sums along one dimension of what gets the same place."""
    first = np.moveaxis(values, dimension, 0)
    total = np.zeros((int(place.max()) + 1, *first.shape[1:]), values.dtype)
    np.add.at(total, place, first)
    return np.moveaxis(total, 0, dimension)


def _best_first(of_pairs: Sequence[PairCounts]) -> list[PairCounts]:
    """Those that tell most first; where none tells anything, in the order of the inputs."""
    gains = [max(0.0, gain(counts)) for counts in of_pairs]
    return [
        of_pairs[place] for place in sorted(range(len(of_pairs)), key=lambda place: -gains[place])
    ]


def _log(count: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """count x log(count / expected), 0 where count is."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(count > 0, count * np.log(count / expected), 0.0)
