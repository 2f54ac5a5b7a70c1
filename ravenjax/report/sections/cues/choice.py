"""Which haptic threshold the data would choose, and what they need where they cannot choose yet.

A threshold is named where the intervals of what each set misses and how often it comes for nothing
decide it (`stats.alarms.choice`), else the thresholds that may be best are, and the hours of
fault-free motion that would tell more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs, after_onset
from ravenjax.report.sections.cues.sweep import CueRow
from ravenjax.stats.alarms import choice
from ravenjax.stats.alarms.choice import AlarmCounts
from ravenjax.stats.sample_size.planning import hours_to_bound

WEIGHTS = (1, 10, 100, 1000)
"""How many false cues a missed hazard weighs, where one hazard comes an hour."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)
_WEIGHT, _LIMIT = "a missed hazard weighs {} times a false cue", "false cues an hour: at most {}"
"""The two kinds of rules."""
MOST_LISTED = 3
"""Thresholds that are listed one by one; of more, the least and the greatest are named."""


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


def choices(runs: Runs, rows: Sequence[CueRow]) -> list[Choice]:
    """What the data choose for each of WEIGHTS and of FALSE_PER_HOUR, neighbours with the same
    choice in one; none without unintended or fault-free motion. rows: as of `cue_sweep.rows`."""
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
    limits = [
        one.hours
        for one in of
        if one.rule.startswith(_LIMIT.partition("{")[0]) and math.isfinite(one.hours)
    ]
    return (
        max(limits)
        if limits
        else min((one.hours for one in of if math.isfinite(one.hours)), default=0.0)
    )


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

    cost = [weight * row.missed.value + _per_hour(row) for row in rows]
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
    best = rows[min(sure, key=lambda k: (cost[k], _per_hour(rows[k])))]
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
        _, best = one
        return (
            best.row.number if best.row else None,
            best.possible,
            f"{best.hours:.3g} {best.least_mm:g}",
        )

    for _, group in itertools.groupby(by_number, key=content):
        alike = list(group)
        numbers = alike[0][0] if len(alike) == 1 else f"{alike[0][0]} to {alike[-1][0]}"
        yield alike[0][1]._replace(rule=rule.format(numbers))


def _per_hour(row: CueRow) -> float:
    return row.per_hour.per_hour if row.per_hour is not None else 0.0
