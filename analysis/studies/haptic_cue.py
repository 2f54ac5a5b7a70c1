"""Study of the haptic cue: which faults are felt, when and how strongly, how many false cues come,
and which threshold is best.

All sets of threshold and gains are evaluated in the same runs, and nobody reacts. A cue of a faulty
run counts from the fault's first effect on, and only if the golden run had none by then. A
threshold costs weight x (share of hazards missed) + false cues per hour. The weight is unknown, so
it is swept. Kinds of faults and recordings are resampled to show how certain a choice is.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.outcomes import events
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units, group_units
from ravenjax.store.manifest import CueRecord
from studies import kinds, runs
from studies.cells import BY_DEFINITION, hourly, percent, plain, quartiles
from studies.runs import AS_MODELLED, CLUTCHED, MOTIONS, RECORDINGS, SCALE, UNCERTAIN, Runs, share
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    in_percent,
    own_line,
    read_notes,
    read_table,
    study,
)

NAME = "haptic_cue"
RESAMPLES = 2000
WEIGHTS = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)
"""Weights shown in tables."""
SURE = 0.95
"""Share of resamples that a set must win to be named."""
HAZARDS = {
    "unintended motion": "unintended",
    "injury-capable motion": "injury",
    "jump of the true tip": "jump_tip",
}
"""What a cue is to announce, and its column."""
UNINTENDED = next(iter(HAZARDS))
AT_CAP = 0.999
"""Share of the cap from which a force counts as capped, because forces are stored as float32."""
SLOW = 0.1
"""Largest scale of motion that is called slow."""
SHOWN_MM = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Thresholds in the table of false cues by motion."""
EARLY_MM = 1.0
"""A threshold below the limit of the unintended motion, which is compared for any choice."""
MOVED = "runs with unintended motion"
CAMPAIGN = "haptic_sweep.toml"
FREE_RUNS, FREE_S = 32, 120


class Counts(NamedTuple):
    """Sums over each unit that is resampled: kinds of faults [kinds, sets] and recordings
    [recordings, sets].
    """

    missed: np.ndarray
    hazards: np.ndarray  # [kinds]
    kinds: Units  # one row per kind, by stratum
    false: np.ndarray
    hours: np.ndarray  # [recordings]


class Winners(NamedTuple):
    """The choice at each weight."""

    weight: np.ndarray  # [weights]
    winner: np.ndarray  # [weights], number of the winning set
    wins: np.ndarray  # [weights, sets], share of resamples in which it wins; sums to 1
    cost: np.ndarray  # [weights, sets], false cues an hour
    sure: np.ndarray  # [weights], whether the choice is certain enough to be named


def counts(
    missed: np.ndarray, faults: Units, false: np.ndarray, hours: np.ndarray, recording: np.ndarray
) -> Counts:
    """Return sums of missed (bool [hazards, sets]) by kind of fault, and of false cues [runs, sets]
    by recording.
    """
    free, every = group_units(recording), np.ones(len(missed))
    whole = Units(np.arange(faults.count), faults.stratum)
    return Counts(
        _by(faults, missed.astype(float)),
        _by(faults, every),
        whole,
        _by(free, false),
        _by(free, hours),
    )


def choose(
    found: Counts, weights: np.ndarray, resamples: int = RESAMPLES, seed: int = 0
) -> Winners:
    """Return the cheapest set at each weight; of equals the highest-numbered one (the highest
    threshold, if sets rise).

    Resampling cannot represent a rate with no observed event. Such a rate is drawn from an
    exponential distribution of mean 1 / hours, whose 97.5 % quantile is the end of the exact
    interval for a Poisson count of 0. Raises ValueError without hazards or hours.
    """
    if not len(found.hazards) or not found.hours.sum() > 0:
        raise ValueError("a choice needs hazards and motion without a fault")
    weight = np.asarray(weights, float)[:, None]
    missed = found.missed.sum(axis=0) / found.hazards.sum()
    false = found.false.sum(axis=0) / found.hours.sum()
    rng, recordings = np.random.default_rng(seed), len(found.hours)
    faults = found.kinds.weights(resamples, seed)
    drawn = rng.multinomial(recordings, np.full(recordings, 1 / recordings), resamples)
    shares = (faults @ found.missed) / (faults @ found.hazards)[:, None]
    cues, hours = drawn @ found.false, (drawn @ found.hours)[:, None]
    rates = np.where(cues > 0, cues, rng.exponential(size=cues.shape)) / hours
    sets = len(missed)
    wins = np.stack(
        [np.bincount(_cheapest(one * shares + rates), minlength=sets) / resamples for one in weight]
    )
    cost = weight * missed + false
    winner = _cheapest(cost)
    return Winners(weight[:, 0], winner, wins, cost, wins[np.arange(len(weight)), winner] >= SURE)


def _cheapest(cost: np.ndarray) -> np.ndarray:
    """Return the last of the cheapest [..., sets]. Costs that differ only by rounding are equal."""
    near = cost <= cost.min(axis=-1, keepdims=True) * (1 + 1e-12)
    return cost.shape[-1] - 1 - np.argmax(near[..., ::-1], axis=-1)


def _by(among: Units, values: np.ndarray) -> np.ndarray:
    total = np.zeros((among.count, *values.shape[1:]))
    np.add.at(total, among.unit, values)
    return total


def default_sets(cues: Sequence[CueRecord], published: int) -> list[int]:
    """Return the numbers of the sets with the published gains, by rising threshold."""

    def gains(cue: CueRecord) -> tuple[float, float]:
        return cue.kp_per_mm, cue.kd_s_per_mm

    alike = [k for k, cue in enumerate(cues) if gains(cue) == gains(cues[published])]
    return sorted(alike, key=lambda k: cues[k].threshold_mm)


def first_ms(faulty: Runs, k: int) -> np.ndarray:
    """Return when set number k was felt because of the fault, ms [runs]; -1: never."""
    times = runs.warning_times(faulty, k)
    return np.where(times >= faulty["active_ms"], times, -1)


def missed(faulty: Runs, sets: Sequence[int], before: bool = False) -> np.ndarray:
    """Return which runs had no cue of each set, or none `before` their unintended motion: bool
    [runs, sets].
    """
    first, began = np.stack([first_ms(faulty, k) for k in sets], axis=1), faulty["unintended_ms"]
    late = (first >= began[:, None]) & (began >= 0)[:, None]
    return (first < 0) | late if before else first < 0


def sums(
    faulty: Runs, free: Runs, sets: Sequence[int], hazard: str, before: bool = False
) -> Counts:
    """Return the sums for a choice among `sets`, for one of HAZARDS. `before`: a cue after the
    hazard began counts as missed.
    """
    hazards = faulty.where(faulty[HAZARDS[hazard]].astype(bool))
    false = np.stack([free[f"cue{k}_count"] for k in sets], axis=1)
    return counts(
        missed(hazards, sets, before), hazards.faults, false, free["hours"], free["recording"]
    )


def by_definition(faulty: Runs, k: int) -> bool:
    """Return whether set number k fires at the limit of the unintended motion or beyond.

    By the definitions alone, its cue then comes as the motion begins or later, except for the
    difference between reported and true tip.
    """
    return faulty.made.cues[k].threshold_mm >= faulty.made.rules.limit_mm


class CueResult(NamedTuple):
    """One haptic set. Rates are fractions, times ms."""

    missed: StudyEstimate  # of runs with unintended motion: never felt
    before: StudyEstimate  # of these: felt before it began
    others: StudyEstimate  # of the other faulty runs: felt
    delay_ms: StudyEstimate  # median, from the fault's first effect
    lead_ms: StudyEstimate  # median, before the unintended motion
    force: str  # median and quartiles of the largest force, where felt
    at_cap: StudyEstimate  # of the unintended motions that are felt: those at the cap
    felt_ms: str  # median and quartiles of the time with force, where felt


def felt(faulty: Runs, k: int) -> CueResult:
    """Return what set number k announces of faults that cause an unintended motion."""
    moved, first = faulty["unintended"], first_ms(faulty, k)
    came = first >= 0
    once, mine = faulty.where(moved).once(), faulty.where(moved & came)
    cap, force = faulty.made.cues[k].cap, mine[f"cue{k}_peak_force"].astype(float)
    at_cap = force >= AT_CAP * (np.inf if cap is None else cap)
    delay, lead = runs.median_times(once, first_ms(once, k))
    before = share(came & (first < faulty["unintended_ms"]), moved, faulty.faults, MOVED)
    late = by_definition(faulty, k)
    return CueResult(
        share(~came, moved, faulty.faults, MOVED),
        BY_DEFINITION if late else before,
        share(came, ~moved, faulty.faults, "other faulty runs"),
        delay,
        BY_DEFINITION if late else lead,
        quartiles(force),
        share(at_cap, np.ones(len(at_cap), bool), mine.faults, "felt runs"),
        quartiles(mine[f"cue{k}_ms"]),
    )


def false_cues(free: Runs, k: int) -> StudyEstimate:
    """Return false cues per hour of set k."""
    return runs.per_hour(free, free[f"cue{k}_count"], "cues")


def false_time(free: Runs, k: int) -> str:
    """Return the share of fault-free motion in which set k pulls."""
    hours, pulled = free["hours"], free[f"cue{k}_ms"] / 3.6e6
    band = units.ratio_band(pulled, hours, group_units(free["recording"]))
    value, low, high = map(
        wording.format_percent, (pulled.sum() / hours.sum(), band.low, band.high)
    )
    ends = f" ({low} to {high})" if pulled.any() and not np.isnan(band.low) else ""
    return f"{value}{ends} of {hours.sum():.1f} h"


def of_robot(free: Runs, robot: str) -> Runs:
    return free.where(free["robot"] == robot)


def threshold_table(faulty: Runs, free: Runs, sets: Sequence[int]) -> Table:
    """Return what each threshold does, with the published gains."""
    modelled, uncertain = of_robot(free, AS_MODELLED), of_robot(free, UNCERTAIN)

    def row(k: int) -> tuple[float | str, ...]:
        found = felt(faulty, k)
        return (
            faulty.made.cues[k].threshold_mm,
            *map(percent, (found.missed, found.before, found.others)),
            *map(plain, (found.delay_ms, found.lead_ms)),
            *(found.force, percent(found.at_cap), found.felt_ms),
            *(hourly(false_cues(modelled, k)), false_time(modelled, k)),
            hourly(false_cues(uncertain, k)),
        )

    return read_table(NAME, "thresholds", map(row, sets))


def choice_table(faulty: Runs, sets: Sequence[int], winners: Winners) -> Table:
    """Return what the data choose at each weight, and how certain the choice is."""
    published, cues = sets.index(faulty.made.verdict_cue), faulty.made.cues
    rows = []
    for weight, winner, wins, cost, sure in zip(*winners, strict=True):
        mm = cues[sets[winner]].threshold_mm
        others = [
            f"{cues[sets[j]].threshold_mm:g} mm {100 * wins[j]:.0f} %"
            for j in np.argsort(-wins, kind="stable")
            if j != winner and wins[j] >= 0.01
        ]
        named = mm if sure else f"cannot be said; {mm:g} costs least"
        costs = [float(f"{cost[place]:.3g}") for place in (winner, published)]
        won = [f"{100 * wins[place]:.0f} %" for place in (winner, published)]
        rows.append(
            (f"{weight:,.0f}", named, won[0], ", ".join(others), costs[0], costs[1], won[1])
        )
    mm = cues[faulty.made.verdict_cue].threshold_mm
    return read_table(NAME, "choice", rows, mm=mm, sure=100 * SURE)


def rules_table(faulty: Runs, free: Runs, sets: Sequence[int]) -> Table:
    """Return what is chosen under other rules: other hazards, another meaning of a miss, or other
    fault-free motion.
    """
    made, modelled = faulty.made, of_robot(free, AS_MODELLED)
    slow = modelled.where(modelled[SCALE] <= SLOW + 1e-9)
    still_down = slow.where(~np.char.startswith(slow["recording"].astype(str), CLUTCHED))
    conditions = (
        *((hazard, "never felt", "every motion and scale", modelled) for hazard in HAZARDS),
        (UNINTENDED, "not felt before it", "every motion and scale", modelled),
        (UNINTENDED, "never felt", f"scales up to {SLOW:g}", slow),
        (UNINTENDED, "never felt", f"scales up to {SLOW:g}, no clutching", still_down),
        (UNINTENDED, "not felt before it", f"scales up to {SLOW:g}, no clutching", still_down),
        (UNINTENDED, "never felt", UNCERTAIN, of_robot(free, UNCERTAIN)),
    )
    rows = []
    for hazard, miss, motion, mine in conditions:
        before, hit = miss != "never felt", faulty[HAZARDS[hazard]].astype(bool)
        if not hit.any() or not mine["hours"].sum() > 0:
            continue
        never = share(missed(faulty, [made.verdict_cue], before)[:, 0], hit, faulty.faults, "")
        if before and by_definition(faulty, made.verdict_cue):
            never = BY_DEFINITION
        winners = choose(sums(faulty, mine, sets, hazard, before), np.array(WEIGHTS))
        names = [
            f"{'' if sure else 'undecided: '}{made.cues[sets[k]].threshold_mm:g}"
            f" ({100 * wins[k]:.0f} %)"
            for k, wins, sure in zip(winners.winner, winners.wins, winners.sure, strict=True)
        ]
        rows.append((hazard, miss, motion, percent(never), *names))
    mm = made.cues[made.verdict_cue].threshold_mm
    return read_table(NAME, "rules", rows, mm=mm, limit_mm=LIMIT_MM)


def gain_table(faulty: Runs, modelled: Runs, numbers: Sequence[int]) -> Table:
    """Return what the gains change at some sets' thresholds."""
    cues, rows = faulty.made.cues, []
    for mm in dict.fromkeys(cues[k].threshold_mm for k in numbers):
        for k in (k for k, cue in enumerate(cues) if cue.threshold_mm == mm):
            found, damper = (
                felt(faulty, k),
                np.format_float_positional(cues[k].kd_s_per_mm, trim="-"),
            )
            rows.append(
                (
                    *(mm, cues[k].kp_per_mm, damper, percent(found.missed), plain(found.delay_ms)),
                    *(found.force, percent(found.at_cap), found.felt_ms),
                    hourly(false_cues(modelled, k)),
                )
            )
    return read_table(NAME, "gains", rows)


def motion_table(free: Runs, sets: Sequence[int]) -> Table:
    """Return false cues per hour by motion and scale."""
    modelled = of_robot(free, AS_MODELLED)
    shown = [k for k in sets if free.made.cues[k].threshold_mm in SHOWN_MM]
    motion = np.array([name.rpartition(" ")[0] for name in modelled["recording"]], object)
    rows = []
    for name in dict.fromkeys(motion.tolist()):
        for scale in np.unique(modelled[SCALE]):
            mine = modelled.where((motion == name) & np.isclose(modelled[SCALE], scale))
            rates = [false_cues(mine, k) for k in shown]
            recordings, hours = (
                len(np.unique(mine["recording"])),
                round(float(mine["hours"].sum()), 3),
            )
            cells = [f"{plain(one)}; {wording.format_count(one.n)}" for one in rates]
            rows.append((name, float(scale), recordings, hours, *cells))
    return read_table(NAME, "motions", rows)


def compare(context: Context) -> Findings:
    """Compare all sets over the same runs."""
    faulty = runs.pooled([runs.read(context.folders[name]) for name in MOTIONS])
    free = runs.joined(
        [
            runs.fault_free(runs.read(context.folders[f"free_{m}_{s}"]), f"{m} {s}")
            for m, s in RECORDINGS
        ]
    )
    modelled, cues, published = (
        of_robot(free, AS_MODELLED),
        faulty.made.cues,
        faulty.made.verdict_cue,
    )
    sets = default_sets(cues, published)
    winners = choose(sums(faulty, modelled, sets, UNINTENDED), np.array(WEIGHTS))
    early = [k for k in sets if cues[k].threshold_mm == EARLY_MM]
    chosen = [sets[k] for k in np.unique(winners.winner)]
    compared = list(dict.fromkeys([published, *early, *chosen]))
    notes = read_notes(
        NAME,
        motion=events.event_meaning("unintended_motion", faulty.made.rules),
        hours=modelled["hours"].sum(),
        recordings=len(np.unique(modelled["recording"])),
        kinds=kinds.NOTE,
    )
    return Findings(
        lines=tuple(_lines(faulty, modelled, sets, winners, compared)),
        tables=(
            threshold_table(faulty, free, sets),
            choice_table(faulty, sets, winners),
            rules_table(faulty, free, sets),
            gain_table(faulty, modelled, compared[:2]),
            motion_table(free, sets),
        ),
        notes=notes,
    )


def _lines(
    faulty: Runs, modelled: Runs, sets: list[int], winners: Winners, compared: Sequence[int]
) -> Iterator[Line]:
    cues = faulty.made.cues
    yield from design_lines(faulty, modelled)
    for k in compared:
        published = " (published)" if k == faulty.made.verdict_cue else ""
        words, found = f"{cues[k].threshold_mm:g} mm{published}", felt(faulty, k)
        rates = {"unintended motion missed": found.missed}
        if not by_definition(faulty, k):
            rates["unintended motion felt before it began"] = found.before
        for what, one in rates.items():
            yield own_line(f"{words}: {what}", "%", in_percent(one, one.n, one.of))
        if not by_definition(faulty, k):
            yield own_line(f"{words}: median lead over the motion", "ms", found.lead_ms)
        yield own_line(f"{words}: false cues", "1/h", false_cues(modelled, k))
    thresholds = [cues[k].threshold_mm for k in sets]
    for weight, winner, wins, _, sure in zip(*winners, strict=True):
        mm, often = thresholds[winner], f"wins {100 * wins[winner]:.0f} % of resamples"
        # The thresholds between which 95 % of the resamples chose.
        low, high = (int(np.searchsorted(wins.cumsum(), end - 1e-9)) for end in (0.025, 0.975))
        ends = thresholds[low], thresholds[min(high, len(sets) - 1)]
        of = often if sure else f"cannot be said: {mm:g} mm {often}"
        yield own_line(
            f"threshold chosen where a missed unintended motion an hour weighs {weight:,.0f}"
            " false cues",
            "mm",
            StudyEstimate(mm if sure else np.nan, *ends, of=of),
        )


def design_lines(faulty: Runs, modelled: Runs) -> Iterator[Line]:
    """Yield how many faults, runs and hours a comparison has."""
    moved = faulty["unintended"]
    of = f"{kinds.count(faulty.faults)}, {len(MOTIONS)} motions"
    cells = StudyEstimate(len(np.unique(faulty["cell"])), of=of)
    hit = StudyEstimate(int(moved.sum()), n=len(moved), of="activated runs of this design")
    hours = StudyEstimate(round(float(modelled["hours"].sum()), 2))
    yield own_line("faults, distinct", "", cells)
    yield own_line("faulty runs with unintended motion", "runs", hit)
    yield own_line("motion without a fault, robot as modelled", "h", hours)


def _variants() -> tuple[Variant, ...]:
    question = "How often is there a cue for nothing?"
    free = [runs.free_variant(CAMPAIGN, one, FREE_RUNS, FREE_S, question) for one in RECORDINGS]
    return (*runs.faulty_variants(CAMPAIGN), *free)


STUDY = study(NAME, variants=_variants(), compare=compare)
