"""Section "Haptic sweep": missed hazards and false cues of haptic sets, and the best threshold.

In this section a hazard is an unintended motion. A hazard is missed if no cue came, or if the cue
came no sooner than in the golden run. Of each fault one run counts. A fault-free motion with a cue
counts as one false cue, although the cue may come again.

If the confidence intervals of missed hazards and false cues leave only one best threshold
(`stats.alarms.choice`), the report names it. Otherwise the report names all thresholds that may be
best, and the hours of fault-free motion that would probably exclude some of them.
"""

import math
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.palette import CUE, SAME
from ravenjax.report import wording
from ravenjax.report.data import fault_free
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import DISTINCT_FAULTS, UNINTENDED, Runs, after_onset
from ravenjax.report.sections import tables
from ravenjax.stats.alarms import choice
from ravenjax.stats.alarms.choice import AlarmCounts, unbeaten_choices
from ravenjax.stats.alarms.false_alarms import AlarmRate, hours_to_bound
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.manifest import CueRecord

FELT = ("peak_force", "ms", "count")
"""Endings of the columns that describe a felt cue."""
HARMLESS = f"{DISTINCT_FAULTS} AND NOT unintended"
WEIGHTS = (1, 10, 100, 1000)
"""Costs of a missed hazard, in false cues, if one hazard occurs per hour."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)
_WEIGHT, _LIMIT = "a missed hazard weighs {} times a false cue", "false cues an hour: at most "
"""Texts of the two kinds of rules for the choice of a threshold. The limit follows its text."""
MOST_LISTED = 3
"""Largest number of thresholds that are listed. Of more, the least and the greatest are named."""


class CueRow(NamedTuple):
    """One haptic set."""

    number: int
    cue: CueRecord
    missed: Rate  # share of runs with an unintended motion
    false: Rate  # share of fault-free motions
    per_hour: AlarmRate | None
    harmless: Rate  # share of faulty runs without unintended motion with a cue, but no golden cue
    best: bool  # True if no other set has both fewer misses and fewer false cues
    delay_ms: Estimate  # median over runs with a cue, from the fault's first effect
    before: Rate  # share of runs with an unintended motion that have the cue before the motion
    lead_ms: Estimate  # median time from the cue to the motion over these runs
    force: float  # median over these runs of the largest force, in device units; NaN: never felt
    felt_ms: float  # median of the time with force in these runs, ms
    pulses: float  # median number of pulses in these runs

    @property
    def told(self) -> str:
        """The threshold and gains of the haptic set, in words."""
        cue = self.cue
        return f"{cue.threshold_mm:g} mm, Kp {cue.kp_per_mm:g}, Kd {cue.kd_s_per_mm:g}"

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
    motions, cues = runs.motions, runs.manifest.cues
    harmless = runs.count(HARMLESS)
    harmless_cued = runs.counts([f"warned{k}_ms >= 0" for k in range(len(cues))], where=HARMLESS)
    result = []
    for k, cue in enumerate(cues):
        times = tables.event_times(runs, after_onset(f"warned{k}_ms"))
        # `before` is a share of all hazards, so its n is their number.
        hazards = times.before.n
        medians = ", ".join(f"coalesce(median(cue{k}_{what}::DOUBLE), 'nan')" for what in FELT)
        cued_hazards = runs.matching(f"{UNINTENDED} AND ({after_onset(f'warned{k}_ms')}) >= 0")
        force, felt_ms, pulses = runs.table.row(f"SELECT {medians} FROM {cued_hazards}")
        cued_motions = motions.count_with_event(f"golden_cue{k}_first_ms")
        row = CueRow(
            number=k,
            cue=cue,
            missed=tables.fault_share(runs, hazards - times.alarmed, hazards),
            false=tables.wilson_share(cued_motions, motions.count),
            per_hour=motions.cue_rate(k),
            harmless=tables.fault_share(runs, harmless_cued[k], harmless),
            best=False,
            delay_ms=times.half_ms,
            before=times.before,
            lead_ms=times.lead_ms,
            force=force,
            felt_ms=felt_ms,
            pulses=pulses,
        )
        result.append(row)
    best = unbeaten_choices([row.missed.value for row in result], [row.hourly for row in result])
    result = [row._replace(best=bool(is_best)) for row, is_best in zip(result, best, strict=True)]
    return sorted(result, key=attrgetter("cue.threshold_mm", "cue.kp_per_mm", "cue.kd_s_per_mm"))


def choose_cues(runs: Runs, rows: Sequence[CueRow]) -> list[Choice]:
    """Return the best haptic set for each cost in WEIGHTS and each limit in FALSE_PER_HOUR.

    Without unintended or fault-free motion, the list is empty. rows: those of `cue_rows`.
    """
    usable = [row for row in rows if row.missed.n and row.per_hour is not None]
    if not usable:
        return []
    alarms, hours = _alarm_counts(runs, usable), runs.motions.hours
    choices = [_best_below_limit(usable, alarms, limit) for limit in FALSE_PER_HOUR]
    # With a single threshold, every cost chooses this threshold.
    if len({row.cue.threshold_mm for row in usable}) == 1:
        return choices
    return [*(_cheapest(usable, alarms, weight, hours) for weight in WEIGHTS), *choices]


def hours_to_offer(choices: Sequence[Choice]) -> float:
    """Return the hours of fault-free motion that would decide undecided choices; 0 if none would.

    The rule of a choice is a limit of false cues, or a cost of a missed hazard. If choices under a
    limit have finite hours, the result is the most of these. Otherwise it is the fewest hours of a
    choice under a cost.
    """
    hours_of_rules = {one.rule: one.hours for one in choices if math.isfinite(one.hours)}
    of_limits = [hours for rule, hours in hours_of_rules.items() if rule.startswith(_LIMIT)]
    return max(of_limits) if of_limits else min(hours_of_rules.values(), default=0.0)


def _alarm_counts(runs: Runs, rows: Sequence[CueRow]) -> AlarmCounts:
    # Counts missed hazards and false cues of the haptic sets, for the choice of a threshold.
    came = [f"({after_onset(f'warned{row.number}_ms')} >= 0)::INTEGER" for row in rows]
    # A pattern such as "011" has a digit per set: 1 if its cue came. Patterns show which hazards
    # one set misses and another set detects.
    patterns = runs.table.rows(
        f"SELECT concat({', '.join(came)}), count(*) FROM {FACTS} WHERE {UNINTENDED} GROUP BY ALL"
    )
    missed = np.array([[digit == "0" for digit in pattern] for pattern, _ in patterns])
    count = np.array([n for _, n in patterns])
    rates = [row.per_hour for row in rows if row.per_hour is not None]
    # missed: bool [patterns, sets]; count: number of hazards of each pattern. missed_by_first[i,
    # j]: number of hazards that set i misses and set j detects.
    return AlarmCounts(
        missed=count @ missed,
        missed_by_first=(missed * count[:, None]).T @ ~missed,
        hazards=int(count.sum()),
        count=np.array([rate.count for rate in rates]),
        hours=np.array([rate.hours for rate in rates]),
        sampled=runs.sampled(),
    )


def _cheapest(rows: Sequence[CueRow], alarms: AlarmCounts, weight: float, hours: float) -> Choice:
    # Chooses the set of least cost, if a missed hazard costs `weight` false cues. hours: present
    # hours of fault-free motion.
    def possible(factor: float):
        # Returns the sets that may be best after `factor` times as many hours.
        return choice.cheapest_alarms(alarms, weight, factor)

    cost = [weight * row.missed.value + row.hourly for row in rows]
    more_hours = hours * choice.factor_to_decide(possible)
    now, in_the_end = possible(1.0), possible(math.inf)
    rule = _WEIGHT.format(f"{weight:,}")
    # This rule has no limit. So every possible set is certain to keep the rule, and there is no
    # lowest threshold that keeps a limit.
    found = _choice(rule, rows, cost, now, certain=now, hours=more_hours, in_the_end=in_the_end)
    return found._replace(least_mm=math.nan)


def _best_below_limit(rows: Sequence[CueRow], alarms: AlarmCounts, most: float) -> Choice:
    # Chooses the set that misses fewest motions with at most `most` false cues an hour. possible,
    # within, in_the_end: see `_choice`.
    possible, within = choice.alarms_within_limit(alarms, most)
    undecided = alarms.count[possible & ~within]
    # More motion without a false cue shows that the next set keeps the limit.
    more_hours = hours_to_bound(most, int(undecided.min())) if len(undecided) else math.nan
    in_the_end, _ = choice.alarms_within_limit(alarms, most, math.inf)
    cost, rule = [row.missed.value for row in rows], f"{_LIMIT}{most:g}"
    return _choice(rule, rows, cost, possible, within, more_hours, in_the_end)


def _choice(
    rule: str,
    rows: Sequence[CueRow],
    cost: Sequence[float],
    possible: np.ndarray,
    certain: np.ndarray,
    hours: float,
    in_the_end: np.ndarray,
) -> Choice:
    """Return the choice of a threshold under one rule, or what is known if it is undecided. cost:
    [sets]. Bool [sets]: `possible` sets may be best, `certain` sets certainly keep the rule,
    `in_the_end` sets may be best even after endless fault-free motion. hours: of fault-free motion,
    with which fewer sets may be best. The choice is decided if all possible sets have the same
    threshold, and one or more of them are certain. Of these, the set of least cost is chosen.
    """
    certain_best = np.flatnonzero(possible & certain).tolist()
    # Thresholds in mm, ascending.
    possible_now, possible_in_the_end = (
        sorted({rows[k].cue.threshold_mm for k in np.flatnonzero(sets).tolist()})
        for sets in (possible, in_the_end)
    )
    if len(possible_now) > 1 or not certain_best:
        return Choice(
            rule,
            possible=_words(possible_now),
            hours=hours if math.isfinite(hours) else math.nan,
            remainder=_words(possible_in_the_end) if len(possible_in_the_end) > 1 else "",
            least_mm=min((rows[k].cue.threshold_mm for k in certain_best), default=math.nan),
        )
    # Of equal sets, take the one with fewer false cues.
    best = rows[min(certain_best, key=lambda k: (cost[k], rows[k].hourly))]
    equal = [row for row in rows if (row.missed, row.per_hour) == (best.missed, best.per_hour)]
    return Choice(rule, best, len(equal) - 1)


def _words(thresholds: Sequence[float]) -> str:
    texts = wording.fill_template("thresholds.txt.j2", thresholds=thresholds, most=MOST_LISTED)
    return "".join(texts)


def cue_tradeoff(rows: Sequence[CueRow]) -> Chart | None:
    """Return a chart of missed hazards over false cues per hour, with a mark for each haptic set.

    The chart is None without unintended or fault-free motion. A line joins the sets for which no
    other set has both fewer misses and fewer false cues.
    """
    shown = [(row, row.per_hour) for row in rows if row.missed.n and row.per_hour is not None]
    if not shown:
        return None
    best = sorted((rate.per_hour, row.missed.value) for row, rate in shown if row.best)
    front_x, front_y = np.array(best).reshape(-1, 2).T
    front = Curve("front", CUE, front_x, front_y, step=True, dashed=True, in_legend=False)
    marks: list[Mark] = [front]
    for is_best, name, colour in (
        (False, "another set is better in both", SAME),
        (True, "no set is better in both", CUE),
    ):
        pairs = [pair for pair in shown if pair[0].best == is_best]
        if pairs:
            marks.append(_marks(pairs, name, colour))
    # Largest false cues per hour and largest missed share. Of a chart without false cues, the axis
    # shows the upper end of the interval.
    x_most = max(rate.per_hour for _, rate in shown) or max(rate.high for _, rate in shown) or 1.0
    y_most = max(float(np.fmax(row.missed.value, row.missed.high)) for row, _ in shown) or 0.01
    x_axis = ChartAxis("false cues per hour of fault-free motion", 0.0, 1.1 * x_most)
    y_end = min(1.0, 1.05 * y_most)
    y_axis = ChartAxis("unintended motions without a cue", 0.0, y_end, share=True)
    return Chart("Missed hazards, false cues", x_axis, y_axis, tuple(marks))


def _marks(pairs: Sequence[tuple[CueRow, AlarmRate]], name: str, colour: str) -> Dots:
    # Returns marks for some haptic sets: false cues per hour, missed hazards, intervals. The last
    # three fields of both rates are the value and the ends of its interval.
    missed = np.array([row.missed[-3:] for row, _ in pairs]).T
    hourly = np.array([rate[-3:] for _, rate in pairs]).T
    # Sets that differ only in gains have the same mark, which gets only one label.
    thresholds = [row.cue.threshold_mm for row, _ in pairs]
    texts = tuple(f"{mm:g} mm" * (mm not in thresholds[:k]) for k, mm in enumerate(thresholds))
    tips = tuple(wording.fill_template("cue_tip.txt.j2", row=row)[0] for row, _ in pairs)
    bounds = *hourly[1:], *missed[1:]
    return Dots(name, colour, hourly[0], missed[0], *bounds, texts=texts, tips=tips)


def _content(runs: Runs, folder: Path):
    cues = cue_rows(runs)
    chosen = choose_cues(runs, cues)
    hours, manifest = hours_to_offer(chosen), runs.manifest
    return {
        "cues": cues,
        "choices": chosen,
        "tradeoff": cue_tradeoff(cues),
        "free_hours_wanted": hours,
        "free_recorded": bool((manifest.config.get("operator") or {}).get("file")),
        "free_command": fault_free.fault_free_command(folder, manifest, hours) if hours else None,
    }


SECTIONS = {"cues": _content}
