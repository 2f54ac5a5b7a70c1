"""Section "Deadlines": the last moment at which an action prevents the harm of a fault, and whether
the fault is visible by then.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.errors import StoreError
from ravenjax.report import wording
from ravenjax.report.data import pair_intervals
from ravenjax.report.data.runs import UNINTENDED, Runs
from ravenjax.report.sections import Section, robots
from ravenjax.stats import latency
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.access import explained

ACTIONS = {
    "pedal": "lifting the pedal",
    "estop": "pressing the E-stop",
    "stop": "a stop by the software",
    "hold": "holding the last good command",
    "cue": "a cue that the operator follows",
}
"""Actions in words."""
GOAL, HALF = 0.8, 0.5
"""Shares of the harmful faults for which the table states the time that an action has."""


class DeadlineRow(NamedTuple):
    """One action, over some harmful faults. Times are in ms after the first effect of a fault."""

    kind: str  # "" for all faults, "site" or "group"
    name: str
    action: str
    preventable: Rate  # faults whose harm the action prevents at some time from the effect on
    goal_ms: Estimate  # latest time at which it prevents the harm of GOAL of the faults; NaN: none
    goal: Rate  # faults whose harm it prevents at that time
    half_ms: Estimate  # the same for HALF
    in_time: Rate  # faults that a signal shows by the deadline
    margin_ms: Estimate  # median of deadline minus first visible; NaN: no signal shows half of them
    not_monotone: int
    harms_alone: int  # faults for which the action, without the fault, does harm too


class DeadlineSummary(NamedTuple):
    """The deadlines of a campaign."""

    harmful: int  # harmful faults with deadlines
    lacking: int  # harmful faults without
    counted: str  # unit of the intervals: "faults", "robots", or "" without intervals
    visible_ms: Estimate  # median; NaN: no signal shows half of the faults
    rows: list[DeadlineRow]

    def of(self, kind: str) -> dict[str, list[DeadlineRow]]:
        """Return the rows of each site or group, most faults first; of all faults for ""."""
        names: dict[str, list[DeadlineRow]] = {}
        for row in self.rows:
            if row.kind == kind:
                names.setdefault(row.name, []).append(row)
        return dict(sorted(names.items(), key=lambda item: -item[1][0].preventable.n))


def summarize_deadlines(runs: Runs, table: pd.DataFrame) -> DeadlineSummary:
    """Summarise a table of `ravenjax deadline`."""
    faults = robots.faults_with_units(runs, "site::VARCHAR AS site", UNINTENDED)
    row_of = runs.table.frame("SELECT row, run_id AS run FROM results")
    whole = table.merge(row_of, on="run").merge(faults, on="row")
    rows = [
        _summarize(runs, kind, str(name), str(action), some)
        for kind in ("", "site", "group")
        for name, part in (whole.groupby(kind) if kind else [("", whole)])
        for action, some in part.groupby("action", sort=False)
    ]
    once = whole.drop_duplicates("run")
    among, noun = robots.drawn_units(runs, once)
    visible = _latest(-once["visible_ms"].fillna(np.inf).to_numpy(), HALF, among)
    return DeadlineSummary(len(once), len(faults) - len(once), noun, _opposite(visible), rows)


def _summarize(runs: Runs, kind: str, name: str, action: str, some: pd.DataFrame) -> DeadlineRow:
    # One row of the table: how late an action still prevents the harm, and how often.
    among, _ = robots.drawn_units(runs, some)
    late, margin = (some[column].to_numpy(float) for column in ("deadline_ms", "margin_ms"))
    late, margin = np.where(late >= 0, late, -np.inf), np.where(margin == margin, margin, -np.inf)
    goal, half = (_latest(late, share, among) for share in (GOAL, HALF))
    return DeadlineRow(
        *(kind, name, action),
        pair_intervals.pair_rate(late >= 0, among),
        goal,
        pair_intervals.pair_rate(late >= goal.value, among),
        half,
        pair_intervals.pair_rate(margin >= 0, among),
        _latest(margin, HALF, among),
        *(int(hit.sum()) for hit in (~some["monotone"].to_numpy(), some["harms_alone"].to_numpy())),
    )


def _latest(values: np.ndarray, share: float, among: Units | None) -> Estimate:
    """Return the largest number that this share of the values reaches; NaN if that is -inf."""
    own = units.group_units(np.zeros(len(values), int)) if among is None else among
    return _opposite(latency.delay_quantile(-values, np.isfinite(values), share, own))


def _opposite(found: Estimate) -> Estimate:
    return Estimate(*(-number for number in (found.value, found.high, found.low)))


def deadline_sentences(summary: DeadlineSummary) -> list[str]:
    """Return the summary as sentences, one per item."""
    return wording.fill_template("deadline.txt.j2", all=summary, words=ACTIONS, goal=GOAL)


def deadline_tables(summary: DeadlineSummary) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """Yield the title of each table, and its rows, of which the first has the headings."""
    yield "Deadlines", wording.fill_table("deadline_actions.txt.j2", rows=summary.of("")[""])
    for kind in ("site", "group"):
        names = summary.of(kind)
        for title, share, time in (
            ("share that is preventable, median deadline in ms", "preventable", "half_ms"),
            ("share that is visible in time, median margin in ms", "in_time", "margin_ms"),
        ):
            columns = {"kind": kind, "names": names, "share": share, "time": time}
            yield f"By {kind}: {title}", wording.fill_table("deadline_kinds.txt.j2", **columns)


def deadline_chart(table: pd.DataFrame) -> Chart:
    """Return a chart of the share of harmful faults that each action prevents, by its time."""
    most = float(table["deadline_ms"].to_numpy().max(initial=2))
    curves = []
    for place, (action, some) in enumerate(table.groupby("action", sort=False)):
        late = np.sort(some["deadline_ms"].to_numpy(float))
        at = np.unique(np.concatenate([[0.0], late[late >= 0] + 1]))
        share = 1 - np.searchsorted(late, at) / len(late)
        name, colour = ACTIONS[str(action)], f"series{place}"
        curves.append(Curve.steps(name, colour, at, share, start=1.0, end=most))
    return Chart(
        "Until when an action prevents the harm",
        ChartAxis(
            "time of the action after the fault's first effect", 1.0, most, log=True, unit="ms"
        ),
        ChartAxis("share of the harmful faults", 0.0, 1.0, share=True),
        tuple(curves),
    )


def _content(runs: Runs, folder: Path) -> dict[str, Any] | None:
    try:
        table = explained.read_rows(folder / explained.DEADLINES, runs.manifest, "deadline")
    except StoreError as error:
        return {"broken": str(error)}
    if table is None or not len(table):
        return None
    summary = summarize_deadlines(runs, table)
    return {
        "broken": "",
        "deadlines": summary,
        "sentences": deadline_sentences(summary),
        "chart": deadline_chart(table),
        "tables": list(deadline_tables(summary)),
    }


SECTIONS = (Section("deadline", "Deadlines", 155, _content),)
