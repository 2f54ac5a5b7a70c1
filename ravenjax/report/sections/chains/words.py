"""What carries and shows the evading faults, in sentences and rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ravenjax.report import wording
from ravenjax.report.sections.chains.carriers import Carrier, Passage, Propagation
from ravenjax.stats.intervals import Estimate, Rate

COLUMNS = (
    "signal",
    "layer",
    "differs before harm",
    "out of range before harm",
    "median lead",
    "visible there first",
)
"""Of the table of a terminal."""
NAMES = 3
"""Groups that are named where only some are explained, and places that are named first."""


def sentences(one: Propagation) -> list[str]:
    """What there is to say, a sentence an item."""
    if not one.evading:
        return ["No fault evades the checks: there is no silent harm to explain."]
    lines = [f"{_subject(one.evading)} the checks."]
    if not one.runs:
        return [
            *lines,
            "No group that is explained whole holds one of them, so no share can be told.",
        ]
    if one.partial:
        some, more = one.partial[:NAMES], len(one.partial) - NAMES
        names = ", ".join(some) + (f" and {wording.many(more, 'group')} more" if more > 0 else "")
        lines.append(
            f"Here are the {wording.count(one.runs)} of groups that are explained whole; not so"
            f" {names}."
        )
    return [*lines, *_visible(one)]


def _visible(one: Propagation) -> list[str]:
    n, visible = one.runs, one.runs - one.hidden.k
    if not visible:
        return [
            "In none of them did a signal leave its normal range before harm: no check of a range"
            " could have seen it."
        ]
    share = Rate(visible, n, visible / n, 1 - one.hidden.high, 1 - one.hidden.low)
    when = "it did so" if visible == 1 else "the median of them did so"
    lines = [
        f"In {_of(share)} some signal left its normal range before harm, where a check of that"
        f" range could have seen it; {when} {wording.estimate(one.lead_ms, 'ms')} before harm."
    ]
    first = one.first_places[:NAMES]
    lines.append(
        "Visible first at "
        + "; ".join(f"{row.seam}, {row.meaning}: {_of(row.first)}" for row in first)
        + "."
    )
    if one.hidden.k:
        lines.append(f"In {_of(one.hidden)} nothing left its range in time.")
    return lines


def table(one: Propagation) -> list[tuple[str, ...]]:
    """Rows of COLUMNS, in the robot's order; a layer is named where it changes."""
    rows, layer = [], ""
    for row in one.carriers:
        shows = (
            [brief(row.shows), lead(row.lead_ms), brief(row.first)]
            if row.ranged
            else ["no range", "", ""]
        )
        rows.append(
            (
                row.seam,
                row.layer if row.layer != layer else "",
                wording.percent(row.carries.value),
                *shows,
            )
        )
        layer = row.layer
    return rows


def brief(rate: Rate) -> str:
    """15.6 % (14.1–17.3 %)."""
    bounds = wording.interval(rate)
    return wording.percent(rate.value) + (f" ({bounds})" if bounds else "")


def lead(value: Estimate) -> str:
    """82 ms (71–90); empty where there is none."""
    return "" if math.isnan(value.value) else wording.estimate(value, "ms")


def as_dict(one: Propagation) -> dict[str, Any]:
    """As JSON has it."""
    own = {
        name: value for name, value in one._asdict().items() if name not in ("carriers", "passages")
    }
    own |= {
        "hidden": one.hidden._asdict(),
        "lead_ms": one.lead_ms._asdict(),
        "sentences": sentences(one),
    }
    return own | {"carriers": _objects(one.carriers), "passages": _objects(one.passages)}


def _objects(rows: Sequence[Carrier | Passage]) -> list[dict[str, Any]]:
    return [
        {
            name: value._asdict() if isinstance(value, Rate | Estimate) else value
            for name, value in row._asdict().items()
        }
        for row in rows
    ]


def _of(rate: Rate) -> str:
    """40 of 289 (13.8 %, 10.3–18.3 %)."""
    bounds = wording.interval(rate)
    inside = wording.percent(rate.value) + (f", {bounds}" if bounds else "")
    return f"{wording.count(rate.k)} of {wording.count(rate.n)} ({inside})"


def _subject(evading: int) -> str:
    return "1 fault evades" if evading == 1 else f"{wording.count(evading)} faults evade"
