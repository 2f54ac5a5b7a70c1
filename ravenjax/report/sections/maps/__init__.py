"""Maps of what was swept: where faults move the instrument unintendedly, where checks tell, where
the cue comes, and where faults evade.

A map has two inputs as its axes, those that tell most. Inputs with many values are binned, and bins
are joined until a few runs fall into a cell. Faults of one site and effect have a map of their own
where they are enough; all faults together have one by site and effect.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section, tables
from ravenjax.report.sections.maps import counts as map_counts
from ravenjax.report.sections.maps import inputs
from ravenjax.report.sections.maps.counts import PairCounts
from ravenjax.report.sections.maps.inputs import MapMeasure, Sweep
from ravenjax.stats.intervals import Rate, share

MIN_RUNS = 12
"""Fewer runs of one site and effect are in the map of all faults alone."""
MORE_PAIRS = 2
"""Further pairs of inputs, of which the leading measure is drawn."""
WHOLE = "all faults"


def all_maps(runs: Runs) -> list[dict[str, Any]]:
    """The map of all faults, where they are of several sites and effects, then those of each, the
    most unintended motion first. One run of each fault counts.

    Each item: name, n, unit, rates (of each measure: title, words, rate), panels, more (panels of
    further pairs of inputs, of the leading measure). A panel is one measure over two inputs: name,
    title, words, rate, across and up (titles of the axes), columns (labels), rows (label and cells,
    highest first); a cell is a Rate, or None where no run fell. Only what came in some runs and not
    in others has panels.
    """
    sweep = inputs.sweep(runs)
    groups = runs.groups_by("block") if "block" in runs.facts else {}
    blocks = [name for name, n in sweep.blocks.items() if n >= MIN_RUNS]
    items = [
        item
        for name in blocks
        if (
            item := _item(
                sweep, name, map_counts.of_block(sweep, name), runs.sampled(groups.get(name))
            )
        )
    ]
    items.sort(key=lambda item: [-one["rate"].value for one in item["rates"]])
    whole = (
        _item(sweep, WHOLE, map_counts.of_all(sweep), runs.sampled())
        if len(sweep.blocks) > 1
        else None
    )
    return [*([whole] if whole else []), *items]


def cells(items: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Maps cell by cell, those without runs left out; one column a measure."""
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    names = ("faults", "across", "column", "up", "row")
    for item in items:
        for panel in (*item["panels"], *item["more"]):
            for row in panel["rows"]:
                for column, cell in zip(panel["columns"], row["cells"], strict=True):
                    if cell is not None:
                        place = (item["name"], panel["across"], column, panel["up"], row["label"])
                        rows.setdefault(place, dict(zip(names, place, strict=True)))[
                            panel["name"]
                        ] = cell
    return list(rows.values())


def _item(
    sweep: Sweep, name: str, of_pairs: Sequence[PairCounts], sampled: bool
) -> dict[str, Any] | None:
    """sampled: whether the faults were drawn."""
    if not of_pairs:
        return None
    rate_in = tables.rate_of if sampled else share
    first = of_pairs[0]
    n, hits = int(first.n.sum()), [int(k.sum()) for k in first.k]
    rates = [
        {"name": one.name, "title": one.title, "words": one.words, "rate": rate_in(k, n)}
        for one, k in zip(sweep.measures, hits, strict=True)
    ]
    able = [place for place, k in enumerate(hits) if 0 < k < n]
    more = [one for one in of_pairs[1 : 1 + MORE_PAIRS] if map_counts.gain(one) > 0]
    return {
        "name": name,
        "n": n,
        "unit": sweep.unit,
        "rates": rates,
        "panels": [_panel(sweep.measures[place], first, place, rate_in) for place in able],
        "more": (
            [_panel(sweep.measures[able[0]], one, able[0], rate_in) for one in more] if able else []
        ),
    }


def _panel(
    measure: MapMeasure, counts: PairCounts, place: int, rate_in: Callable[[int, int], Rate]
) -> dict[str, Any]:
    n, k = counts.n, counts.k[place]
    rows = [
        {
            "label": label,
            "cells": [
                rate_in(int(hits), int(runs)) if runs else None
                for hits, runs in zip(k[i], n[i], strict=True)
            ],
        }
        for i, label in enumerate(counts.up.labels)
    ]
    return {
        "name": measure.name,
        "title": measure.title,
        "words": measure.words,
        "rate": rate_in(int(k.sum()), int(n.sum())),
        "across": counts.across.title,
        "up": counts.up.title,
        "columns": counts.across.labels,
        "rows": rows if counts.up.words else rows[::-1],  # numbers rise
    }


def _content(runs: Runs, _: Path) -> dict[str, Any]:
    maps = all_maps(runs)
    return {"maps": maps, "map_csv": cells(maps), "map_least": MIN_RUNS}


SECTIONS = (Section("maps", "Maps", 30, _content),)
