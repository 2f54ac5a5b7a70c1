"""Study of the haptic cue: which faults are felt, when and how strongly, how many false cues come,
and which threshold is best.

All sets of threshold and gains are evaluated in the same runs, and nobody reacts. A cue of a faulty
run counts from the fault's first effect on, and only if the golden run had none by then. A
threshold costs weight x (share of hazards missed) + false cues per hour. The weight is unknown, so
it is swept. Kinds of faults and recordings are resampled to show how certain a choice is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import facts as run_facts
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.bootstrap.units import group_units as units_of
from ravenjax.store import folder, manifest
from ravenjax.store.manifest import CueRecord, Manifest
from studies import kinds, motions_alike
from studies.detectors import (
    AS_MODELLED,
    BY_DEFINITION,
    CLUTCHED,
    FREE,
    MOVED,
    SCALE,
    UNCERTAIN,
    hundred,
    median_times,
    per_hour,
    percent,
    plain,
    rate,
    share,
)
from studies.hazards import severity
from studies.motions_alike import MOTIONS, RECORDINGS, Activated
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    own_line,
    read_notes,
    study,
    table,
)

RESAMPLES = 2000
WEIGHTS = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)
"""Weights shown in tables."""
SURE = 0.95
"""Share of resamples that a set must win to be named."""


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

    @property
    def sure(self) -> np.ndarray:
        """Return whether the choice at each weight is certain enough to be named, bool
        [weights].
        """
        return self.wins[np.arange(len(self.weight)), self.winner] >= SURE


def counts(
    missed: np.ndarray, faults: Units, false: np.ndarray, hours: np.ndarray, recording: np.ndarray
) -> Counts:
    """Return sums of missed (bool [hazards, sets]) by kind of fault, and of false cues [runs, sets]
    by recording.
    """
    free = units_of(recording)
    return Counts(
        _by(faults, missed.astype(float)),
        _by(faults, np.ones(len(missed))),
        Units(np.arange(faults.count), faults.stratum),
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
    weight = np.asarray(weights, float)
    share, rate = (
        found.missed.sum(axis=0) / found.hazards.sum(),
        found.false.sum(axis=0) / found.hours.sum(),
    )
    rng = np.random.default_rng(seed)
    faults = found.kinds.weights(resamples, seed)
    recordings = rng.multinomial(
        len(found.hours), np.full(len(found.hours), 1 / len(found.hours)), resamples
    )
    shares = (faults @ found.missed) / (faults @ found.hazards)[:, None]
    counts, hours = recordings @ found.false, (recordings @ found.hours)[:, None]
    rates = np.where(counts > 0, counts, rng.exponential(size=counts.shape)) / hours
    wins = np.stack(
        [_won(_cheapest(one * shares + rates), found.missed.shape[1]) for one in weight]
    )
    cost = weight[:, None] * share + rate
    return Winners(weight, _cheapest(cost), wins, cost)


def _cheapest(cost: np.ndarray) -> np.ndarray:
    """Return the last of the cheapest [..., sets]. Costs that differ only by rounding are equal."""
    near = cost <= cost.min(axis=-1, keepdims=True) * (1 + 1e-12)
    return cost.shape[-1] - 1 - np.argmax(near[..., ::-1], axis=-1)


def _won(chosen: np.ndarray, sets: int) -> np.ndarray:
    return np.bincount(chosen, minlength=sets) / len(chosen)


def _by(among: Units, values: np.ndarray) -> np.ndarray:
    """Return sums [units, ...] of values [n, ...]."""
    total = np.zeros((among.count, *values.shape[1:]))
    np.add.at(total, among.unit, values)
    return total


UNINTENDED, INJURY, JUMP = "unintended motion", "injury-capable motion", "jump of the true tip"
KINDS = (UNINTENDED, INJURY, JUMP)
"""What a cue is to announce. The first is a hazard of `ravenjax.outcomes`."""


class FaultyCues(NamedTuple):
    """Activated faulty runs, one entry per run; times in ms from the start of the run, -1:
    never.
    """

    cues: tuple[CueRecord, ...]
    published: int  # number of the published set
    cell: np.ndarray  # int, equal for runs of one fault
    kind: np.ndarray  # int, equal for runs of one kind of fault (`kinds`)
    family: np.ndarray  # int, stratum of the kind
    motion: np.ndarray  # int, number of the campaign of the run
    active_ms: np.ndarray
    unintended_ms: np.ndarray  # when the unintended motion began
    kinds: np.ndarray  # bool [runs, KINDS]
    first_ms: np.ndarray  # [runs, cues], time at which the fault was felt
    force: np.ndarray  # [runs, cues], largest force, device units
    felt_ms: np.ndarray  # [runs, cues], duration
    duration_ms: int
    rules: Rules  # rules of the outcomes

    @property
    def unintended(self) -> np.ndarray:
        """Return which runs had an unintended motion."""
        return self.kinds[:, KINDS.index(UNINTENDED)]

    @property
    def faults(self) -> Units:
        """Return the kinds of faults of the runs, which are the units of intervals."""
        return units_of(self.kind, self.family)

    def where(self, chosen: np.ndarray) -> FaultyCues:
        """Return the runs that `chosen` selects, a mask or indices."""
        return self._replace(**{name: getattr(self, name)[chosen] for name in _BY_RUN})

    def once(self) -> FaultyCues:
        """Return one run of each fault, taking the motions in turn."""
        return self.where(motions_alike.one_of_each_fault(self.cell, self.motion))


_BY_RUN = (
    "cell",
    "kind",
    "family",
    "motion",
    "active_ms",
    "unintended_ms",
    "kinds",
    "first_ms",
    "force",
    "felt_ms",
)


class FreeCues(NamedTuple):
    """Runs without a fault, one entry per run."""

    cues: tuple[CueRecord, ...]
    robot: np.ndarray  # in words
    recording: np.ndarray  # in words: motion and seed
    scale: np.ndarray
    hours: np.ndarray  # in pedal-down
    count: np.ndarray  # [runs, cues], separate pulses
    felt_hours: np.ndarray  # [runs, cues], duration

    def where(self, chosen: np.ndarray) -> FreeCues:
        """Return the runs that `chosen` selects."""
        return self._replace(**{name: getattr(self, name)[chosen] for name in _FREE_BY_RUN})


_FREE_BY_RUN = ("robot", "recording", "scale", "hours", "count", "felt_hours")


def default_sets(cues: Sequence[CueRecord], published: int) -> list[int]:
    """Return the numbers of the sets with the published gains, by rising threshold."""
    own = cues[published]
    alike = [k for k, cue in enumerate(cues) if _gains(cue) == _gains(own)]
    return sorted(alike, key=lambda k: cues[k].threshold_mm)


def sets_at(cues: Sequence[CueRecord], threshold_mm: float) -> list[int]:
    """Return the numbers of the sets with one threshold."""
    return [k for k, cue in enumerate(cues) if cue.threshold_mm == threshold_mm]


def read_faulty(folders: Sequence[Path]) -> FaultyCues:
    """Read activated faulty runs of campaigns that differ only in their motion. Raises ValueError
    if their faults differ.
    """
    read = [(folder.read_all(path), manifest.read_manifest(path)) for path in folders]
    return pooled([frame for frame, _ in read], read[0][1])


def pooled(frames: Sequence[pd.DataFrame], made: Manifest) -> FaultyCues:
    """Pool result tables in memory, as `read_faulty` does with folders. `made`: manifest of the
    first.
    """
    parts = [_faulty(one, made) for one in motions_alike.activated(frames, made)]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_RUN}
    )


def _faulty(runs: Activated, made: Manifest) -> FaultyCues:
    frame, facts = runs.frame, runs.facts
    active, every = facts["active_ms"].to_numpy(), range(len(made.cues))

    def columns(name: str) -> np.ndarray:
        return np.stack([frame[name.format(k)].to_numpy() for k in every], axis=1)

    own = np.stack([run_facts.warning_times(frame, k) for k in every], axis=1)
    return FaultyCues(
        cues=made.cues,
        published=made.verdict_cue,
        cell=runs.cell,
        kind=runs.kind,
        family=runs.family,
        motion=np.full(len(frame), runs.motion),
        active_ms=active,
        unintended_ms=facts["unintended_ms"].to_numpy(),
        kinds=np.stack(
            [
                facts["unintended"].to_numpy(bool),
                severity.injury_capable(frame).to_numpy(bool),
                frame["jump_tip"].to_numpy(bool),
            ],
            axis=1,
        ),
        first_ms=np.where(own >= active[:, None], own, -1),
        force=columns("cue{}_peak_force").astype(float),
        felt_ms=columns("cue{}_ms"),
        duration_ms=made.duration_ms,
        rules=made.rules,
    )


def read_free(folders: Sequence[tuple[str, Path]]) -> FreeCues:
    """Read fault-free runs of campaigns, each with the name of its recording."""
    parts = [
        alone(folder.read_all(path), manifest.read_manifest(path), name) for name, path in folders
    ]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _FREE_BY_RUN}
    )


def alone(frame: pd.DataFrame, made: Manifest, recording: str) -> FreeCues:
    """Return the fault-free runs of one result table in memory, as `read_free` does. Faulty runs
    are left out.
    """
    frame = frame.loc[frame["group"].astype(str).str.startswith(FREE) & (frame["failed"] == "")]
    return FreeCues(
        made.cues,
        frame["group"].astype(str).str.removeprefix(FREE).to_numpy(object),
        np.full(len(frame), recording, object),
        frame[SCALE].to_numpy(float),
        frame["pedal_down_ms"].to_numpy(float) / 3.6e6,
        np.stack([frame[f"cue{k}_count"].to_numpy() for k in range(len(made.cues))], axis=1),
        np.stack(
            [frame[f"cue{k}_ms"].to_numpy(float) / 3.6e6 for k in range(len(made.cues))], axis=1
        ),
    )


def _gains(cue: CueRecord) -> tuple[float, float]:
    return cue.kp_per_mm, cue.kd_s_per_mm


AT_CAP = 0.999
"""Share of the cap from which a force counts as capped, because forces are stored as float32."""
SLOW = 0.1
"""Largest scale of motion that is called slow."""
SHOWN_MM = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Thresholds in the table of false cues by motion."""


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


def missed(faulty: FaultyCues, sets: Sequence[int], before: bool = False) -> np.ndarray:
    """Return which runs had no cue of each set, or none `before` their unintended motion: bool
    [runs, sets].
    """
    first = faulty.first_ms[:, list(sets)]
    late = (first >= faulty.unintended_ms[:, None]) & (faulty.unintended_ms >= 0)[:, None]
    return (first < 0) | late if before else first < 0


def sums(
    faulty: FaultyCues, free: FreeCues, sets: Sequence[int], kind: str, before: bool = False
) -> Counts:
    """Return the sums for a choice among `sets`, for hazards of one of KINDS. `before`: a cue after
    the hazard began counts as missed.
    """
    hazards = faulty.where(faulty.kinds[:, KINDS.index(kind)])
    return counts(
        missed(hazards, sets, before),
        hazards.faults,
        free.count[:, list(sets)],
        free.hours,
        free.recording,
    )


def by_definition(faulty: FaultyCues, k: int) -> bool:
    """Return whether set number k fires at the limit of the unintended motion or beyond.

    By the definitions alone, its cue then comes as the motion begins or later, except for the
    difference between reported and true tip.
    """
    return faulty.cues[k].threshold_mm >= faulty.rules.limit_mm


def felt(faulty: FaultyCues, k: int) -> CueResult:
    """Return what set number k announces of faults that cause an unintended motion."""
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
    """Return false cues per hour of set k with one robot."""
    mine = free.where(free.robot == robot)
    return per_hour(mine.count[:, k], mine.hours, mine.recording, "cues")


def false_time(free: FreeCues, k: int, robot: str) -> str:
    """Return the share of fault-free motion in which set k pulls, with one robot."""
    mine = free.where(free.robot == robot)
    hours = float(mine.hours.sum())
    value = float(mine.felt_hours[:, k].sum()) / hours
    band = units.ratio_band(mine.felt_hours[:, k], mine.hours, units_of(mine.recording))
    if not value or np.isnan(band.low):
        return f"{wording.format_percent(value)} of {hours:.1f} h"
    return (
        f"{wording.format_percent(value)} ({wording.format_percent(band.low)} to"
        f" {wording.format_percent(band.high)}) of {hours:.1f} h"
    )


def threshold_table(faulty: FaultyCues, free: FreeCues, sets: Sequence[int]) -> Table:
    """Return what each threshold does, with the published gains."""
    rows = []
    for k in sets:
        result = felt(faulty, k)
        rows.append(
            {
                "threshold, mm": faulty.cues[k].threshold_mm,
                "missed": percent(result.missed),
                "felt before it began": percent(result.before),
                "felt, of the other faulty runs": percent(result.others),
                "median delay, ms": plain(result.delay_ms),
                "median lead, ms": plain(result.lead_ms),
                "largest force": result.force,
                "at the cap": percent(result.at_cap),
                "time felt, ms": result.felt_ms,
                "false cues an hour": rate(false_cues(free, k, AS_MODELLED)),
                "time with one": false_time(free, k, AS_MODELLED),
                "false cues with an uncertain robot": rate(false_cues(free, k, UNCERTAIN)),
            }
        )
    return table(
        "Thresholds, with the published gains",
        rows,
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
    """Return what the data choose at each weight, and how certain the choice is."""
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
            {
                "a missed unintended motion an hour weighs so many false cues": f"{weight:,.0f}",
                "threshold, mm": mm if sure else f"cannot be said; {mm:g} costs least",
                "wins": f"{100 * wins[winner]:.0f} %",
                "else wins": ", ".join(others),
                "cost, false cues an hour": float(f"{cost[winner]:.3g}"),
                f"cost of {faulty.cues[faulty.published].threshold_mm:g} mm": float(
                    f"{cost[published]:.3g}"
                ),
                "it wins": f"{100 * wins[published]:.0f} %",
            }
        )
    return table(
        "The threshold that the data would choose",
        rows,
        "Cost: weight x share missed + false cues an hour. Wins: of 2 000 draws of kinds of faults"
        f" and of recordings with replacement; a threshold is named from {100 * SURE:.0f} %"
        " on. Among thresholds with the published gains; of equals the highest.",
    )


def rules_table(faulty: FaultyCues, free: FreeCues, sets: Sequence[int]) -> Table:
    """Return what is chosen under other rules: other hazards, another meaning of a miss, or other
    fault-free motion.
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
        winners = choose(sums(faulty, mine, sets, kind, before), np.array(WEIGHTS))
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
            *(f"weight {weight:,.0f}" for weight in WEIGHTS),
        ),
        tuple(rows),
        "Injury-capable motion: a jump of the true tip, an unintended motion of more than"
        f" {LIMIT_MM:g} mm (live or not), or more than 1 mm deeper in the tissue. Hazards are at"
        " scale 0.1, robot as modelled. 8 mm is the highest threshold that was tried: where it"
        " wins, a higher one, or no cue at all, might.",
    )


def gain_table(faulty: FaultyCues, modelled: FreeCues, numbers: Sequence[int]) -> Table:
    """Return what the gains change at some sets' thresholds."""
    rows = []
    for mm in dict.fromkeys(faulty.cues[k].threshold_mm for k in numbers):
        for k in sets_at(faulty.cues, mm):
            result, cue = felt(faulty, k), faulty.cues[k]
            false = per_hour(modelled.count[:, k], modelled.hours, modelled.recording, "cues")
            rows.append(
                {
                    "threshold, mm": mm,
                    "Kp, per mm": cue.kp_per_mm,
                    "Kd, per mm/s": damper(cue),
                    "missed": percent(result.missed),
                    "median delay, ms": plain(result.delay_ms),
                    "largest force": result.force,
                    "at the cap": percent(result.at_cap),
                    "time felt, ms": result.felt_ms,
                    "false cues an hour": rate(false),
                }
            )
    return table(
        "Gains",
        rows,
        "Missed: of runs with unintended motion. Force in device units, cap 0.05. The gains were"
        " not published: 0.0045 per mm was read off Figure 5 of IROS 2016, the damper made out of"
        " its third pulse.",
    )


def motion_table(free: FreeCues, sets: Sequence[int]) -> Table:
    """Return false cues per hour by motion and scale."""
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


def _with_count(value: StudyEstimate) -> str:
    """Write 12 (10 to 15); 8 of them."""
    return f"{plain(value)}; {wording.format_count(value.n)}"


def damper(cue: CueRecord) -> str:
    """Write damping in device units per mm/s, without an exponent."""
    return np.format_float_positional(cue.kd_s_per_mm, trim="-")


def _quartiles(values: np.ndarray) -> str:
    """Write the median (first to third quartile)."""
    if not len(values):
        return wording.DASH
    low, middle, high = (
        wording.format_number(float(one)) for one in np.percentile(values, [25, 50, 75])
    )
    return f"{middle} ({low} to {high})"


CAMPAIGN = "haptic_sweep.toml"
FREE_RUNS, FREE_S = 32, 120
EARLY_MM = 1.0
"""A threshold below the limit of the unintended motion, which is compared for any choice."""


class _Choice(NamedTuple):
    """The sets that are compared: those with the published gains, by rising threshold, and the
    winners among them.
    """

    sets: list[int]
    winners: Winners

    @property
    def numbers(self) -> list[int]:
        """Return the numbers of the sets that win at any weight of the tables, by rising
        threshold.
        """
        return [self.sets[k] for k in np.unique(self.winners.winner)]


def compare(context: Context) -> Findings:
    """Compare all sets over the same runs."""
    faulty = read_faulty([context.folders[name] for name in MOTIONS])
    free = read_free([(f"{m} {s}", context.folders[f"free_{m}_{s}"]) for m, s in RECORDINGS])
    return findings(faulty, free)


def findings(faulty: FaultyCues, free: FreeCues) -> Findings:
    """Compare runs in memory, as `compare` does."""
    modelled = free.where(free.robot == AS_MODELLED)
    sets = default_sets(faulty.cues, faulty.published)
    choice = _Choice(
        sets,
        choose(sums(faulty, modelled, sets, UNINTENDED), np.array(WEIGHTS)),
    )
    early = [k for k in sets if faulty.cues[k].threshold_mm == EARLY_MM]
    compared = list(dict.fromkeys([faulty.published, *early, *choice.numbers]))
    return Findings(
        lines=tuple(_lines(faulty, modelled, choice, compared)),
        tables=(
            threshold_table(faulty, free, sets),
            choice_table(faulty, choice.sets, choice.winners),
            rules_table(faulty, free, sets),
            gain_table(faulty, modelled, compared[:2]),
            motion_table(free, sets),
        ),
        notes=_notes(faulty, modelled),
    )


def _lines(
    faulty: FaultyCues, modelled: FreeCues, choice: _Choice, compared: Sequence[int]
) -> list[Line]:
    moved = faulty.unintended
    cells = StudyEstimate(
        len(np.unique(faulty.cell)), of=f"{kinds.count(faulty.faults)}, {len(MOTIONS)} motions"
    )
    lines = [
        own_line("faults, distinct", "", cells),
        own_line(
            "faulty runs with unintended motion",
            "runs",
            StudyEstimate(int(moved.sum()), n=len(moved), of="activated runs of this design"),
        ),
        own_line(
            "motion without a fault, robot as modelled",
            "h",
            StudyEstimate(round(float(modelled.hours.sum()), 2)),
        ),
    ]
    for k in compared:
        words = f"{faulty.cues[k].threshold_mm:g} mm" + (
            " (published)" if k == faulty.published else ""
        )
        never = missed(faulty, [k])[:, 0]
        before = (faulty.first_ms[:, k] >= 0) & (faulty.first_ms[:, k] < faulty.unintended_ms)
        rates = {"unintended motion missed": never}
        if not by_definition(faulty, k):
            rates["unintended motion felt before it began"] = before
        lines += [
            own_line(f"{words}: {what}", "%", hundred(share(hit, moved, faulty.faults, MOVED)))
            for what, hit in rates.items()
        ]
        if not by_definition(faulty, k):
            lines.append(
                own_line(f"{words}: median lead over the motion", "ms", felt(faulty, k).lead_ms)
            )
        false = per_hour(modelled.count[:, k], modelled.hours, modelled.recording, "cues")
        lines.append(own_line(f"{words}: false cues", "1/h", false))
    for weight, winner, wins, sure in zip(*choice.winners[:3], choice.winners.sure, strict=True):
        mm, wins_often = (
            faulty.cues[choice.sets[winner]].threshold_mm,
            f"wins {100 * wins[winner]:.0f} % of resamples",
        )
        threshold = StudyEstimate(
            mm if sure else np.nan,
            *_range([faulty.cues[k].threshold_mm for k in choice.sets], wins),
            of=wins_often if sure else f"cannot be said: {mm:g} mm {wins_often}",
        )
        lines.append(
            own_line(
                f"threshold chosen where a missed unintended motion an hour weighs {weight:,.0f}"
                " false cues",
                "mm",
                threshold,
            )
        )
    return lines


def _range(values: Sequence[float], wins: np.ndarray) -> tuple[float, float]:
    """Write the values between which 95 % of the resamples chose."""
    below = np.cumsum(wins)
    low, high = (int(np.searchsorted(below, end - 1e-9)) for end in (0.025, 0.975))
    return values[low], values[min(high, len(values) - 1)]


def _notes(faulty: FaultyCues, modelled: FreeCues) -> tuple[str, ...]:
    return read_notes(
        "haptic_cue",
        motion=events.event_meaning("unintended_motion", faulty.rules),
        hours=modelled.hours.sum(),
        recordings=len(np.unique(modelled.recording)),
        kinds=kinds.NOTE,
    )


def _variants() -> tuple[Variant, ...]:
    return (
        *motions_alike.faulty(CAMPAIGN),
        *(
            motions_alike.fault_free(
                CAMPAIGN, motion, seed, FREE_RUNS, FREE_S, "How often is there a cue for nothing?"
            )
            for motion, seed in RECORDINGS
        ),
    )


STUDY = study("haptic_cue", variants=_variants(), compare=compare)
