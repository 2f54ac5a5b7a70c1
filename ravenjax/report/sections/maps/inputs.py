"""What a campaign swept: the inputs that differ among its faults, and which faults had which
outcome.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections.maps import axes as map_axes
from ravenjax.report.sections.maps.axes import TO_THE_END, UNSET, UNTIL_END, MapAxis
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, quoted, text


class MapMeasure(NamedTuple):
    """Something that happened in a run or did not."""

    name: str
    sql: str  # of columns of facts
    title: str
    words: str  # "3 of 12 ..."


MEASURES = (
    MapMeasure("unintended", "unintended", "Unintended motion", "moved unintendedly"),
    MapMeasure("told", "told", "A check told of it", "were told of"),
    MapMeasure("cue", "cued", "The cue came", "had the cue"),
    MapMeasure("evaded", "evaded", "Evaded the checks", "evaded"),
)
"""Of runs with a fault; the first is the leading one, where it came in some runs and not in
others.
"""
FREE_MEASURES = (
    MEASURES[1],
    MapMeasure("cue", "cue_ms >= 0", "The cue came", "had the cue"),
)
"""Of a campaign without any fault."""
CHOSEN, CHOSEN_FREE = "sample AND faulty", "sample"

MANY = 100
"""Different values of an input, counted roughly, from which on they are not looked at one by
one.
"""
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
COMMON = ("duration_ms", "start_ms", "every_ms")
"""Of those, the ones that mean the same at every site."""
NO_FAULT = "no fault"
TABLE = "swept"
"""The faults of a sweep: block, a column a measure (m0 ..) and an input (a0 ..)."""


class SweptInput(NamedTuple):
    """Something that the campaign varies."""

    column: str  # of TABLE
    title: str
    words: bool
    common: bool  # means the same for every site and effect
    endless: bool  # UNTIL_END stands for no number
    nan: bool  # may be NaN: not set


class Sweep(NamedTuple):
    """One run of each fault, as TABLE; or every run, of a campaign without any fault."""

    runs: Runs
    measures: tuple[MapMeasure, ...]
    inputs: list[SweptInput]
    blocks: dict[str, int]  # site and effect -> faults
    unit: str  # "faults" or "runs"


def sweep(runs: Runs) -> Sweep:
    """Make TABLE; without valid runs the sweep has no blocks."""
    faulty = runs.count(CHOSEN) > 0
    measures, condition, unit = (
        (MEASURES, CHOSEN, "faults") if faulty else (FREE_MEASURES, CHOSEN_FREE, "runs")
    )
    block, inputs = _block_sql(runs.names), _inputs(runs, condition)
    words = sorted(
        name for (name,) in runs.table.rows(f"SELECT DISTINCT {block} FROM {runs.those(condition)}")
    )
    if not words:
        return Sweep(runs, measures, [], {}, unit)
    outcomes = ", ".join(f"({one.sql}) AS m{place}" for place, one in enumerate(measures))
    columns = [
        f"({block})::{query.enum(words)} AS block",
        *(f"m{place}" for place in range(len(measures))),
    ]
    columns += [f"{quoted(name)} AS {one.column}" for name, one in inputs]
    runs.table.run(
        f"CREATE OR REPLACE TABLE {TABLE} AS SELECT {', '.join(columns)} "
        f"FROM {RESULTS} JOIN (SELECT row, {outcomes} FROM {FACTS} WHERE {condition}) USING (row)"
    )
    blocks = dict(
        runs.table.rows(f"SELECT block::VARCHAR, count(*) FROM {TABLE} GROUP BY ALL ORDER BY ALL")
    )
    return Sweep(runs, measures, [one for _, one in inputs], blocks, unit)


def axes(of: Sweep, inputs: Iterable[SweptInput], where: str) -> dict[str, MapAxis]:
    """Axes of those inputs that vary among the rows of TABLE that fulfil a condition, by column."""
    inputs = list(inputs)
    if not inputs:
        return {}
    counts = iter(
        of.runs.table.row(
            f"SELECT {', '.join(map(_extent_sql, inputs))} FROM {TABLE} WHERE {where}"
        )
    )
    by_column = {}
    for one in inputs:
        different, low, high, numbers, unset, n = itertools.islice(counts, 6)
        special = [TO_THE_END] * (numbers + unset < n) + [UNSET] * (unset > 0)
        if one.words:
            axis = _word_axis(of, one, where)
        elif numbers:
            values = _values(of, one, where) if different <= MANY else None
            axis = map_axes.of_numbers(one.title, values, float(low), float(high), numbers, special)
        else:
            axis = MapAxis(one.title, special, special=tuple(special))
        if len(axis.labels) > 1:
            by_column[one.column] = axis
    return by_column


def _block_sql(names: Sequence[str]) -> str:
    """Sites and effects of a run's faults, of columns of `results`."""
    slots = _slots(names)
    each = [
        f"CASE WHEN fault{s}_site <> '' THEN fault{s}_site || ' · ' || fault{s}_effect END"
        for s in slots
    ]
    return (
        f"coalesce(nullif(concat_ws(' + ', {', '.join(each)}), ''), {text(NO_FAULT)})"
        if each
        else text(NO_FAULT)
    )


def _slots(names: Sequence[str]) -> list[int]:
    return [int(match[1]) for name in names if (match := re.fullmatch(r"fault(\d+)_site", name))]


def _inputs(runs: Runs, condition: str) -> list[tuple[str, SweptInput]]:
    """Columns of `results` that differ among some runs, and what they are."""
    slots = _slots(runs.names)
    able: list[tuple[str, SweptInput]] = []
    for key, title in SLOT_INPUTS.items():
        for slot in slots:
            name = f"fault{slot}_{key}"
            full = f"fault {slot + 1}: {title}" if len(slots) > 1 else title
            common = key in COMMON and slot == 0
            able.append(
                (
                    name,
                    SweptInput(
                        "", full, key in WORDS, common, key == "duration_ms", key == "value"
                    ),
                )
            )
    able += [
        (name, SweptInput("", name.removeprefix("param:"), False, True, False, True))
        for name in runs.names
        if name.startswith("param:")
    ]
    if not able:
        return []
    ends = ", ".join(  # NaN is the greatest number of all
        f"min({quoted(name)}{cast}) IS DISTINCT FROM max({quoted(name)}{cast})"
        for name, one in able
        for cast in ["::VARCHAR" if one.words else ""]
    )
    differs = runs.table.row(f"SELECT {ends} FROM {runs.those(condition)}")
    varied = [pair for pair, varies in zip(able, differs, strict=True) if varies]
    return [(name, one._replace(column=f"a{place}")) for place, (name, one) in enumerate(varied)]


def _extent_sql(one: SweptInput) -> str:
    """Roughly how many different values, the least and the greatest number, how many are numbers,
    how many not set, how many there are."""
    column = one.column
    conditions = [f"{column} <> {UNTIL_END}"] * one.endless + [
        f"NOT isnan({column}::DOUBLE)"
    ] * one.nan
    only = f"FILTER ({' AND '.join(conditions)})" if conditions else ""
    ends = "NULL, NULL" if one.words else f"min({column}) {only}, max({column}) {only}"
    unset = f"count(*) FILTER (isnan({column}::DOUBLE))" if one.nan else "0"
    return f"approx_count_distinct({column}), {ends}, count(*) {only}, {unset}, count(*)"


def _values(of: Sweep, one: SweptInput, where: str) -> np.ndarray:
    """The different numbers of an input, in order."""
    rows = of.runs.table.rows(f"SELECT DISTINCT {one.column} FROM {TABLE} WHERE {where}")
    values = np.unique(np.array([value for (value,) in rows], float))
    return values[~np.isnan(values) & ~(one.endless & (values == UNTIL_END))]


def _word_axis(of: Sweep, one: SweptInput, where: str) -> MapAxis:
    counts = of.runs.table.rows(
        f"SELECT {one.column}::VARCHAR, count(*) FROM {TABLE} WHERE {where} GROUP BY ALL"
    )
    return map_axes.of_words(one.title, counts, of.runs.robot.joints)
