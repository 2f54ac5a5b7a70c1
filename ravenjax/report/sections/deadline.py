"""Section "Deadlines": until when an action prevents harm, and if the fault is visible by then."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.errors import StoreError
from ravenjax.report import wording
from ravenjax.report.data import pair_intervals
from ravenjax.report.data.runs import UNINTENDED, Runs
from ravenjax.report.sections import robots
from ravenjax.stats import latency
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.units import Units
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
    goal_ms: Estimate  # latest time at which the action helps in a share GOAL; NaN: none
    goal: Rate  # faults whose harm the action prevents at that time
    half_ms: Estimate  # latest time at which the action helps in a share HALF
    in_time: Rate  # faults that are visible in a signal by the deadline
    margin_ms: Estimate  # median time from visible to deadline; NaN: less than half are visible
    not_monotone: int  # faults for which a later action prevents the harm, but an earlier does not
    harms_alone: int  # faults for which the action, without the fault, does harm too


class DeadlineSummary(NamedTuple):
    """The deadlines of a campaign."""

    harmful: int  # harmful faults with deadlines
    lacking: int  # harmful faults without deadlines
    counted: str  # unit of the intervals: "faults", "robots", or "" without intervals
    visible_ms: Estimate  # median time until a fault is visible; NaN: less than half are visible
    rows: list[DeadlineRow]

    def of(self, kind: str) -> dict[str, list[DeadlineRow]]:
        """Return the rows by name of site or group, most faults first. kind: as in DeadlineRow."""
        names: dict[str, list[DeadlineRow]] = {}
        for row in self.rows:
            if row.kind == kind:
                names.setdefault(row.name, []).append(row)
        return dict(sorted(names.items(), key=lambda item: -item[1][0].preventable.n))


def summarize_deadlines(runs: Runs, table: pd.DataFrame) -> DeadlineSummary:
    """Summarise a table of `ravenjax deadline`, which has a row per harmful fault and action."""
    faults = robots.faults_with_units(runs, "site::VARCHAR AS site", UNINTENDED)
    row_of_run = runs.table.frame("SELECT row, run_id AS run FROM results")
    joined = table.merge(row_of_run, on="run").merge(faults, on="row")
    # One row for all faults (""), and one for each site and group, with each action.
    rows = [
        _summarize(runs, kind, str(name), str(action), action_rows)
        for kind in ("", "site", "group")
        for name, part in (joined.groupby(kind) if kind else [("", joined)])
        for action, action_rows in part.groupby("action", sort=False)
    ]
    by_run = joined.drop_duplicates("run")
    drawn, noun = robots.drawn_units(runs, by_run)
    # A fault that is never visible has the time NaN.
    times = by_run["visible_ms"].fillna(np.inf).to_numpy()
    median_ms = latency.delay_quantile(times, np.isfinite(times), HALF, drawn)
    return DeadlineSummary(len(by_run), len(faults) - len(by_run), noun, median_ms, rows)


def _summarize(runs: Runs, kind: str, name: str, action: str, rows: pd.DataFrame) -> DeadlineRow:
    # Summarises the deadlines of one action over the faults in `rows`.
    drawn, _ = robots.drawn_units(runs, rows)
    last, margin = (rows[column].to_numpy(float) for column in ("deadline_ms", "margin_ms"))
    # Minus infinity: the action never helps, or the fault is never visible.
    last = np.where(last >= 0, last, -np.inf)
    margin = np.where(np.isnan(margin), -np.inf, margin)
    goal_ms = _latest_time(last, GOAL, drawn)
    return DeadlineRow(
        kind=kind,
        name=name,
        action=action,
        preventable=pair_intervals.pair_rate(last >= 0, drawn),
        goal_ms=goal_ms,
        goal=pair_intervals.pair_rate(last >= goal_ms.value, drawn),
        half_ms=_latest_time(last, HALF, drawn),
        in_time=pair_intervals.pair_rate(margin >= 0, drawn),
        margin_ms=_latest_time(margin, HALF, drawn),
        not_monotone=int((~rows["monotone"].to_numpy()).sum()),
        harms_alone=int(rows["harms_alone"].to_numpy().sum()),
    )


def _latest_time(values: np.ndarray, share: float, drawn: Units | None) -> Estimate:
    """Return the largest number that a share of the `values` reaches or exceeds; NaN if -inf."""
    return latency.delay_quantile(-values, np.isfinite(values), share, drawn).negated


def deadline_sentences(summary: DeadlineSummary) -> list[str]:
    """Return the summary as sentences, one per item."""
    return wording.fill_template("deadline.txt.j2", all=summary, words=ACTIONS, goal=GOAL)


def deadline_tables(summary: DeadlineSummary) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """Yield the title of each table, and its rows, of which the first has the headings."""
    # The rows of all faults have kind "" and name "".
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
    """Return a chart of the share of faults whose harm an action prevents, over its time."""
    most = float(table["deadline_ms"].to_numpy().max(initial=2))
    curves = []
    for number, (action, rows) in enumerate(table.groupby("action", sort=False)):
        # Below 0, no action after the effect helps. An action at the deadline still helps.
        deadlines = np.sort(rows["deadline_ms"].to_numpy(float))
        times_ms = np.unique(np.concatenate([[0.0], deadlines[deadlines >= 0] + 1]))
        share = 1 - np.searchsorted(deadlines, times_ms) / len(deadlines)
        name, colour = ACTIONS[str(action)], f"series{number}"
        curves.append(Curve.steps(name, colour, times_ms, share, start=1.0, end=most))
    return Chart(
        "Share of faults whose harm an action still prevents",
        ChartAxis(
            "time of the action after the fault's first effect", 1.0, most, log=True, unit="ms"
        ),
        ChartAxis("share of the harmful faults", 0.0, 1.0, share=True),
        tuple(curves),
    )


def _content(runs: Runs, folder: Path):
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


SECTIONS = {"deadline": _content}
