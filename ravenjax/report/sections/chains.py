"""Section "Chains": how the faults that evade propagate through the signals, with worst runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.errors import StoreError
from ravenjax.report import wording
from ravenjax.report.data import pair_intervals
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import DISTINCT_FAULTS, HARMFUL_EVADING, Runs
from ravenjax.report.drawing import save_panels
from ravenjax.report.run import chain, chain_words
from ravenjax.report.sections import robots
from ravenjax.stats import latency
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.access import explained
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import Manifest

SHOWN_CHAINS = 3
"""Number of chains that are shown."""
MAX_NAMES = 3
"""Number of groups that are named if only some are explained, and of first places."""
ROW_PX = 16  # px per seam


def chain_sentences(one: Propagation) -> list[str]:
    """Return the summary as sentences, one per item."""
    return wording.fill_template("chains.txt.j2", all=one, most=MAX_NAMES)


def seam_graph(summary: Propagation) -> Chart | None:
    """Return a chart of the seams in the robot's order; None without runs.

    Each seam has two marks: the share of runs in which its signal differs from the golden run
    before harm, and the share in which the signal leaves its normal range before harm.
    """
    if not summary.carriers:
        return None
    shows = [row.shows if row.has_range else None for row in summary.carriers]
    return _signal_chart(
        "In which signals faults that evade differ, and are visible",
        ChartAxis("share of evading faults", 0.0, 1.0, share=True),
        summary.carriers,
        ("differs before harm", "series3", [row.carries for row in summary.carriers]),
        ("leaves its normal range before harm", "series2", shows),
    )


def lead_chart(summary: Propagation) -> Chart | None:
    """Return a chart of each signal's median time from visible to harm; None if never visible."""
    rows = [row for row in summary.carriers if row.shows.k]
    if not rows:
        return None
    most = max(max(row.lead_ms.value, float(np.nan_to_num(row.lead_ms.high))) for row in rows)
    return _signal_chart(
        "How long before harm a signal leaves its range",
        ChartAxis("median, ms before harm", 0.0, 1.05 * most, unit="ms"),
        rows,
        ("of the faults visible in the signal", "series2", [row.lead_ms for row in rows]),
    )


def draw_charts(summary: Propagation, path: Path) -> bool:
    """Write both charts as a file (.svg, .png or .pdf); return False without runs."""
    charts = [chart for chart in (seam_graph(summary), lead_chart(summary)) if chart is not None]
    if charts:
        save_panels(path, charts, columns=1)
    return bool(charts)


def _signal_chart(
    title: str,
    axis: ChartAxis,
    carriers: Sequence[Carrier],
    *marks: tuple[str, str, Sequence[Rate | Estimate | None]],
) -> Chart:
    """Return a chart with a row for each seam. marks: name, colour and one value per row of each
    series. Marks of the last one are diamonds.
    """
    dots = []
    for name, colour, values in marks:
        known = [(row, value) for row, value in enumerate(values) if value is not None]
        # The last three fields of a rate and of an estimate: value, low, high.
        value, low, high = np.array([value[-3:] for _, value in known], float).reshape(-1, 3).T
        tips = [
            wording.fill_template("carrier_tip.txt.j2", carrier=carriers[row], value=value)[0]
            for row, value in known
        ]
        y, is_last = np.array([row for row, _ in known], float), values is marks[-1][2]
        dots.append(Dots(name, colour, value, y, low, high, tips=tuple(tips), diamond=is_last))
    names = tuple(row.seam for row in carriers)
    signals = ChartAxis("signals, in the robot's order", 0, len(carriers), names=names)
    return Chart(title, axis, signals, tuple(dots), height=ROW_PX * len(carriers))


def _content(runs: Runs, folder: Path):
    try:
        ticks = explained.read_explained(folder / explained.FOLDER, runs.manifest)
    except StoreError as error:
        return {"broken": str(error)}
    if ticks is None or not len(ticks):
        return None
    together = summarize_chains(runs, ticks)
    return {
        "broken": "",  # reason why explained runs could not be read
        "explained": len(ticks),
        "all": together,
        "sentences": chain_sentences(together),
        "graph": seam_graph(together),
        "leads": lead_chart(together),
        "worst": _explain_worst_runs(runs, ticks),
    }


def _explain_worst_runs(runs: Runs, ticks: pd.DataFrame):
    # Returns the chains of the explained runs with the largest tip excursions, evading runs first.
    manifest, excursion_mm = runs.manifest, "coalesce(greatest(unintended_mm, loss_mm), 0)"
    facts = f"(SELECT row, evaded FROM {FACTS} WHERE {DISTINCT_FAULTS})"
    # NaN comes last.
    order = f"evaded DESC, isnan({excursion_mm}), {excursion_mm} DESC, row"
    rows = runs.table.rows(
        f"SELECT row FROM {RESULTS} JOIN {facts} USING (row) WHERE row IN (SELECT unnest(?))"
        f" ORDER BY {order} LIMIT {SHOWN_CHAINS}",
        [ticks["index"].tolist()],
    )
    by_row = ticks.set_index("index", drop=False)
    worst = []
    for row in runs.whole_rows([row for (row,) in rows]):
        ticks_row = by_row.loc[int(row["index"])].to_dict()
        arms, cue = manifest.shape.arms, manifest.rules.cue
        link = chain.trace_chain(row, ticks_row, manifest.robot, arms, cue)  # type: ignore[arg-type]
        words, timeline = chain_words.chain_sentences(link), chain_words.chain_timeline(link)
        worst.append({"chain": link, "sentences": words, "timeline": timeline})
    return worst


class Carrier(NamedTuple):
    """One seam, over the runs of a `Propagation`."""

    seam: str
    layer: str
    meaning: str
    has_range: bool  # True if the seam has a normal range
    carries: Rate  # runs in which the signal differs from the golden run before harm
    shows: Rate  # runs in which the fault is visible in the signal before harm
    lead_ms: Estimate  # median time from visible to harm; NaN: never visible
    # Share of runs in which the fault was visible in this seam first. Of several seams with the
    # same tick, the first in the robot's order counts.
    first: Rate


class Propagation(NamedTuple):
    """How the evading faults of a campaign propagated."""

    runs: int  # explained evading faults in this summary
    evading: int  # evading faults of the campaign
    groups: Sequence[str]  # groups whose evading faults are all explained
    partial: Sequence[str]  # groups of which only some or no evading faults are explained
    counted: str  # unit of the intervals: "faults", "robots", or "" without intervals
    carriers: Sequence[Carrier]  # seams that differ before harm in some run, in the robot's order
    hidden: Rate  # runs whose fault was visible in no signal before harm
    lead_ms: Estimate  # median time from visible in any signal to harm

    @property
    def visible(self) -> Rate:
        """The share of runs whose fault was visible in some signal before harm."""
        hidden = self.hidden
        k = hidden.n - hidden.k
        # Of the remaining share, the lower bound follows from the upper bound, and vice versa.
        return Rate(k, hidden.n, k / hidden.n, 1 - hidden.high, 1 - hidden.low)

    @property
    def first_places(self) -> list[Carrier]:
        """Return the signals at which runs were visible first, most frequent first."""
        return sorted((row for row in self.carriers if row.first.k), key=lambda row: -row.first.k)


def summarize_chains(runs: Runs, ticks: pd.DataFrame) -> Propagation:
    """Summarise how faults propagate in explained runs.

    ticks: table of `store.access.explained`, one row per run.
    """
    evading = robots.faults_with_units(runs, "unintended_ms AS harm", HARMFUL_EVADING)
    # Only groups whose evading faults are all explained are summarised.
    partial = set(evading.loc[~evading["row"].isin(ticks["index"]), "group"])
    complete = sorted(set(evading["group"]) - partial)
    faults = evading.loc[evading["group"].isin(complete)].reset_index(drop=True)
    rows = ticks.set_index("index").loc[faults["row"]]
    drawn, noun = robots.drawn_units(runs, faults)

    def rate(hit: np.ndarray):
        return pair_intervals.pair_rate(hit, drawn)

    def median(values: np.ndarray):
        """Return the median of the values above 0, which are times of events that happened."""
        positive = values > 0
        times = values[positive]
        units = drawn.where(positive) if drawn else None
        return latency.delay_quantile(times, np.ones_like(times, bool), 0.5, units)

    harm = faults["harm"].to_numpy(np.int64)
    seams = _join_arms(rows, runs.manifest)
    # Time from leaving the normal range to harm, ms [seams, runs]; 0: not visible before harm.
    leaves = np.array([seam.leaves for seam in seams]).reshape(len(seams), len(harm))
    leads = np.where((leaves >= 0) & (leaves < harm), harm - leaves, 0)
    # The first seam in which a fault is visible has the longest lead.
    longest = leads.max(axis=0, initial=0)
    firsts = leads.argmax(axis=0) if len(seams) else np.zeros(len(faults), int)
    carriers = []
    for index, (seam, lead) in enumerate(zip(seams, leads, strict=True)):
        carries, shows = rate((seam.differs >= 0) & (seam.differs <= harm)), rate(lead > 0)
        first = rate((firsts == index) & (longest > 0))
        names = seam.name, seam.layer, seam.meaning, seam.has_range
        if carries.k:
            carriers.append(Carrier(*names, carries, shows, median(lead), first))
    hidden, lead_ms = rate(longest == 0), median(longest)
    return Propagation(
        len(faults), len(evading), complete, sorted(partial), noun, carriers, hidden, lead_ms
    )


def _join_arms(rows: pd.DataFrame, manifest: Manifest):
    """Return the signals with both arms joined, at the earlier time, in the robot's order."""
    columns = {str(name): rows[name].to_numpy() for name in rows}
    by_seam: dict[str, list[chain.SignalTicks]] = {}
    if len(rows):
        for seam in chain.list_signals(columns, manifest.robot, manifest.shape.arms):
            by_seam.setdefault(seam.name.rpartition("/")[2], []).append(seam)
    joined = []
    for name, arms in by_seam.items():
        differs, leaves = (
            chain.earliest_time(np.stack([getattr(seam, key) for seam in arms]))
            for key in ("differs", "leaves")
        )
        joined.append(arms[0]._replace(name=name, differs=differs, leaves=leaves))
    return joined


SECTIONS = {"chains": _content}
