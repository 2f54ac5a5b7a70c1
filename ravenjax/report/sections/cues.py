"""Section "Haptic sweep": missed hazards and false cues of every haptic set, and the best threshold
according to the data.

A hazard is an unintended motion here. The cue missed the hazard if the run had no cue, or if the
golden run had a cue by the same time. A false cue is the first cue of a fault-free motion. Each
fault counts once.

If the confidence intervals of missed hazards and false cues leave only one best threshold
(`stats.alarms.choice`), the report names this threshold. Otherwise the report names all thresholds
that may be best, and the hours of fault-free motion that would decide between more of them.
"""

import math
from collections.abc import Sequence
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
from ravenjax.stats.alarms.choice import AlarmCounts, unbeaten_choices
from ravenjax.stats.alarms.false_alarms import AlarmRate, hours_to_bound
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.manifest import CueRecord

FELT = ("peak_force", "ms", "count")
"""Endings of the columns that describe a felt cue."""
HARMLESS = "sample AND faulty AND NOT unintended"


WEIGHTS = (1, 10, 100, 1000)
"""Number of false cues that a missed hazard weighs, if one hazard comes per hour."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)
_WEIGHT, _LIMIT = "a missed hazard weighs {} times a false cue", "false cues an hour: at most {}"
"""Texts of the two kinds of rules for the choice of a threshold."""
MOST_LISTED = 3
"""Thresholds that are listed individually. Of more, the least and the greatest are named."""


class CueRow(NamedTuple):
    """One haptic set."""

    number: int
    cue: CueRecord
    missed: Rate  # share of runs with an unintended motion
    false: Rate  # share of fault-free motions
    per_hour: AlarmRate | None
    # Of faulty runs without an unintended motion: those with a cue that the golden run does not
    # have.
    harmless: Rate
    # True if no other set has both fewer misses and fewer false cues.
    best: bool
    # True if it is a finding that the cue comes before the motion, not a consequence of the
    # definitions.
    leads: bool
    delay_ms: Estimate  # median over runs with a cue, from the fault's first effect
    # Of runs with an unintended motion: those with the cue before it.
    before: Rate
    lead_ms: Estimate  # median over these runs
    # Median over these runs of the largest force, in device units; NaN: never felt.
    force: float
    felt_ms: float  # median of the time with force in these runs, ms
    pulses: float  # median number of pulses in these runs

    @property
    def told(self) -> str:
        """Return the set in words."""
        return (
            f"{self.cue.threshold_mm:g} mm, Kp {self.cue.kp_per_mm:g}, Kd {self.cue.kd_s_per_mm:g}"
        )

    @property
    def hourly(self) -> float:
        """Return false cues per hour; 0 without any fault-free motion."""
        return self.per_hour.per_hour if self.per_hour else 0.0


class Choice(NamedTuple):
    """The best set under one rule, as far as the data decide it."""

    rule: str
    row: CueRow | None = None  # the best set; None: undecided, or no set keeps the rule
    alike: int = 0  # number of other sets that do exactly as well
    possible: str = ""  # if undecided: the thresholds that may be best, in words
    # Total hours of fault-free motion that would decide more; NaN if more motion would not.
    hours: float = math.nan
    remainder: str = ""  # thresholds that may be best even then; empty: only one
    # If undecided: the lowest threshold that certainly keeps a limit; NaN if none does.
    least_mm: float = math.nan


def cue_rows(runs: Runs) -> list[CueRow]:
    """Return one row per haptic set, sorted by threshold and gain."""
    free, cues = runs.motions(), runs.manifest.cues
    felt = runs.counts([f"warned{k}_ms >= 0" for k in range(len(cues))], where=HARMLESS)
    harmless = runs.count(HARMLESS)
    result = []
    for k, cue in enumerate(cues):
        times = tables.event_times(runs, after_onset(f"warned{k}_ms"))
        hazards = times.before.n
        medians = ", ".join(f"coalesce(median(cue{k}_{what}::DOUBLE), 'nan')" for what in FELT)
        came = f"{UNINTENDED} AND ({after_onset(f'warned{k}_ms')}) >= 0"
        result.append(
            CueRow(
                k,
                cue,
                tables.of_faults(runs, hazards - times.alarmed, hazards),
                tables.rate_of(free.came(f"golden_cue{k}_first_ms"), free.count),
                free.cue_rate(k),
                tables.of_faults(runs, felt[k], harmless),
                False,
                cue_leads(runs.manifest, k),
                times.half_ms,
                times.before,
                times.lead_ms,
                *runs.table.row(f"SELECT {medians} FROM {runs.those(came)}"),
            )
        )
    best = unbeaten_choices([row.missed.value for row in result], [row.hourly for row in result])
    result = [row._replace(best=bool(is_best)) for row, is_best in zip(result, best, strict=True)]
    return sorted(
        result, key=lambda row: (row.cue.threshold_mm, row.cue.kp_per_mm, row.cue.kd_s_per_mm)
    )


def choose_cues(runs: Runs, rows: Sequence[CueRow]) -> list[Choice]:
    """Return what the data choose for each of WEIGHTS and of FALSE_PER_HOUR.

    There are no choices without unintended or fault-free motion. `rows`: as returned by `rows`.
    """
    able = [row for row in rows if row.missed.n and row.per_hour is not None]
    if not able:
        return []
    alarms, hours = _alarm_counts(runs, able), runs.motions().hours
    # With a single threshold there is nothing to weigh.
    several = len({row.cue.threshold_mm for row in able}) > 1
    by_weight = [_cheapest(able, alarms, weight, hours) for weight in WEIGHTS if several]
    return [*by_weight, *(_rare(able, alarms, most) for most in FALSE_PER_HOUR)]


def hours_to_offer(of: Sequence[Choice]) -> float:
    """Return hours that would decide every limit, or else the next weight; 0 if none would."""
    able = [one for one in of if math.isfinite(one.hours)]
    limits = [one.hours for one in able if one.rule.startswith(_LIMIT.partition("{")[0])]
    return max(limits) if limits else min((one.hours for one in able), default=0.0)


def _alarm_counts(runs: Runs, rows: Sequence[CueRow]) -> AlarmCounts:
    came = [f"({after_onset(f'warned{row.number}_ms')} >= 0)::INTEGER" for row in rows]
    # Count joint patterns: each set's own misses do not show which hazards one set misses and
    # another catches.
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
    # The set of least cost, if a missed motion costs `weight` false cues.
    def possible(times: float) -> np.ndarray:
        return choice.cheapest_alarms(alarms, weight, times)

    cost = [weight * row.missed.value + row.hourly for row in rows]
    more = hours * choice.hours_to_decide(possible)
    now, rule = possible(1.0), _WEIGHT.format(f"{weight:,}")
    best = _choice(rule, rows, cost, now, now, more, possible(math.inf))
    return best._replace(least_mm=math.nan)


def _rare(rows: Sequence[CueRow], alarms: AlarmCounts, most: float) -> Choice:
    # The set that misses least with at most `most` false cues an hour.
    possible, keeps = choice.rarest_alarms(alarms, most)
    undecided = alarms.count[possible & ~keeps]
    more = hours_to_bound(most, int(undecided.min())) if len(undecided) else math.nan
    end, _ = choice.rarest_alarms(alarms, most, math.inf)
    cost, rule = [row.missed.value for row in rows], _LIMIT.format(f"{most:g}")
    return _choice(rule, rows, cost, possible, keeps, more, end)


def _choice(
    rule: str,
    rows: Sequence[CueRow],
    cost: Sequence[float],
    possible: np.ndarray,
    keeps: np.ndarray,
    hours: float,
    end: np.ndarray,
) -> Choice:
    """Return the choice under one rule. `possible`: sets that may be best; `end`: after endless
    hours. `keeps`: sets that certainly keep the rule. `hours` would decide more.
    """
    sure = np.flatnonzero(possible & keeps).tolist()
    thresholds, remainder = (
        sorted({rows[k].cue.threshold_mm for k in np.flatnonzero(which).tolist()})
        for which in (possible, end)
    )
    if len(thresholds) > 1 or not sure:
        return Choice(
            rule,
            possible=_words(thresholds),
            hours=hours if math.isfinite(hours) else math.nan,
            remainder=_words(remainder) if len(remainder) > 1 else "",
            least_mm=min((rows[k].cue.threshold_mm for k in sure), default=math.nan),
        )
    # Of equal sets, take the one with fewer false cues.
    best = rows[min(sure, key=lambda k: (cost[k], rows[k].hourly))]
    same = [row for row in rows if (row.missed, row.per_hour) == (best.missed, best.per_hour)]
    return Choice(rule, best, len(same) - 1)


def _words(thresholds: Sequence[float]) -> str:
    numbers = [f"{value:g}" for value in thresholds]
    if len(numbers) > MOST_LISTED:
        return f"{numbers[0]} to {numbers[-1]} mm"
    *first, last = numbers or [""]
    return f"{', '.join(first)} or {last} mm" if first else f"{last} mm" if last else ""


def cue_tradeoff(rows: Sequence[CueRow]) -> Chart | None:
    """Return a chart of missed hazards over false cues per hour, with one mark per set; None
    without either.

    A line joins the sets that no other set beats.
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
    missed = np.array([row.missed[-3:] for row, _ in pairs]).T
    hourly = np.array([one[-3:] for _, one in pairs]).T
    # Gains that change only the force coincide in one mark, which gets one label.
    thresholds = [row.cue.threshold_mm for row, _ in pairs]
    return Dots(
        name,
        colour,
        hourly[0],
        missed[0],
        *hourly[1:],
        *missed[1:],
        texts=tuple(
            "" if mm in thresholds[:place] else f"{mm:g} mm" for place, mm in enumerate(thresholds)
        ),
        tips=tuple(_words_of(row) for row, _ in pairs),
    )


def _words_of(row: CueRow) -> str:
    interval = (
        wording.format_interval(row.missed)
        or f"{wording.format_count(row.missed.k)} of {wording.format_count(row.missed.n)}"
    )
    missed = f"missed {wording.format_percent(row.missed.value)} ({interval})"
    hourly = f"{wording.format_number(row.hourly)} false cues an hour"
    force, felt_ms = wording.format_number(row.force), wording.format_number(row.felt_ms)
    return f"{row.told}: {missed}, {hourly}, peak force {force}, felt for {felt_ms} ms"


def _content(runs: Runs, folder: Path) -> dict[str, Any]:
    cues = cue_rows(runs)
    chosen = choose_cues(runs, cues)
    hours = hours_to_offer(chosen)
    return {
        "cues": cues,
        "choices": chosen,
        "tradeoff": cue_tradeoff(cues),
        "free_hours_wanted": hours,
        "free_recorded": bool((runs.manifest.config.get("operator") or {}).get("file")),
        "free_command": fault_free.fault_free_command(folder, runs.manifest, hours)
        if hours
        else None,
    }


SECTIONS = (Section("cues", "Haptic sweep", 60, _content),)
