"""A finding in sentences and tables. Every number in them is computed from it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ravenjax.analyses.monitors.counterfactual.candidates import SMALLEST_SCALE, Candidate
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.analyses.monitors.counterfactual.promise import Promise, hours_to_show
from ravenjax.report import wording
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Rate

COLUMNS = ("check", "sees", "adds", "lead ms", "false alarms")
"""Of the table of the set; each check at the margin of the set."""
_MOST_GROUPS = 3


def sentences(one: Counterfactual) -> list[str]:
    """What was found: faults, coverage, false alarms, what other sets do, what is missed, of
    what it holds.
    """
    return [
        _faults(one),
        _coverage(one),
        _price(one),
        _price_asked(one),
        _others(one),
        _missed(one),
        _scope(one),
    ]


def rows(one: Counterfactual) -> list[tuple[str, ...]]:
    """Of the table of the set, in the order of selection."""
    return [
        (
            one.parts[member.place].name,
            wording.percent(member.sees),
            wording.percent(member.adds),
            wording.number(member.lead_ms),
            wording.count(member.false_alarms),
        )
        for member in one.members
    ]


def checks(one: Counterfactual) -> list[str]:
    """What each check of the set looks at, and from which size on it alarms, a line each."""
    parts, margin = [one.parts[place] for place in one.promise.members], one.promise.margin.value
    return [f"{part.name}: {part.words}; above {levels(part, margin)}" for part in parts]


def levels(part: Candidate, margin: float) -> str:
    """At which size each channel alarms: "shoulder 0.12 rad, elbow 0.1 rad"; "any" where it
    never moved.
    """
    score, out = part.score, []
    for label, unit, scale in zip(score.labels, score.units, score.scales, strict=True):
        size = (
            "any" if scale <= SMALLEST_SCALE else f"{wording.number(scale * margin)} {unit}".strip()
        )
        out.append(f"{label} {size}".strip())
    return ", ".join(out)


def table(one: Counterfactual) -> list[dict[str, object]]:
    """One row a candidate, as `counterfactual.csv` has them."""
    return [
        {
            "candidate": part.name,
            "chosen": place in one.promise.members,
            "kind": part.score.kind,
            "signal": part.score.signal,
            "against": part.score.against,
            "layer": part.score.layer,
            "consecutive_ms": part.consecutive,
            "looks_at": part.words,
            "scales": "; ".join(
                f"{label} {scale!r} {unit}".strip()
                for label, unit, scale in zip(
                    part.score.labels, part.score.units, part.score.scales, strict=True
                )
            ),
            "margin": alone.margin.value,
            "calibrated_false_alarms_per_hour": alone.margin.bound,
            "false_alarms": alone.false_alarms,
            "selection": alone.selected,
            "statement": alone.covered,
            "lead_ms": alone.lead_ms,
        }
        for place, (part, alone) in enumerate(zip(one.parts, one.alone, strict=True))
    ]


def _faults(one: Counterfactual) -> str:
    limit = one.config.outcomes.limit_mm
    hazards = one.grounds.hazards
    groups = f" of {_listed(one.question.groups)}" if one.question.groups else ""
    mine, others = (
        int(rows.sum()) for rows in (one.grounds.selection_half, one.grounds.statement_half)
    )
    return (
        f"{wording.many(hazards.count, 'fault')}{groups} move{'s' if hazards.count == 1 else ''}"
        f" the instrument by more than {limit:g} mm while no check tells anyone."
        f" {wording.count(mine)} of them selected the checks, the other {wording.count(others)}"
        " state what these see."
    )


def _coverage(one: Counterfactual) -> str:
    number = len(one.promise.members)
    noun = "check sees" if number == 1 else "checks together see"
    early = (
        f"{one.question.lead_ms} ms or more before harm"
        if one.question.lead_ms
        else "by the time harm begins"
    )
    return (
        f"{wording.count(number)} {noun} {_share(one.promise.covered)} {early}; the median alarm"
        f" comes {wording.number(one.promise.lead_ms)} ms before it. There were {len(one.parts)}"
        " candidates."
    )


def _price(one: Counterfactual) -> str:
    false = one.promise.false_alarms
    each = "It alarms" if len(one.promise.members) == 1 else "Each alarms"
    times = "" if one.promise.margin.value == 1.0 else f"{one.promise.margin.value:g} times "
    return (
        f"{each} above {times}the most that {wording.hours(one.scale_hours)} of fault-free "
        f"motion reached. {wording.hours(false.hours)} of other motion had {_alarms(false)}."
    )


def _price_asked(one: Counterfactual) -> str:
    false, bound, target = (
        one.promise.false_alarms,
        one.promise.margin.bound,
        one.question.false_alarms_per_hour,
    )
    limit = f"At most {wording.number(target)} an hour were asked for: "
    calibration = wording.hours(float(one.grounds.calibration.hours.sum()))
    enough = hours_needed(target, one.grounds.statement.hours.shape[1])
    if bound > target * (1 + 1e-9):
        return (
            f"{limit}too few for {calibration} of calibration, which estimate up to"
            f" {wording.number(bound)} an hour. {wording.hours(enough)} in all (--hours {enough:g})"
            " would do where they have no alarm."
        )
    if false.low > target:
        return f"{limit}there are more. Take longer motion, or allow more alarms."
    if false.high <= target:
        return f"{limit}this is shown."
    return (
        f"{limit}the margin was set on {calibration} so that at most {wording.number(target)} an"
        " hour are expected, at the mean over calibrations; that it is so here is not shown: that"
        f" takes {wording.hours(enough)} of motion in all without an alarm (--hours {enough:g})."
    )


def hours_needed(per_hour: float, runs: int = 1) -> float:
    """Hours of motions in all, of so many runs each, that show a rate where none alarms; to two
    digits, upwards.
    """
    hours = (
        2.05 * runs * hours_to_show(per_hour)
    )  # half of the motions state, a few of their seconds are not live
    digits = 10 ** (math.floor(math.log10(hours)) - 1)
    return round(math.ceil(hours / digits) * digits, 10)


def _others(one: Counterfactual) -> str:
    best, every = one.best, one.everything
    parts = [f"the best candidate alone ({one.parts[best.members[0]].name}) sees {_percent(best)}"]
    if one.tip_error is not None:
        parts.append(f"the built-in tip-error detector {_percent(one.tip_error)}")
    low, high = np.quantile(one.random, [0.05, 0.95])
    size = len(one.promise.members)
    sets = "a candidate" if size == 1 else f"{size} candidates"
    parts.append(
        f"{sets} at random {wording.percent(float(one.random.mean()))} at the mean (90 % of draws"
        f" within {wording.percent(float(low))} to {wording.percent(float(high))})"
    )
    parts.append(f"all {len(one.parts)} together {_percent(every)}")
    return f"For comparison, each at its own margin for the same false alarms: {', '.join(parts)}."


def _missed(one: Counterfactual) -> str:
    missed = one.uncovered
    if not missed:
        return "None of the faults that state it is missed."
    named = [f"{name} ({lost} of {of})" for name, lost, of in missed[:_MOST_GROUPS]]
    more = (
        f", and {wording.many(len(missed) - _MOST_GROUPS, 'group')} more"
        if len(missed) > _MOST_GROUPS
        else ""
    )
    return f"Not seen in time: {', '.join(named)}{more}."


def _scope(one: Counterfactual) -> str:
    hazards = one.grounds.hazards
    if hazards.robots:
        return (
            "Intervals are of robots drawn as these were; the kinds of faults are the campaign's."
        )
    enumerated = int((~hazards.sampled).sum())
    how = (
        "Intervals are of faults drawn as this campaign's were"
        if not enumerated
        else (
            f"{wording.count(enumerated)} of the faults are enumerated; intervals are of faults"
            " drawn from this campaign's at random, as its halves were"
        )
    )
    return f"{how}.{_strangers(one)}"


def _strangers(one: Counterfactual) -> str:
    if one.strangers is None:
        return " They say nothing of kinds of faults that it does not have."
    among = wording.interval(one.strangers)
    over = f", over groups {among}" if among else ""
    return (
        " Of kinds of faults that it does not have they say nothing. A hint: chosen without the"
        " faults of the group that they are tried on, sets see"
        f" {wording.percent(one.strangers.value)}{over}."
    )


def _share(rate: Rate) -> str:
    among = wording.interval(rate)
    return (
        f"{rate.k} of {rate.n}"
        f" ({wording.percent(rate.value)}{f', 95 % interval {among}' if among else ''})"
    )


def _percent(promise: Promise) -> str:
    return wording.percent(promise.covered.value)


def _alarms(false: AlarmRate) -> str:
    count = "no false alarm" if not false.count else wording.many(false.count, "false alarm")
    return (
        f"{count}: {wording.number(false.low, 2)} to {wording.number(false.high, 2)} an hour (95 %)"
    )


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
