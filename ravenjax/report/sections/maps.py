"""Section "Maps": shares of unintended motions, alarms, cues and evading faults over the two inputs
that decide most.

A map has two inputs as its axes, those that tell most. Inputs with many values are binned. Faults
of one site and effect have a map of their own where they are enough; all faults together have one
by site and effect.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.document.chart import round_values
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section, tables
from ravenjax.stats.intervals import Rate, share
from ravenjax.store.access.query import RESULTS, quoted

MIN_RUNS = 12
"""Fewer runs of one site and effect are in the map of all faults alone."""
MOST = 1_000_000
"""Faults that are looked at; of more, about so many are drawn."""
RUNS_PER_CELL, RUNS_PER_BIN = 3, 8
"""Aimed at in each cell of two inputs: of few values, and of ranges."""
MIN_BINS, MAX_BINS = 2, 8
MOST_VALUES = 12
"""Values of an input that have a bin each."""
MOST_ROWS = 24
"""Sites and effects in the map of all faults; the others share a row."""
WHOLE, PLACE, NO_FAULT = "all faults", "site and effect", "no fault"
UNTIL_END = -1
"""Duration of a fault that lasts until the run ends."""
TO_THE_END, UNSET, OTHERS = "to the end", "not set", "others"
WORDS = ("channel", "arm", "trigger")
"""Columns of a fault slot that hold words."""
SLOT_INPUTS = {
    "value": "value",
    "duration_ms": "duration, ms",
    "start_ms": "onset, ms",
    "channel": "channel",
    "arm": "arm",
    "every_ms": "again every, ms",
    "period_ms": "period, ms",
    "trigger": "onset counts from",
}
"""Columns of a fault slot that may be an axis, and what they are called; where no input tells
more, the first do.
"""
COMMON = ("fault0_duration_ms", "fault0_start_ms", "fault0_every_ms")
"""Inputs that mean the same at every site."""


class MapMeasure(NamedTuple):
    """Something that happened in a run or did not."""

    name: str
    # of columns of facts
    sql: str
    title: str
    # "3 of 12 ..."
    words: str


MEASURES = (
    MapMeasure("unintended", "unintended", "Unintended motion", "moved unintendedly"),
    MapMeasure("told", "told", "A check told of it", "were told of"),
    MapMeasure("cue", "cued", "The cue came", "had the cue"),
    MapMeasure("evaded", "evaded", "Evaded the checks", "evaded"),
)
"""Measures of runs with a fault. The first is the leading one, where it came in some runs and not
in others.
"""
FREE_MEASURES = (MEASURES[1], MapMeasure("cue", "cue_ms >= 0", "The cue came", "had the cue"))
"""Measures of a campaign without any fault."""


class MapAxis(NamedTuple):
    """Bins of one input, in order."""

    title: str
    labels: list[str]
    # int [faults]: the bin of each
    place: np.ndarray
    words: bool = False


class PairCounts(NamedTuple):
    """Faults by two axes, and those in which each measure came."""

    up: MapAxis
    across: MapAxis
    # [up, across]
    n: np.ndarray
    # [measures, up, across]
    k: np.ndarray


class Sweep(NamedTuple):
    """One run of each fault; or every run, of a campaign without any fault."""

    measures: tuple[MapMeasure, ...]
    # "faults" or "runs"
    unit: str
    # a row a fault: the columns of `titles` and the measures
    faults: pd.DataFrame
    # site and effect of each
    block: np.ndarray
    # what varies -> how it is called
    titles: dict[str, str]


def sweep(runs: Runs) -> Sweep:
    """What a campaign swept, and which faults had which outcome."""
    faulty = runs.count("sample AND faulty") > 0
    measures, condition, unit = (
        (MEASURES, "sample AND faulty", "faults") if faulty else (FREE_MEASURES, "sample", "runs")
    )
    slots = [name[:-5] for name in runs.names if re.fullmatch(r"fault\d+_site", name)]
    titles = {
        f"{slot}_{key}": f"fault {number}: {title}" if len(slots) > 1 else title
        for key, title in SLOT_INPUTS.items()
        for number, slot in enumerate(slots, start=1)
    }
    titles |= {
        name: name.removeprefix("param:") for name in runs.names if name.startswith("param:")
    }
    kinds = [f"{slot}_{key}" for slot in slots for key in ("site", "effect")]
    columns = [f"{RESULTS}.{quoted(name)}" for name in (*kinds, *titles)]
    columns += [f"({one.sql})::BOOLEAN AS {quoted(one.name)}" for one in measures]
    faults = runs.drawn(", ".join(columns), condition, MOST)
    block = np.full(len(faults), "", object)
    for slot in slots:
        site, effect = (faults[f"{slot}_{key}"].astype(str) for key in ("site", "effect"))
        there, name = site != "", site + " · " + effect
        block = np.where(there, np.where(block == "", name, block + " + " + name), block)
    block = np.where(block == "", NO_FAULT, block)
    varied = {name: title for name, title in titles.items() if len(faults[name].unique()) > 1}
    return Sweep(measures, unit, faults, block, varied)


def all_maps(runs: Runs) -> list[dict[str, Any]]:
    """The map of all faults, where they are of several sites and effects, then those of each, the
    most unintended motion first. One run of each fault counts.

    Each item: name, n, unit, rates (of each measure: title, words, rate), panels. A panel is one
    measure over two inputs: name, title, words, rate, across and up (titles of the axes), columns
    (labels), rows (label and cells, highest first); a cell is a Rate, or None where no run fell.
    Only what came in some runs and not in others has panels.
    """
    swept = sweep(runs)
    groups = runs.groups_by("block") if "block" in runs.facts else {}
    names, sizes = np.unique(swept.block, return_counts=True)
    items = []
    for name in names[sizes >= MIN_RUNS]:
        mine = swept.block == name
        part = swept._replace(faults=swept.faults.loc[mine], block=swept.block[mine])
        if counts := _best_pair(part, _axes(part, runs.robot.joints)):
            items.append(_map(part, str(name), counts, runs.sampled(groups.get(str(name)))))
    items.sort(key=lambda item: [-one["rate"].value for one in item["rates"]])
    whole = [_map(swept, WHOLE, _by_block(swept), runs.sampled())] if len(names) > 1 else []
    return [*whole, *items]


def _axes(swept: Sweep, order: Sequence[str] = ()) -> list[MapAxis]:
    """Axes of those inputs that vary among the faults."""
    varied = [name for name in swept.titles if len(swept.faults[name].unique()) > 1]
    n = len(swept.faults)
    # a cell of a grid of two inputs is one run
    most = MOST_VALUES if len(varied) <= 2 else round(math.sqrt(n / RUNS_PER_CELL))
    most = min(MOST_VALUES, max(MIN_BINS, most))
    made = []
    for name in varied:
        title, values = swept.titles[name], swept.faults[name]
        if name.rpartition("_")[2] in WORDS:
            made.append(word_axis(title, values.astype(str).to_numpy(), order))
        else:
            endless = name.endswith("duration_ms")
            made.append(number_axis(title, values.to_numpy(float), most, endless))
    return made


def number_axis(title: str, values: np.ndarray, most: int, endless: bool = False) -> MapAxis:
    """A bin a value, at most `most`; else ranges, by powers of two if wide. endless: UNTIL_END
    stands for no number.
    """
    labels = np.full(len(values), UNSET, object)
    last = endless & (values == UNTIL_END)
    labels[last] = TO_THE_END
    numbers = ~np.isnan(values) & ~last
    different = np.unique(values[numbers])
    if len(different) <= most:
        names = [compact(value) for value in different]
        place = np.searchsorted(different, values[numbers])
    else:
        wanted = round(math.sqrt(len(values) / RUNS_PER_BIN))
        edges = _edges(different[0], different[-1], min(MAX_BINS, most, max(MIN_BINS, wanted)))
        names = [f"{compact(a)} to {compact(b)}" for a, b in pairwise(edges)]
        # the last bin holds its upper edge
        place = np.searchsorted(edges[1:-1], values[numbers], side="right")
    labels[numbers] = np.array(names, object)[place] if len(names) else ""
    return _axis(title, labels, [*names, TO_THE_END, UNSET])


def word_axis(title: str, values: np.ndarray, order: Sequence[str] = ()) -> MapAxis:
    """A bin a word, those of `order` first and the others in the order of the alphabet; of more
    than MOST_VALUES the most frequent, and one for the others.
    """
    words, counts = np.unique(values, return_counts=True)
    if len(words) > MOST_VALUES:
        words = words[np.argsort(-counts, kind="stable")[: MOST_VALUES - 1]]
        values = np.where(np.isin(values, words), values, OTHERS)
    places = {word: place for place, word in enumerate(order)}
    names = sorted(words, key=lambda word: (places.get(word, len(places)), word))
    labels = [name or "none" for name in names]
    return _axis(title, np.where(values == "", "none", values), [*labels, OTHERS], words=True)


def _axis(title: str, labels: np.ndarray, order: Sequence[str], words: bool = False) -> MapAxis:
    """With the labels that occur, in their order."""
    there = set(labels.tolist())
    names = [name for name in dict.fromkeys(order) if name in there]
    return MapAxis(title, names, pd.Index(names).get_indexer(labels), words)


def _edges(low: float, high: float, wanted: int) -> np.ndarray:
    """Round edges of about `wanted` bins, from at most `low` to at least `high`."""
    if low > 0 and high / low > 30:
        step = math.ceil(math.log2(high / low) / (wanted + 2))
        return 2.0 ** np.arange(math.floor(math.log2(low)), math.log2(high) + step + 1e-9, step)
    return np.array(round_values(low, high, wanted))


def compact(value: float) -> str:
    """12000 -> 12k, 2000000 -> 2M, 0.123 -> 0.12, so that axis labels stay short."""
    for least, size, letter in ((1e6, 1e6, "M"), (1e4, 1e3, "k"), (1e3, 1, "")):
        if abs(value) >= least:
            return f"{value / size:.{4 if size == 1 else 3}g}{letter}".replace("-", "−")
    return f"{value:.3g}".replace("-", "−")


def _by_block(swept: Sweep) -> PairCounts:
    """Counts of all faults by site and effect and the input that tells most, among those that mean
    the same at all sites.
    """
    hit = swept.faults[swept.measures[0].name].to_numpy(float)
    shares = {str(name): float(hit[swept.block == name].mean()) for name in np.unique(swept.block)}
    names = sorted(shares, key=lambda name: (-shares[name], name))
    block = swept.block
    if len(names) > MOST_ROWS + 1:
        block = np.where(np.isin(block, names[:MOST_ROWS]), block, OTHERS)
    up = _axis(PLACE, block, [*names, OTHERS], words=True)
    common = {
        name: title
        for name, title in swept.titles.items()
        if name in COMMON or name.startswith("param:")
    }
    axes = _axes(swept._replace(titles=common))
    return max(
        [_counts(swept, across, up) for across in axes] or [_counts(swept, up, None)], key=gain
    )


def _best_pair(swept: Sweep, axes: Sequence[MapAxis]) -> PairCounts | None:
    """Counts by the two inputs that tell most; None where nothing varies."""
    pairs = list(itertools.combinations(axes, 2)) or [(axis, None) for axis in axes]
    return max((_counts(swept, *pair) for pair in pairs), key=gain, default=None)


def _counts(swept: Sweep, across: MapAxis, up: MapAxis | None) -> PairCounts:
    """up: None for one axis alone."""
    up = up or MapAxis("", [""], np.zeros(len(across.place), int))
    # words stand better beside the rows
    if across.words and not up.words:
        across, up = up, across
    shape = len(up.labels), len(across.labels)
    cell = up.place * shape[1] + across.place
    hits = [swept.faults[one.name].to_numpy(float) for one in swept.measures]
    n, *k = (
        np.bincount(cell, weight, shape[0] * shape[1]).reshape(shape).astype(int)
        for weight in (None, *hits)
    )
    return PairCounts(up, across, n, np.array(k))


def gain(counts: PairCounts) -> float:
    """How much more the cells tell of the measures than their overall shares do: the gain in
    log-likelihood, twice, less what as many free numbers cost (Schwarz's criterion).
    """
    from scipy.special import rel_entr

    n, cells = counts.n, int((counts.n > 0).sum())
    total, sum_of_gains = n.sum(), 0.0
    for k in counts.k:
        if 0 < k.sum() < total:
            mean = k.sum() / total
            tell = rel_entr(k, n * mean) + rel_entr(n - k, n * (1 - mean))
            sum_of_gains += 2 * float(tell.sum()) - (cells - 1) * math.log(total)
    # where nothing tells anything, the first inputs are taken
    return max(0.0, sum_of_gains)


def _map(swept: Sweep, name: str, counts: PairCounts, sampled: bool) -> dict[str, Any]:
    """The map of some faults. sampled: whether they were drawn."""
    rate_in: Callable[[int, int], Rate] = tables.rate_of if sampled else share
    n, hits = len(swept.faults), [int(k.sum()) for k in counts.k]
    rates = [
        one._asdict() | {"rate": rate_in(k, n)} for one, k in zip(swept.measures, hits, strict=True)
    ]
    panels = [
        _panel(rate, counts, k, rate_in)
        for rate, k in zip(rates, counts.k, strict=True)
        if 0 < k.sum() < n
    ]
    return {"name": name, "n": n, "unit": swept.unit, "rates": rates, "panels": panels}


def _panel(
    measure: Mapping[str, Any], counts: PairCounts, k: np.ndarray, rate_in: Callable[..., Rate]
) -> dict[str, Any]:
    """k: faults of each cell in which the measure came."""
    rows = [
        {"label": label, "cells": [rate_in(*cell) if cell[1] else None for cell in cells]}
        for label, cells in zip(
            counts.up.labels, np.stack([k, counts.n], axis=2).tolist(), strict=True
        )
    ]
    return {
        **measure,
        "across": counts.across.title,
        "up": counts.up.title,
        "columns": counts.across.labels,
        # numbers rise
        "rows": rows if counts.up.words else rows[::-1],
    }


def _content(runs: Runs, _: Path) -> dict[str, Any]:
    maps = all_maps(runs)
    return {"maps": maps, "map_least": MIN_RUNS, "map_most": MOST}


SECTIONS = (Section("maps", "Maps", 30, _content),)
