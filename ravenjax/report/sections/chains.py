"""Explained runs: the worst one by one, and what carries and shows all that evade, in sentences,
rows and charts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ravenjax.document import axes as printed
from ravenjax.document.chart import EMPTY, Chart, ChartAxis, Curve, Dots
from ravenjax.document.figure_style import STYLE
from ravenjax.document.palette import SAME
from ravenjax.document.ticks import above
from ravenjax.errors import StoreError
from ravenjax.report import wording
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.drawing import save_figure
from ravenjax.report.run import chain, chain_words
from ravenjax.report.sections import Section
from ravenjax.report.sections.carriers import Carrier, Passage, Propagation, propagation
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.access import explained
from ravenjax.store.access.query import RESULTS

MOST = 3
"""Chains that are shown."""
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
ROW = 16  # px of a seam
LEAST = 0.1
"""Share of the runs that a passage needs to be drawn."""


def sentences(one: Propagation) -> list[str]:
    """What there is to say, a sentence an item."""
    if not one.evading:
        return ["No fault evades the checks: there is no silent harm to explain."]
    verb = "evades" if one.evading == 1 else "evade"
    lines = [f"{wording.many(one.evading, 'fault')} {verb} the checks."]
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
        shows = ["no range", "", ""]
        if row.ranged:
            lead = "" if math.isnan(row.lead_ms.value) else wording.estimate(row.lead_ms, "ms")
            shows = [wording.rate(row.shows), lead, wording.rate(row.first)]
        layer_name = row.layer if row.layer != layer else ""
        rows.append((row.seam, layer_name, wording.percent(row.carries.value), *shows))
        layer = row.layer
    return rows


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


def graph(one: Propagation) -> Chart | None:
    """Seams in the robot's order, each at the share of runs that it carries, and at that of runs
    that it shows; lines are the passages from one to the next. None without runs."""
    if not one.carriers:
        return None
    place = {row.seam: number for number, row in enumerate(one.carriers)}
    carries = np.array([row.carries.value for row in one.carriers])
    lines = [
        Curve(
            "next to differ",
            SAME,
            carries[[place[step.before], place[step.after]]],
            np.array([place[step.before], place[step.after]], float),
            in_legend=number == 0,
        )
        for number, step in enumerate(step for step in one.passages if step.rate.value >= LEAST)
    ]
    ranged = [(row, row.shows) for row in one.carriers if row.ranged]
    carrying = [(row, row.carries) for row in one.carriers]
    return Chart(
        "Which signals carry and show the faults that evade",
        ChartAxis("share of evading faults", 0.0, 1.0, share=True),
        _rows(one.carriers),
        (
            *lines,
            *_dots("differs before harm", "series3", carrying, place, False),
            *_dots("leaves its normal range before harm", "series2", ranged, place, True),
        ),
        height=ROW * len(one.carriers),
    )


def leads(one: Propagation) -> Chart | None:
    """The median time from a signal's leaving its range to harm; None where none ever does
    before it.
    """
    rows = [row for row in one.carriers if row.shows.k]
    if not rows:
        return None
    place = {row.seam: number for number, row in enumerate(rows)}
    most = max(max(row.lead_ms.value, float(np.nan_to_num(row.lead_ms.high))) for row in rows)
    showing = [(row, row.lead_ms) for row in rows]
    return Chart(
        "How long before harm a signal leaves its range",
        ChartAxis("median, ms before harm", 0.0, above(1.02 * most), unit="ms"),
        _rows(rows),
        tuple(_dots("of the faults that it shows", "series2", showing, place, True)),
        height=ROW * len(rows),
    )


def draw(one: Propagation, path: Path) -> Path | None:
    """Both charts beside each other as a file (.svg, .png or .pdf); None without runs."""
    charts = [chart for chart in (graph(one), leads(one)) if chart is not None]
    if not charts:
        return None
    with matplotlib.rc_context(STYLE):
        figure = Figure(
            figsize=(5.4 * len(charts), 1.5 + 0.2 * len(one.carriers)), layout="constrained"
        )
        for axes, chart in zip(
            figure.subplots(1, len(charts), squeeze=False)[0], charts, strict=True
        ):
            printed.draw(chart, axes)
            axes.set_xlabel(chart.x.title)
            axes.tick_params("y", labelsize=8)
            axes.set_title(chart.title, loc="left", fontsize=9.5, fontweight="bold")
            axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), fontsize=8)
        save_figure(figure, path)
    return path


def _rows(carriers: Sequence[Carrier]) -> ChartAxis:
    names = tuple(row.seam for row in carriers)
    return ChartAxis("signals, in the robot's order", 0, len(carriers), names=names)


def _dots(
    name: str,
    colour: str,
    rows: Sequence[tuple[Carrier, Rate | Estimate]],
    place: dict[str, int],
    diamond: bool,
) -> list[Dots]:
    """One mark a row: those with an interval, and those without, of one name."""
    out = []
    for bounded in (True, False):
        mine = [
            (row, value)
            for row, value in rows
            if (math.isfinite(value.low) and math.isfinite(value.high)) == bounded
        ]
        if not mine:
            continue
        low, high = (np.array([value[end] for _, value in mine], float) for end in (-2, -1))
        out.append(
            Dots(
                name,
                colour,
                np.array([value.value for _, value in mine], float),
                np.array([place[row.seam] for row, _ in mine], float),
                x_low=low if bounded else EMPTY,
                x_high=high if bounded else EMPTY,
                tips=tuple(f"{row.seam}: {_words(value)}, {row.meaning}" for row, value in mine),
                diamond=diamond,
                in_legend=not out,
            )
        )
    return out


def _words(value: Rate | Estimate) -> str:
    if isinstance(value, Rate):
        return (
            f"{wording.percent(value.value)} ({wording.count(value.k)} of {wording.count(value.n)})"
        )
    return wording.estimate(value, "ms")


def _content(runs: Runs, folder: Path) -> dict[str, Any] | None:
    """Of the runs that `ravenjax explain` put beside a result; None where there are none of this
    campaign.
    """
    try:
        ticks = explained.read(folder / explained.FOLDER, runs.manifest)
    except StoreError as error:
        return {"broken": str(error)}
    if ticks is None or not len(ticks):
        return None
    together = propagation(runs, ticks)
    return {
        "broken": "",  # why explained runs could not be read
        "explained": len(ticks),
        "all": together,
        "sentences": sentences(together),
        "graph": graph(together),
        "leads": leads(together),
        "worst": _worst(runs, ticks),
    }


def _worst(runs: Runs, ticks: pd.DataFrame) -> list[dict[str, Any]]:
    """The explained runs that evade and went farthest; where none evades, those that went
    farthest.
    """
    manifest, far = runs.manifest, "coalesce(greatest(unintended_mm, loss_mm), 0)"
    rows = runs.table.rows(
        f"SELECT row FROM {RESULTS} JOIN (SELECT row, evaded FROM {FACTS} WHERE sample AND faulty)"
        f" USING (row) WHERE row IN (SELECT unnest(?)) ORDER BY evaded DESC, isnan({far}), {far}"
        f" DESC, row LIMIT {MOST}",
        [ticks["index"].tolist()],
    )
    by_row = ticks.set_index("index", drop=False)
    out = []
    for row in runs.numbered([row for (row,) in rows]):
        own = by_row.loc[int(row["index"])].to_dict()
        one = chain.chain(row, own, manifest.robot, manifest.shape.arms, manifest.rules.cue)  # type: ignore[arg-type]
        words = chain_words.sentences(one)
        out.append({"chain": one, "sentences": words, "timeline": chain_words.timeline(one)})
    return out


SECTIONS = (Section("chains", "Chains", 150, _content),)
