"""Tables of the study of the haptic cue."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.stats.alarms.pareto import front
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.comparison.paired import mcnemar
from ravenjax.store.manifest import CueRecord
from studies.detection.points import (
    BY_DEFINITION,
    MOVED,
    median_times,
    percent,
    plain,
    rate,
    share,
)
from studies.detection.runs import AS_MODELLED, UNCERTAIN, per_hour
from studies.detection.tables import CLUTCHED, layers_of
from studies.framework import kinds
from studies.framework.study import StudyEstimate, Table
from studies.haptics import choice
from studies.haptics.choice import Counts, Winners
from studies.haptics.runs import KINDS, UNINTENDED, FaultyCues, FreeCues, sets_at

AT_CAP = 0.999
"""Share of the cap from which on a force is at it: forces are stored as float32."""
SLOW = 0.1
"""Largest scale of motion that is called slow."""
SHOWN_MM = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Thresholds in the table of false cues by motion."""


class CueResult(NamedTuple):
    """One set. Rates are fractions, times ms."""

    missed: StudyEstimate  # of runs with unintended motion, never felt
    before: StudyEstimate  # of those, felt before it began
    others: StudyEstimate  # of the other faulty runs, felt
    delay_ms: StudyEstimate  # median, from the fault's first effect
    lead_ms: StudyEstimate  # median, over the unintended motion
    force: str  # median and quartiles of the largest where felt
    at_cap: StudyEstimate  # of the unintended motions that are felt, those at the cap
    felt_ms: str  # median and quartiles of the time with force where felt


def missed(faulty: FaultyCues, sets: Sequence[int], before: bool = False) -> np.ndarray:
    """Which runs were never told by each set, or not `before` their unintended motion: bool
    [runs, sets].
    """
    first = faulty.first_ms[:, list(sets)]
    late = (first >= faulty.unintended_ms[:, None]) & (faulty.unintended_ms >= 0)[:, None]
    return (first < 0) | late if before else first < 0


def sums(
    faulty: FaultyCues, free: FreeCues, sets: Sequence[int], kind: str, before: bool = False
) -> Counts:
    """What a choice among `sets` is made of, for hazards of one of KINDS; `before`: a cue after
    it began is missed.
    """
    hazards = faulty.where(faulty.kinds[:, KINDS.index(kind)])
    return choice.counts(
        missed(hazards, sets, before),
        hazards.faults,
        free.count[:, list(sets)],
        free.hours,
        free.recording,
    )


def by_definition(faulty: FaultyCues, k: int) -> bool:
    """Whether set number k fires at the limit of the unintended motion or beyond: but for what the
    reported tip differs from the true one, its cue comes as the motion begins or later, by the
    definitions alone."""
    return faulty.cues[k].threshold_mm >= faulty.rules.limit_mm


def felt(faulty: FaultyCues, k: int) -> CueResult:
    """What set number k tells of faults that make an unintended motion."""
    moved = faulty.unintended
    first = faulty.first_ms[:, k]
    cued = first >= 0
    once = faulty.where(moved).once()
    mine = faulty.where(moved & cued)
    cap = faulty.cues[k].cap
    at_cap = mine.force[:, k] >= AT_CAP * cap if cap is not None else np.zeros(len(mine.cell), bool)
    end = float(faulty.duration_ms)
    delay, lead = median_times(
        once.first_ms[:, k], once.active_ms, once.unintended_ms, end, once.faults
    )
    late = by_definition(faulty, k)
    return CueResult(
        share(~cued, moved, faulty.faults, MOVED),
        (
            BY_DEFINITION
            if late
            else share(cued & (first < faulty.unintended_ms), moved, faulty.faults, MOVED)
        ),
        share(cued, ~moved, faulty.faults, "other faulty runs"),
        delay,
        BY_DEFINITION if late else lead,
        _quartiles(mine.force[:, k]),
        share(at_cap, np.ones(len(at_cap), bool), mine.faults, "felt runs"),
        _quartiles(mine.felt_ms[:, k]),
    )


def false_cues(free: FreeCues, k: int, robot: str) -> StudyEstimate:
    """False cues an hour of set k with one robot."""
    mine = free.where(free.robot == robot)
    return per_hour(mine.count[:, k], mine.hours, mine.recording, "cues")


def false_time(free: FreeCues, k: int, robot: str) -> str:
    """Share of motion without a fault in which set k pulls, with one robot."""
    mine = free.where(free.robot == robot)
    hours = float(mine.hours.sum())
    value = float(mine.felt_hours[:, k].sum()) / hours
    band = units.ratio(mine.felt_hours[:, k], mine.hours, units.units(mine.recording))
    if not value or np.isnan(band.low):
        return f"{wording.percent(value)} of {hours:.1f} h"
    return (
        f"{wording.percent(value)} ({wording.percent(band.low)} to {wording.percent(band.high)}) of"
        f" {hours:.1f} h"
    )


def threshold_table(faulty: FaultyCues, free: FreeCues, sets: Sequence[int]) -> Table:
    """What each threshold does, with the published gains."""
    rows = []
    for k in sets:
        result = felt(faulty, k)
        rows.append(
            (
                faulty.cues[k].threshold_mm,
                percent(result.missed),
                percent(result.before),
                percent(result.others),
                plain(result.delay_ms),
                plain(result.lead_ms),
                result.force,
                percent(result.at_cap),
                result.felt_ms,
                rate(false_cues(free, k, AS_MODELLED)),
                false_time(free, k, AS_MODELLED),
                rate(false_cues(free, k, UNCERTAIN)),
            )
        )
    return Table(
        "Thresholds, with the published gains",
        (
            "threshold, mm",
            "missed",
            "felt before it began",
            "felt, of the other faulty runs",
            "median delay, ms",
            "median lead, ms",
            "largest force",
            "at the cap",
            "time felt, ms",
            "false cues an hour",
            "time with one",
            "false cues with an uncertain robot",
        ),
        tuple(rows),
        "Missed, and felt before it began: of runs with unintended motion. Delay: from the fault's"
        " first effect; lead over the unintended motion: positive where the cue comes first; one"
        " run of each fault that made one, runs without a cue censored at their end. A dash about"
        " the motion's beginning: the cue fires at the motion's distance from the model or beyond,"
        " and is no warning of it; a lead is a dash, too, where fewer than half of the faults have"
        f" a cue. {kinds.NOTE} Force (device units) and time: of unintended motions that are felt."
        " False cues: pulses on motion without a fault at scales 0.05 to 0.2, interval over"
        " recordings. Uncertain robot: friction x 0.7 to 1.4, mass x 0.8 to 1.25, cable stiffness"
        " x 0.5 to 2, motor constant x 0.9 to 1.1.",
    )


def choice_table(faulty: FaultyCues, sets: Sequence[int], winners: Winners) -> Table:
    """What the data choose at each weight, and how sure that is."""
    published = sets.index(faulty.published)
    rows = []
    for weight, winner, wins, cost, sure in zip(*winners, winners.sure, strict=True):
        mm = faulty.cues[sets[winner]].threshold_mm
        others = [
            f"{faulty.cues[sets[j]].threshold_mm:g} mm {100 * wins[j]:.0f} %"
            for j in np.argsort(-wins, kind="stable")
            if j != winner and wins[j] >= 0.01
        ]
        rows.append(
            (
                f"{weight:,.0f}",
                mm if sure else f"cannot be said; {mm:g} costs least",
                f"{100 * wins[winner]:.0f} %",
                ", ".join(others),
                float(f"{cost[winner]:.3g}"),
                float(f"{cost[published]:.3g}"),
                f"{100 * wins[published]:.0f} %",
            )
        )
    return Table(
        "The threshold that the data would choose",
        (
            "a missed unintended motion an hour weighs so many false cues",
            "threshold, mm",
            "wins",
            "else wins",
            "cost, false cues an hour",
            f"cost of {faulty.cues[faulty.published].threshold_mm:g} mm",
            "it wins",
        ),
        tuple(rows),
        "Cost: weight x share missed + false cues an hour. Wins: of 2 000 draws of kinds of faults"
        f" and of recordings with replacement; a threshold is named from {100 * choice.SURE:.0f} %"
        " on. Among thresholds with the published gains; of equals the highest.",
    )


def versus_table(faulty: FaultyCues, free: FreeCues, numbers: Sequence[int]) -> Table:
    """Sets side by side over the same runs, the first the one that the others are compared with."""
    results = [felt(faulty, k) for k in numbers]
    once = faulty.where(faulty.unintended).once()
    cued = once.first_ms >= 0
    versus = []
    for k in numbers:
        pair = mcnemar(cued[:, numbers[0]], cued[:, k])
        p = wording.number(exchange_p(cued[:, numbers[0]], cued[:, k], once.faults.unit))
        versus.append(
            f"{pair.first_only} and {pair.second_only} of {wording.count(pair.n)} faults, p = {p}"
        )
    rows = [
        ("unintended motion missed", *(percent(one.missed) for one in results)),
        ("felt before it began", *(percent(one.before) for one in results)),
        ("felt, of the other faulty runs", *(percent(one.others) for one in results)),
        ("of what is felt, at the cap", *(percent(one.at_cap) for one in results)),
        ("median delay, ms", *(plain(one.delay_ms) for one in results)),
        ("median lead, ms", *(plain(one.lead_ms) for one in results)),
        *(
            (f"false cues an hour, {robot}", *(rate(false_cues(free, k, robot)) for k in numbers))
            for robot in (AS_MODELLED, UNCERTAIN)
        ),
        ("felt with the first alone, and with this alone", "", *versus[1:]),
    ]
    return Table(
        "The published set and those that cost least at some weight",
        ("", *(_named(faulty.cues[k]) for k in numbers)),
        tuple(rows),
        "The last row: one run of each fault that made an unintended motion; p: both sets exchanged"
        " kind by kind, exact.",
    )


def rules_table(faulty: FaultyCues, free: FreeCues, sets: Sequence[int]) -> Table:
    """What is chosen where what is to be told, a miss or the motion without a fault is something
    else.
    """
    modelled = free.where(free.robot == AS_MODELLED)
    slow = modelled.where(modelled.scale <= SLOW + 1e-9)
    still_down = slow.where(~np.char.startswith(slow.recording.astype(str), CLUTCHED))
    conditions = (
        *((kind, "never felt", "every motion and scale", modelled) for kind in KINDS),
        (UNINTENDED, "not felt before it", "every motion and scale", modelled),
        (UNINTENDED, "never felt", f"scales up to {SLOW:g}", slow),
        (UNINTENDED, "never felt", f"scales up to {SLOW:g}, no clutching", still_down),
        (UNINTENDED, "not felt before it", f"scales up to {SLOW:g}, no clutching", still_down),
        (UNINTENDED, "never felt", UNCERTAIN, free.where(free.robot == UNCERTAIN)),
    )
    rows = []
    for kind, miss, motion, mine in conditions:
        before = miss != "never felt"
        hazard = faulty.kinds[:, KINDS.index(kind)]
        if not hazard.any() or not mine.hours.sum() > 0:
            continue
        never = share(missed(faulty, [faulty.published], before)[:, 0], hazard, faulty.faults, "")
        if before and by_definition(faulty, faulty.published):
            never = BY_DEFINITION
        winners = choice.choose(sums(faulty, mine, sets, kind, before), np.array(choice.WEIGHTS))
        names = [
            f"{'' if sure else 'undecided: '}{faulty.cues[sets[k]].threshold_mm:g}"
            f" ({100 * wins[k]:.0f} %)"
            for k, wins, sure in zip(winners.winner, winners.wins, winners.sure, strict=True)
        ]
        rows.append((kind, miss, motion, percent(never), *names))
    return Table(
        "What the choice hangs on: threshold in mm, and how often it wins",
        (
            "what is to be told",
            "missed is",
            "false cues on",
            f"missed at {faulty.cues[faulty.published].threshold_mm:g} mm",
            *(f"weight {weight:,.0f}" for weight in choice.WEIGHTS),
        ),
        tuple(rows),
        "Injury-capable motion: a jump of the true tip, an unintended motion of more than"
        f" {LIMIT_MM:g} mm (live or not), or more than 1 mm deeper in the tissue. Hazards are at"
        " scale 0.1, robot as modelled. 8 mm is the highest threshold that was tried: where it"
        " wins, a higher one, or no cue at all, might.",
    )


def front_table(faulty: FaultyCues, modelled: FreeCues) -> Table:
    """Sets that no other beats in both unintended motion missed and false cues."""
    moved = faulty.unintended
    never = (faulty.first_ms[moved] < 0).mean(axis=0)
    false = modelled.count.sum(axis=0) / modelled.hours.sum()
    best = np.flatnonzero(front(never, false))
    alike: dict[tuple[float, float], list[int]] = {}
    for k in best[np.argsort(false[best], kind="stable")]:
        alike.setdefault((float(never[k]), float(false[k])), []).append(int(k))
    rows = []
    for ks in alike.values():
        one = share(faulty.first_ms[:, ks[0]] < 0, moved, faulty.faults, "")
        rate_ = per_hour(modelled.count[:, ks[0]], modelled.hours, modelled.recording, "cues")
        whole = len(ks) == len(sets_at(faulty.cues, faulty.cues[ks[0]].threshold_mm))
        gains = (
            "all"
            if whole
            else ", ".join(f"{faulty.cues[k].kp_per_mm:g}/{damper(faulty.cues[k])}" for k in ks)
        )
        thresholds = ", ".join(
            f"{mm:g}" for mm in sorted({faulty.cues[k].threshold_mm for k in ks})
        )
        rows.append((thresholds, gains, percent(one), rate(rate_)))
    return Table(
        "The front: no set misses less with fewer false cues",
        (
            "threshold, mm",
            "gains Kp/Kd that do exactly this",
            "unintended motion missed",
            "false cues an hour",
        ),
        tuple(rows),
        f"Of {len(faulty.cues)} sets, robot as modelled, every motion and scale.",
    )


def gain_table(faulty: FaultyCues, modelled: FreeCues, numbers: Sequence[int]) -> Table:
    """What the gains change at some sets' thresholds."""
    rows = []
    for mm in dict.fromkeys(faulty.cues[k].threshold_mm for k in numbers):
        for k in sets_at(faulty.cues, mm):
            result, cue = felt(faulty, k), faulty.cues[k]
            false = per_hour(modelled.count[:, k], modelled.hours, modelled.recording, "cues")
            rows.append(
                (
                    mm,
                    cue.kp_per_mm,
                    damper(cue),
                    percent(result.missed),
                    plain(result.delay_ms),
                    result.force,
                    percent(result.at_cap),
                    result.felt_ms,
                    rate(false),
                )
            )
    return Table(
        "Gains",
        (
            "threshold, mm",
            "Kp, per mm",
            "Kd, per mm/s",
            "missed",
            "median delay, ms",
            "largest force",
            "at the cap",
            "time felt, ms",
            "false cues an hour",
        ),
        tuple(rows),
        "Missed: of runs with unintended motion. Force in device units, cap 0.05. The gains were"
        " not published: 0.0045 per mm was read off Figure 5 of IROS 2016, the damper made out of"
        " its third pulse.",
    )


def motion_table(free: FreeCues, sets: Sequence[int]) -> Table:
    """False cues an hour by motion and scale."""
    modelled = free.where(free.robot == AS_MODELLED)
    columns = [k for k in sets if free.cues[k].threshold_mm in SHOWN_MM]
    motion = np.array([name.rpartition(" ")[0] for name in modelled.recording], object)
    rows = []
    for name in dict.fromkeys(motion.tolist()):
        for scale in np.unique(modelled.scale):
            mine = modelled.where((motion == name) & np.isclose(modelled.scale, scale))
            cells = [
                _with_count(per_hour(mine.count[:, k], mine.hours, mine.recording)) for k in columns
            ]
            rows.append(
                (
                    name,
                    float(scale),
                    len(np.unique(mine.recording)),
                    round(float(mine.hours.sum()), 3),
                    *cells,
                )
            )
    return Table(
        "False cues an hour, by motion and scale, robot as modelled",
        (
            "motion",
            "scale",
            "recordings",
            "hours",
            *(f"{free.cues[k].threshold_mm:g} mm" for k in columns),
        ),
        tuple(rows),
        "Published gains; an hour, and pulses seen. Where no cue came: exact Poisson, 95 %, as if"
        " the hours were independent; few hours each, so that the bound is high. Else no interval:"
        " one or two recordings are no sample of motions. With clutching the distance to the model"
        " grows from clutch to clutch and stays.",
    )


def layer_table(faulty: FaultyCues, numbers: Sequence[int]) -> Table:
    """What is felt of each layer's faults."""
    rows = []
    for layer in layers_of(faulty.layer[faulty.unintended]):
        part = faulty.where(faulty.layer == layer)
        cells = []
        for k in numbers:
            result = felt(part, k)
            cells += [
                percent(result.missed),
                percent(result.before),
                plain(result.delay_ms),
                result.force,
            ]
        moved = part.where(part.unintended)
        rows.append((layer, len(np.unique(moved.cell)), kinds.count(moved.faults), *cells))
    heads = [
        f"{words}, {faulty.cues[k].threshold_mm:g} mm"
        for k in numbers
        for words in ("missed", "felt before it began", "median delay, ms", "largest force")
    ]
    return Table(
        "By layer of the fault",
        ("layer", "faults with unintended motion", "of kinds", *heads),
        tuple(rows),
        "Missed, and felt before it began: of runs with unintended motion, the faults under each"
        f" motion. {kinds.NOTE}",
    )


def kind_table(faulty: FaultyCues, numbers: Sequence[int], drawn_groups: Collection[str]) -> Table:
    """What is felt of each kind of fault that makes an unintended motion, each with its own
    denominator.
    """
    names, sampled = (
        kinds.names(faulty.group),
        np.isin(faulty.group.astype(str), sorted(drawn_groups)),
    )
    rows = []
    for name in dict.fromkeys(names[faulty.unintended].tolist()):
        mine = faulty.where(names == name)
        is_drawn = bool(sampled[names == name].all())
        moved = mine.where(mine.unintended)
        own = units.units(moved.cell) if is_drawn else units.units(np.zeros(len(moved.cell)))
        cells = [
            (
                wording.DASH
                if before and by_definition(faulty, k)
                else _rate(~missed(moved, [k], before)[:, 0], own)
            )
            for k in numbers
            for before in (False, True)
        ]
        faults = f"{len(np.unique(mine.cell))} {'drawn' if is_drawn else 'cells of the design'}"
        rows.append(
            (name, str(mine.layer[0]), faults, f"{len(moved.cell)} of {len(mine.cell)}", *cells)
        )
    heads = [
        f"{words}, {faulty.cues[k].threshold_mm:g} mm"
        for k in numbers
        for words in ("felt", "felt before it began")
    ]
    return Table(
        "By kind of fault",
        ("kind of fault", "layer", "faults", "runs with unintended motion", *heads),
        tuple(rows),
        "Felt: of the runs of that kind with unintended motion. Where its faults were drawn: 95 %"
        " over faults drawn in the same way, the motions of one fault together. Where values are"
        " fixed: a share of the cells of this design under four motions, without an interval. Kinds"
        " without an unintended motion are left out.",
    )


def _rate(hit: np.ndarray, among: Units) -> str:
    """12 of 40, 30.0 % (12.5 % to 51.0 %); no interval where nothing was drawn."""
    rate = units.rate(hit, among)
    ends = (
        ""
        if np.isnan(rate.low)
        else f" ({wording.percent(rate.low)} to {wording.percent(rate.high)})"
    )
    return f"{rate.k} of {rate.n}, {wording.percent(rate.value)}{ends}"


def shared_table(faulty: FaultyCues, motions: Sequence[str], sets: Sequence[int]) -> Table:
    """How many faulty runs have a golden run that feels the cue, too."""
    numbers = np.unique(faulty.motion)
    rows = []
    for k in sets:
        had = [faulty.shared[faulty.motion == number, k] for number in numbers]
        shares = [
            f"{wording.percent(float(shared.mean()))} of {wording.count(len(shared))}"
            for shared in had
        ]
        if any(shared.any() for shared in had):
            rows.append((faulty.cues[k].threshold_mm, *shares))
    return Table(
        "Faulty runs whose golden run has a cue, too",
        ("threshold, mm", *(motions[int(number)] for number in numbers)),
        tuple(rows),
        "At scale 0.1, 4 s; at higher thresholds none. All runs of a motion share one golden run,"
        " so it is all or none of them; such a cue tells of the motion, and where it came first the"
        " fault counts as missed.",
    )


def _with_count(value: StudyEstimate) -> str:
    """12 (10 to 15); 8 of them."""
    return f"{plain(value)}; {wording.count(value.n)}"


def damper(cue: CueRecord) -> str:
    """Damping in device units per mm/s, without an exponent."""
    return np.format_float_positional(cue.kd_s_per_mm, trim="-")


def _named(cue: CueRecord) -> str:
    return f"{cue.threshold_mm:g} mm, Kp {cue.kp_per_mm:g}, Kd {damper(cue)}"


def _quartiles(values: np.ndarray) -> str:
    """Median (first to third quartile)."""
    if not len(values):
        return wording.DASH
    low, middle, high = (wording.number(float(one)) for one in np.percentile(values, [25, 50, 75]))
    return f"{middle} ({low} to {high})"
