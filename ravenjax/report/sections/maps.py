"""Section "Maps": shares of some events over the two inputs that matter most.

The axes of a map are the two inputs that explain most of the variance of the outcomes. Faults of
one site and effect have their own map if there are enough of them.
"""

import itertools
import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.document.chart import round_values
from ravenjax.report.data.runs import DISTINCT_FAULTS, Runs
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import Rate, share_of_cells
from ravenjax.store.access.query import RESULTS, quote_name

MIN_RUNS = 12
"""Sites and effects with fewer runs appear only in the map of all faults."""
MAX_FAULTS = 1_000_000
"""Largest number of faults that are analysed. Of more faults, about this number is drawn."""
RUNS_PER_CELL, RUNS_PER_BIN = 3, 8
"""Wanted number of runs in each cell of two inputs: for few values, and for ranges."""
MIN_BINS, MAX_BINS = 2, 8
MAX_VALUES = 12
"""Largest number of values of an input for which each value has its own bin."""
MAX_ROWS = 24
"""Sites and effects in the map of all faults. The remaining ones share a row."""
WHOLE, PLACE, NO_FAULT = "all faults", "site and effect", "no fault"
UNTIL_END = -1
"""Value for the duration of a fault that lasts until the run ends."""
TO_THE_END, UNSET, OTHERS = "to the end", "not set", "others"
WORDS = ("channel", "arm", "trigger")
"""Columns of a fault slot that hold words."""
_FILE = resources.read_tables(__file__, "maps.toml")
SLOT_INPUTS = _FILE["inputs"]
COMMON = ("fault0_duration_ms", "fault0_start_ms", "fault0_every_ms")
"""Inputs that have the same meaning at every site."""


class MapMeasure(NamedTuple):
    """Something that happened in a run or did not."""

    name: str
    title: str
    words: str
    sql: str
    free_sql: str = ""  # in a campaign without any fault; "" leaves the measure out


MEASURES = tuple(MapMeasure(**measure) for measure in _FILE["measures"])
FREE_MEASURES = tuple(one._replace(sql=one.free_sql) for one in MEASURES if one.free_sql)


class MapAxis(NamedTuple):
    """Bins of one input, in order."""

    title: str
    labels: list[str]
    bins: np.ndarray  # int [faults]: the bin of each fault
    words: bool = False  # True if the labels are words, not numbers


class PairCounts(NamedTuple):
    """Faults by two axes, and those in which each measure came."""

    up: MapAxis
    across: MapAxis
    n: np.ndarray  # int [up, across]: number of faults
    k: np.ndarray  # int [measures, up, across]: number of faults in which the measure came


class Sweep(NamedTuple):
    """One run of each fault. In a campaign without any fault: every run."""

    measures: tuple[MapMeasure, ...]
    unit: str  # "faults" or "runs"
    # One row per fault, with the columns of `titles`, the measures, and `block`, site and effect.
    faults: pd.DataFrame
    titles: dict[str, str]  # names of the columns that vary, and their titles


def summarize_sweep(runs: Runs) -> Sweep:
    """Return the inputs that a campaign varies, and the outcomes of its faults.

    Each distinct fault has one row (`sample`). Of very many, some are drawn.
    """
    if runs.count(DISTINCT_FAULTS):
        measures, condition, unit = MEASURES, DISTINCT_FAULTS, "faults"
    else:
        measures, condition, unit = FREE_MEASURES, "sample", "runs"
    # Names of the fault slots, such as "fault0".
    sites = [name for name in runs.names if re.fullmatch(r"fault\d+_site", name)]
    slots = [name.removesuffix("_site") for name in sites]
    titles = {
        f"{slot}_{key}": f"fault {number}: {title}" if len(slots) > 1 else title
        for key, title in SLOT_INPUTS.items()
        for number, slot in enumerate(slots, start=1)
    }
    varied = [name for name in runs.names if name.startswith("param:")]
    titles |= {name: name.removeprefix("param:") for name in varied}
    kinds = [f"{slot}_{key}" for slot in slots for key in ("site", "effect")]
    columns = [f"{RESULTS}.{quote_name(name)}" for name in (*kinds, *titles)]
    columns += [f"({measure.sql})::BOOLEAN AS {quote_name(measure.name)}" for measure in measures]
    faults = runs.drawn(", ".join(columns), condition, MAX_FAULTS)
    # Site and effect of each fault of a run, joined by " + ".
    block = np.full(len(faults), "", object)
    for slot in slots:
        site, effect = (faults[f"{slot}_{key}"].astype(str) for key in ("site", "effect"))
        name = site + " · " + effect
        joined = np.where(block == "", name, block + " + " + name)
        block = np.where(site == "", block, joined)
    faults["block"] = np.where(block == "", NO_FAULT, block)
    titles = {name: title for name, title in titles.items() if len(faults[name].unique()) > 1}
    return Sweep(measures, unit, faults, titles)


def all_maps(runs: Runs) -> list[dict[str, Any]]:
    """Return a map for each site and effect, those with most unintended motions first.

    If there are several sites and effects, a map of all faults comes first. A map has name, n,
    unit, rates, panels and axes. A panel shows one measure over two inputs. Its cells are rates, or
    None without a run. A measure that is the same in all runs has no panel. `axes` has the two
    pairs of inputs that explain most of the variance, and the share that each pair explains.
    """
    sweep = summarize_sweep(runs)
    # A block is a site and an effect.
    groups = runs.groups_by("block") if "block" in runs.facts else {}
    blocks, items = sweep.faults.groupby("block"), []
    for name, faults in blocks:
        if len(faults) < MIN_RUNS:
            continue
        block_sweep = sweep._replace(faults=faults)
        axes = _make_axes(block_sweep, runs.robot.joints)
        # With a single input, a map has one row.
        pairs = list(itertools.combinations(axes, 2)) or [(axis, None) for axis in axes]
        counts = [_count_pairs(block_sweep, *pair) for pair in pairs]
        if ranked := sorted(counts, key=explained_share, reverse=True):
            sampled = runs.sampled(groups.get(str(name)))
            items.append(_make_map(block_sweep, str(name), ranked, sampled))
    items.sort(key=lambda item: [-measure["rate"].value for measure in item["rates"]])
    if len(blocks) > 1:
        items.insert(0, _make_map(sweep, WHOLE, _count_blocks(sweep), runs.sampled()))
    return items


def _make_axes(sweep: Sweep, order: Sequence[str] = ()) -> list[MapAxis]:
    # Returns an axis for each input that varies, with so few bins that cells contain enough runs.
    varied = [name for name in sweep.titles if len(sweep.faults[name].unique()) > 1]
    n = len(sweep.faults)
    # In a grid of two inputs, each cell contains one run, so every value has its own bin.
    max_bins = MAX_VALUES if len(varied) <= 2 else round(math.sqrt(n / RUNS_PER_CELL))
    max_bins = min(MAX_VALUES, max(MIN_BINS, max_bins))
    axes = []
    for name in varied:
        title, values = sweep.titles[name], sweep.faults[name]
        if name.rpartition("_")[2] in WORDS:
            axes.append(word_axis(title, values.astype(str).to_numpy(), order))
        else:
            endless = name.endswith("duration_ms")
            axes.append(number_axis(title, values.to_numpy(float), max_bins, endless))
    return axes


def number_axis(title: str, values: np.ndarray, max_bins: int, endless: bool = False) -> MapAxis:
    """Return an axis with one bin per value, or one bin per range of more than `max_bins` values.

    Wide ranges are spaced by powers of two. endless: UNTIL_END means until the run ends.
    """
    labels = np.full(len(values), UNSET, object)
    until_end = endless & (values == UNTIL_END)
    labels[until_end] = TO_THE_END
    is_number = ~np.isnan(values) & ~until_end
    distinct_values = np.unique(values[is_number])
    if len(distinct_values) <= max_bins:
        names = [compact_number(value) for value in distinct_values]
        bins = np.searchsorted(distinct_values, values[is_number])
    else:
        bins = min(MAX_BINS, max_bins, max(MIN_BINS, round(math.sqrt(len(values) / RUNS_PER_BIN))))
        edges = _bin_edges(distinct_values[0], distinct_values[-1], bins)
        names = [f"{compact_number(a)} to {compact_number(b)}" for a, b in pairwise(edges)]
        # The last bin includes its upper edge.
        bins = np.searchsorted(edges[1:-1], values[is_number], side="right")
    labels[is_number] = np.array(names, object)[bins] if len(names) else ""
    return _make_axis(title, labels, [*names, TO_THE_END, UNSET])


def word_axis(title: str, values: np.ndarray, order: Sequence[str] = ()) -> MapAxis:
    """Return an axis with one bin per word, those of `order` first.

    Of more than MAX_VALUES words, the most frequent have their own bins, and the others share one.
    """
    words, counts = np.unique(values, return_counts=True)
    if len(words) > MAX_VALUES:
        words = words[np.argsort(-counts, kind="stable")[: MAX_VALUES - 1]]
        values = np.where(np.isin(values, words), values, OTHERS)
    position = {word: number for number, word in enumerate(order)}
    names = sorted(words, key=lambda word: (position.get(word, len(position)), word))
    labels = [name or "none" for name in names]
    return _make_axis(title, np.where(values == "", "none", values), [*labels, OTHERS], words=True)


def _make_axis(title: str, labels: np.ndarray, order: list[str], words: bool = False) -> MapAxis:
    # Returns an axis whose bins are the labels that occur, in the given order.
    present = set(labels.tolist())
    names = [name for name in dict.fromkeys(order) if name in present]
    return MapAxis(title, names, pd.Index(names).get_indexer(labels), words)


def _bin_edges(lowest: float, highest: float, bins: int) -> np.ndarray:
    # Returns round edges of bins. If the range is wide, edges are powers of two: each exponent is
    # larger by `step` than the one before, so that there are at most about `bins` + 2 bins.
    if lowest > 0 and highest / lowest > 30:
        step = math.ceil(math.log2(highest / lowest) / (bins + 2))
        end = math.log2(highest) + step + 1e-9
        return 2.0 ** np.arange(math.floor(math.log2(lowest)), end, step)
    return np.array(round_values(lowest, highest, bins))


def compact_number(value: float) -> str:
    """Shorten a number for an axis label: 12000 -> 12k, 2000000 -> 2M, 0.123 -> 0.12."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= max(size, 1e4):
            return f"{value / size:.3g}{letter}".replace("-", "−")
    return f"{value:{'.4g' if abs(value) >= 1e3 else '.3g'}}".replace("-", "−")


def _count_blocks(sweep: Sweep) -> list[PairCounts]:
    """Return counts by block (site and effect) and by each input that all sites share, those that
    explain most of the variance first.
    """
    block, hit = (sweep.faults[name].to_numpy() for name in ("block", sweep.measures[0].name))
    shares = {str(name): float(hit[block == name].mean()) for name in np.unique(block)}
    blocks = sorted(shares, key=lambda name: (-shares[name], name))
    if len(blocks) > MAX_ROWS + 1:
        block = np.where(np.isin(block, blocks[:MAX_ROWS]), block, OTHERS)
    vertical = _make_axis(PLACE, block, [*blocks, OTHERS], words=True)
    inputs = [name for name in sweep.titles if name in COMMON or name.startswith("param:")]
    axes = _make_axes(sweep._replace(titles={name: sweep.titles[name] for name in inputs}))
    pairs = [_count_pairs(sweep, horizontal, vertical) for horizontal in axes]
    pairs = pairs or [_count_pairs(sweep, vertical, None)]
    return sorted(pairs, key=explained_share, reverse=True)


def _count_pairs(sweep: Sweep, across: MapAxis, up: MapAxis | None) -> PairCounts:
    """Return the counts of faults and measures over two axes; `up` is None for a single axis."""
    up = up or MapAxis("", [""], np.zeros(len(across.bins), int))
    # The labels of rows have more room for words than those of columns.
    if across.words and not up.words:
        across, up = up, across
    shape = len(up.labels), len(across.labels)
    cell = up.bins * shape[1] + across.bins
    hits = [sweep.faults[measure.name].to_numpy(float) for measure in sweep.measures]
    # The number of faults of each cell, then for each measure the number in which it came.
    n, *k = (
        np.bincount(cell, weight, shape[0] * shape[1]).reshape(shape).astype(int)
        for weight in (None, *hits)
    )
    return PairCounts(up, across, n, np.array(k))


def explained_share(counts: PairCounts) -> float:
    """Return the share of the measures' variance that the cells explain (adjusted R²).

    The variances of all measures are added. The share is at most 1. It is negative if the cells
    explain less than as many random cells would, and -inf if each run has its own cell.
    """
    # n: faults of each cell [up, across]. counts.k: those in which a measure came, [measures, up,
    # across]. Sums of squared deviations: `overall` from the mean, `within` from the cells' means.
    n, total = counts.n, counts.n.sum()
    hits, freedom = counts.k.sum(axis=(1, 2)), total - (n > 0).sum()
    overall = (hits * (total - hits)).sum() / total
    within = (counts.k * (n - counts.k) / np.maximum(n, 1)).sum()
    if not freedom or not overall:
        return -math.inf
    return float(1 - within / freedom / (overall / (total - 1)))


def _make_map(sweep: Sweep, name: str, ranked: list[PairCounts], sampled: bool):
    # Returns the map of the two inputs that explain the outcome best: the first of `ranked`. The
    # values of one are in columns (`across`), those of the other in rows (`up`).
    counts, pairs = ranked[0], []
    for pair in ranked[:2]:
        if math.isfinite(share := explained_share(pair)):
            inputs = [axis.title for axis in (pair.up, pair.across) if axis.title]
            pairs.append({"inputs": inputs, "share": max(0.0, share)})
    rate_in: Callable[[int, int], Rate] = tables.wilson_share if sampled else share_of_cells
    n, rates, panels, up = len(sweep.faults), [], [], counts.up
    titles = {"across": counts.across.title, "up": up.title, "columns": counts.across.labels}
    for measure, k in zip(sweep.measures, counts.k, strict=True):
        described = measure._asdict() | {"rate": rate_in(int(k.sum()), n)}
        rates.append(described)
        # A measure that is the same in all runs has no panel. A cell is (k, n) of its rate.
        if 0 < k.sum() < n:
            cells = np.stack([k, counts.n], axis=2).tolist()
            rows = [
                {"label": label, "cells": [rate_in(*cell) if cell[1] else None for cell in row]}
                for label, row in zip(up.labels, cells, strict=True)
            ]
            # Numbers increase upwards.
            panels.append(described | titles | {"rows": rows if up.words else rows[::-1]})
    content = {"name": name, "n": n, "unit": sweep.unit, "rates": rates}
    return content | {"panels": panels, "axes": pairs}


LIMITS = {"map_least": MIN_RUNS, "map_most": MAX_FAULTS}
SECTIONS = {"maps": lambda runs, _: {"maps": all_maps(runs), **LIMITS}}
