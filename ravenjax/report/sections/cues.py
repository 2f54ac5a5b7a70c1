"""Section "Haptic sweep": missed hazards and false cues of every haptic set, and the threshold that
the data choose.

A hazard, an unintended motion, is missed where its run had no cue, or one that the golden run had
by then, too: such a cue tells of the motion and not of the fault. A false cue is the first one of a
fault-free motion. Rates are of one run of each fault.

A threshold is named where the intervals of what each set misses and how often it comes for nothing
decide it (`stats.alarms.choice`), else the thresholds that may be best are, and the hours of
fault-free motion that would tell more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.palette import CUE, SAME
from ravenjax.report import wording
from ravenjax.report.data import fault_free
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs, after_onset, cue_leads
from ravenjax.report.sections import Section, tables
from ravenjax.stats.alarms import choice
from ravenjax.stats.alarms.choice import AlarmCounts, front
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.sample_size.planning import hours_to_bound
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import CueRecord

FELT = ("peak_force", "ms", "count")
"""What is told of a cue that is felt, by the ends of its columns."""
MOST = 500_000
"""Runs that the medians of what is felt are of; of more, about so many are drawn."""
HARMLESS = "sample AND faulty AND NOT unintended"


WEIGHTS = (1, 10, 100, 1000)
"""How many false cues a missed hazard weighs, where one hazard comes an hour."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)
_WEIGHT, _LIMIT = "a missed hazard weighs {} times a false cue", "false cues an hour: at most {}"
"""The two kinds of rules."""
MOST_LISTED = 3
"""Thresholds that are listed one by one; of more, the least and the greatest are named."""
_ENDS = ("low", "high")


class CueRow(NamedTuple):
    """One haptic set."""

    number: int
    cue: CueRecord
    missed: Rate  # of runs with an unintended motion
    false: Rate  # of fault-free motions
    per_hour: AlarmRate | None
    # of faulty runs without an unintended motion, those with a cue that the golden run has not
    harmless: Rate
    best: bool  # no other set misses and disturbs as little
    # whether it is a finding that it comes before the motion, and no matter of definitions
    leads: bool
    delay_ms: Estimate  # median over those, from the fault's first effect
    before: Rate  # of runs with an unintended motion, those with the cue before it
    lead_ms: Estimate  # median over those
    force: float  # median of the largest force where felt in those, device units; NaN: never felt
    felt_ms: float  # median of the time with force there, ms
    pulses: float  # median number of pulses there

    @property
    def told(self) -> str:
        """The set in words."""
        return (
            f"{self.cue.threshold_mm:g} mm, Kp {self.cue.kp_per_mm:g}, Kd {self.cue.kd_s_per_mm:g}"
        )

    @property
    def hourly(self) -> float:
        """False cues an hour; 0 without any fault-free motion."""
        return self.per_hour.per_hour if self.per_hour else 0.0


class Choice(NamedTuple):
    """Which set is best by one rule, as far as the data decide it."""

    rule: str
    row: CueRow | None  # the best; None: undecided, or no set keeps the rule
    alike: int  # other sets that do exactly as well
    possible: str  # where it is undecided: the thresholds that may be best, in words
    # where fault-free motion would decide more: how many hours of it, in all; NaN: it would not
    hours: float
    remainder: str  # the thresholds that may be best even then; empty: one alone
    # where it is undecided: the lowest threshold that certainly keeps a limit; NaN: none does
    least_mm: float

    @property
    def several(self) -> bool:
        """Whether several thresholds may be best."""
        return " or " in self.possible or " to " in self.possible


def rows(runs: Runs) -> list[CueRow]:
    """One row a haptic set, by threshold and gain; intervals where all faults were drawn."""
    free, cues = runs.motions(), runs.manifest.cues
    felt = runs.counts([f"warned{k}_ms >= 0" for k in range(len(cues))], where=HARMLESS)
    harmless = runs.count(HARMLESS)
    columns = [f"{RESULTS}.cue{k}_{what}" for k in range(len(cues)) for what in FELT]
    times = [f"warned{k}_ms" for k in range(len(cues))]
    sample = runs.drawn(", ".join([f"{FACTS}.active_ms", *times, *columns]), UNINTENDED, MOST)
    result = []
    for k, cue in enumerate(cues):
        delay, lead = tables.times(runs, f"warned{k}_ms")
        came = sample.loc[sample[f"warned{k}_ms"] >= sample["active_ms"].clip(lower=0)]
        result.append(
            CueRow(
                k,
                cue,
                tables.of_faults(runs, lead.n - lead.alarmed, lead.n),
                tables.rate_of(free.came(f"golden_cue{k}_first_ms"), free.count),
                free.cue_rate(k),
                tables.of_faults(runs, felt[k], harmless),
                False,
                cue_leads(runs.manifest, k),
                tables.known(runs, delay.quantile_interval(0.5)),
                tables.known(runs, lead.before),
                tables.known(runs, lead.quantile(0.5)),
                *(float(came[f"cue{k}_{what}"].median()) for what in FELT),
            )
        )
    best = front([row.missed.value for row in result], [row.hourly for row in result])
    result = [row._replace(best=bool(is_best)) for row, is_best in zip(result, best, strict=True)]
    return sorted(
        result, key=lambda row: (row.cue.threshold_mm, row.cue.kp_per_mm, row.cue.kd_s_per_mm)
    )


def choices(runs: Runs, rows: Sequence[CueRow]) -> list[Choice]:
    """What the data choose for each of WEIGHTS and of FALSE_PER_HOUR, neighbours with the same
    choice in one; none without unintended or fault-free motion. rows: as of `rows`."""
    able = [row for row in rows if row.missed.n and row.per_hour is not None]
    if not able:
        return []
    alarms, hours = _alarm_counts(runs, able), runs.motions().hours
    several = len({row.cue.threshold_mm for row in able}) > 1  # else there is nothing to weigh
    by_weight = [
        (f"{weight:,}", _cheapest(able, alarms, weight, hours)) for weight in WEIGHTS if several
    ]
    by_limit = [(f"{most:g}", _rare(able, alarms, most)) for most in FALSE_PER_HOUR]
    return [*_grouped(_WEIGHT, by_weight), *_grouped(_LIMIT, by_limit)]


def hours_to_offer(of: Sequence[Choice]) -> float:
    """Hours of fault-free motion that would decide every limit of false cues an hour, or else the
    next of the weights; 0 where more hours would decide nothing."""
    able = [one for one in of if math.isfinite(one.hours)]
    limits = [one.hours for one in able if one.rule.startswith(_LIMIT.partition("{")[0])]
    return max(limits) if limits else min((one.hours for one in able), default=0.0)


def _alarm_counts(runs: Runs, rows: Sequence[CueRow]) -> AlarmCounts:
    """What the sets miss of the same hazards, and how often they come for nothing."""
    came = [f"({after_onset(f'warned{row.number}_ms')} >= 0)::INTEGER" for row in rows]
    # together, since what each set misses says nothing of what one misses and another does not
    patterns = runs.table.rows(
        f"SELECT concat({', '.join(came)}), count(*) FROM {FACTS} WHERE {UNINTENDED} GROUP BY ALL"
    )
    missed = np.array([[letter == "0" for letter in pattern] for pattern, _ in patterns])
    count = np.array([n for _, n in patterns])
    rates = [row.per_hour for row in rows if row.per_hour is not None]
    return AlarmCounts(
        count @ missed,
        (missed * count[:, None]).T @ ~missed,
        int(count.sum()),
        np.array([rate.count for rate in rates]),
        np.array([rate.hours for rate in rates]),
        runs.sampled(),
    )


def _cheapest(rows: Sequence[CueRow], alarms: AlarmCounts, weight: float, hours: float) -> Choice:
    def possible(times: float) -> np.ndarray:
        return choice.cheapest(alarms, weight, times)

    cost = [weight * row.missed.value + row.hourly for row in rows]
    more = hours * choice.hours_to_decide(possible)
    best = _choice(rows, cost, possible(1.0), possible(1.0), more, possible(math.inf))
    return best._replace(least_mm=math.nan)


def _rare(rows: Sequence[CueRow], alarms: AlarmCounts, most: float) -> Choice:
    possible, keeps = choice.rare(alarms, most)
    undecided = alarms.count[possible & ~keeps]
    more = hours_to_bound(most, int(undecided.min())) if len(undecided) else math.nan
    end, _ = choice.rare(alarms, most, math.inf)
    return _choice(rows, [row.missed.value for row in rows], possible, keeps, more, end)


def _choice(
    rows: Sequence[CueRow],
    cost: Sequence[float],
    possible: np.ndarray,
    keeps: np.ndarray,
    hours: float,
    end: np.ndarray,
) -> Choice:
    """possible: which may be the best; keeps: which certainly keep the rule; hours: that would
    decide more; end: which may be the best after endless hours."""
    sure = np.flatnonzero(possible & keeps).tolist()
    thresholds, remainder = (_thresholds(rows, which) for which in (possible, end))
    if len(thresholds) > 1 or not sure:
        return Choice(
            "",
            None,
            0,
            _words(thresholds),
            hours if math.isfinite(hours) else math.nan,
            _words(remainder) if len(remainder) > 1 else "",
            min((rows[k].cue.threshold_mm for k in sure), default=math.nan),
        )
    # of equals that with fewer false cues
    best = rows[min(sure, key=lambda k: (cost[k], rows[k].hourly))]
    same = [row for row in rows if (row.missed, row.per_hour) == (best.missed, best.per_hour)]
    return Choice("", best, len(same) - 1, "", math.nan, "", math.nan)


def _thresholds(rows: Sequence[CueRow], which: np.ndarray) -> list[float]:
    """Different thresholds of some sets, mm, in order."""
    return sorted({row.cue.threshold_mm for row, is_one in zip(rows, which, strict=True) if is_one})


def _words(thresholds: Sequence[float]) -> str:
    """2, 3 or 5 mm; 2 to 8 mm where there are many; empty where there are none."""
    numbers = [f"{value:g}" for value in thresholds]
    if len(numbers) > MOST_LISTED:
        return f"{numbers[0]} to {numbers[-1]} mm"
    *first, last = numbers or [""]
    return f"{', '.join(first)} or {last} mm" if first else f"{last} mm" if last else ""


def _grouped(rule: str, by_number: Sequence[tuple[str, Choice]]) -> Iterator[Choice]:
    """One choice for neighbours that agree."""

    def content(one: tuple[str, Choice]) -> tuple[object, ...]:
        best = one[1]
        number = best.row.number if best.row else None
        return number, best.possible, f"{best.hours:.3g} {best.least_mm:g}"

    for _, group in itertools.groupby(by_number, key=content):
        alike = list(group)
        numbers = alike[0][0] if len(alike) == 1 else f"{alike[0][0]} to {alike[-1][0]}"
        yield alike[0][1]._replace(rule=rule.format(numbers))


def tradeoff(rows: Sequence[CueRow]) -> Chart | None:
    """Missed hazards over false cues an hour, one mark a set, those that none beats joined; None
    without either.
    """
    able = [(row, row.per_hour) for row in rows if row.missed.n and row.per_hour is not None]
    if not able:
        return None
    best = sorted((hourly.per_hour, row.missed.value) for row, hourly in able if row.best)
    front_x, front_y = np.array(best).reshape(-1, 2).T
    marks: list[Mark] = [
        Curve("front", CUE, front_x, front_y, step=True, dashed=True, in_legend=False)
    ]
    for is_best, name, colour in (
        (False, "beaten by another", SAME),
        (True, "no other does better", CUE),
    ):
        mine = [pair for pair in able if pair[0].best == is_best]
        if mine:
            marks.append(_marks(mine, name, colour))
    most = max(one.per_hour for _, one in able) or max(one.high for _, one in able) or 1.0
    missed = max(float(np.fmax(row.missed.value, row.missed.high)) for row, _ in able) or 0.01
    up = "unintended motions without a cue"
    return Chart(
        "Missed hazards, false cues",
        ChartAxis("false cues per hour of fault-free motion", 0.0, 1.1 * most),
        ChartAxis(up, 0.0, min(1.0, 1.05 * missed), share=True),
        tuple(marks),
    )


def _marks(pairs: Sequence[tuple[CueRow, AlarmRate]], name: str, colour: str) -> Dots:
    force = np.array([row.force for row, _ in pairs])
    largest = force[np.isfinite(force)].max(initial=0.0)
    scale = np.nan_to_num(force / largest) if largest > 0 else np.zeros(len(pairs))
    low, high = (np.array([getattr(row.missed, end) for row, _ in pairs]) for end in _ENDS)
    hourly_low, hourly_high = (np.array([getattr(one, end) for _, one in pairs]) for end in _ENDS)
    first: dict[float, CueRow] = {}
    for row, _ in pairs:  # gains that change only the force fall on one mark: one label for them
        first.setdefault(row.cue.threshold_mm, row)
    named = [first[row.cue.threshold_mm] is row for row, _ in pairs]
    return Dots(
        name,
        colour,
        np.array([one.per_hour for _, one in pairs]),
        np.array([row.missed.value for row, _ in pairs]),
        hourly_low,
        hourly_high,
        low,
        high,
        size=tuple((9 + 5 * scale).round(1).tolist()),
        texts=tuple(
            f"{row.cue.threshold_mm:g} mm" if is_first else ""
            for (row, _), is_first in zip(pairs, named, strict=True)
        ),
        tips=tuple(_words_of(row) for row, _ in pairs),
    )


def _words_of(row: CueRow) -> str:
    interval = (
        wording.interval(row.missed)
        or f"{wording.count(row.missed.k)} of {wording.count(row.missed.n)}"
    )
    missed = f"missed {wording.percent(row.missed.value)} ({interval})"
    hourly = f"{wording.number(row.hourly)} false cues an hour"
    felt = f"peak force {wording.number(row.force)}, felt for {wording.number(row.felt_ms)} ms"
    return f"{row.told}: {missed}, {hourly}, {felt}"


def _content(runs: Runs, folder: Path) -> dict[str, Any]:
    cues = rows(runs)
    chosen = choices(runs, cues)
    hours = hours_to_offer(chosen)
    return {
        "cues": cues,
        "choices": chosen,
        "tradeoff": tradeoff(cues),
        "felt_runs": min(MOST, cues[0].missed.n) if cues else 0,
        "free_hours_wanted": hours,
        "free_recorded": bool((runs.manifest.config.get("operator") or {}).get("file")),
        "free_command": fault_free.command(folder, runs.manifest, hours) if hours else None,
    }


SECTIONS = (Section("cues", "Haptic sweep", 60, _content),)
