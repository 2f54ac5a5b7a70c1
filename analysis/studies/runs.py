"""Reads the runs of a study's campaigns: results beside their facts, and motions pooled."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.outcomes import verdict
from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections.reaction import EXCURSION
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.store import folder, manifest
from ravenjax.store.manifest import Manifest
from studies import kinds
from studies.hazards import severity
from studies.study import StudyEstimate, Variant

SCALE = "param:operator.scale"
FREE = "free/"
"""Prefix of the names of groups without faults."""
AS_MODELLED, UNCERTAIN = "as modelled", "uncertain robot"
"""Groups without faults, after the prefix."""
CLUTCHED = "clutched"
"""Prefix of the recordings in which the pedal goes up and down."""
BASELINE = "suture"
MOTIONS = (BASELINE, "reach", "peg_transfer", "palpate")
"""Variants with faults whose runs are pooled."""
RECORDINGS = (
    *((motion, seed) for motion in ("suture", "reach", "peg_transfer") for seed in (11, 12)),
    *((motion, 11) for motion in ("palpate", "circle", CLUTCHED)),
)
"""Motion and seed of each fault-free recording. None is one of the faulty motions."""


@dataclasses.dataclass(frozen=True, eq=False)
class Runs:
    """Runs of one campaign, or of campaigns that differ only in their motion."""

    frame: pd.DataFrame  # a row per run: columns of the result table and of its facts
    made: Manifest  # of the first campaign

    def __getitem__(self, column: str) -> np.ndarray:
        return self.frame[column].to_numpy()

    def where(self, chosen: np.ndarray) -> Runs:
        """Return the runs that `chosen` selects, a mask or positions."""
        return Runs(
            self.frame.loc[chosen] if chosen.dtype == bool else self.frame.iloc[chosen], self.made
        )

    @property
    def faults(self) -> Units:
        """Return the kinds of faults of the runs, which are the units of intervals."""
        return kinds.of(self.frame["group"])

    def once(self) -> Runs:
        """Return one run of each fault, taking the motions in turn."""
        cell, motion = self["cell"], self["motion"]
        motions = np.unique(motion)
        # If the run of the fault's own motion was not activated, take another run of the fault.
        order = np.lexsort((motion != motions[cell % len(motions)], cell))
        return self.where(np.sort(order[np.unique(cell[order], return_index=True)[1]]))


def read(path: Path) -> Runs:
    """Read a result folder. Facts replace columns of the same name; EXCURSION and `injury` (an
    injury-capable motion) are added. Raises StoreError.
    """
    frame, made = folder.read_all(path), manifest.read_manifest(path)
    facts = run_facts.derive_facts(frame, run_facts.recorded_choices(made))
    frame[EXCURSION] = frame[["unintended_mm", "unintended_off_mm"]].max(axis=1)
    frame["injury"] = severity.injury_capable(frame)
    plain = frame.drop(columns=frame.columns.intersection(facts.columns))
    return Runs(pd.concat([plain, facts], axis=1), made)


def warning_times(runs: Runs, cue: int) -> np.ndarray:
    """Return when each run had a cue that its golden run did not have, ms [runs]; -1: never."""
    times = (runs[f"{prefix}cue{cue}_first_ms"] for prefix in ("", "golden_"))
    return verdict.beyond_golden(*times)


def changed_a_bit(runs: Runs) -> np.ndarray:
    """Return which runs have a fault that changed a bit, and a valid outcome, bool [runs]."""
    return runs["activated"] & runs["faulty"] & ~runs["failed"]


def pooled(campaigns: Sequence[Runs]) -> Runs:
    """Pool the activated faulty runs of campaigns that differ only in their motion.

    Adds the columns `cell` (number of the fault, equal in every motion) and `motion`. Raises
    ValueError if the faults differ.
    """
    first, parts = campaigns[0], []
    for motion, runs in enumerate(campaigns):
        if not np.array_equal(runs["group"].astype(str), first["group"].astype(str)):
            raise ValueError(
                f"campaign {motion} of a comparison of motions has other groups than the first"
            )
        numbered = runs.frame.assign(cell=first["distinct"], motion=motion)
        parts.append(numbered.loc[changed_a_bit(runs)])
    return Runs(pd.concat(parts, ignore_index=True), first.made)


def fault_free(runs: Runs, recording: str) -> Runs:
    """Return the runs without a fault, with the columns `robot` and `recording` (in words) and
    `hours` (in pedal-down).
    """
    free = runs.where(
        runs.frame["group"].astype(str).str.startswith(FREE).to_numpy() & ~runs["failed"]
    )
    robot = free.frame["group"].astype(str).str.removeprefix(FREE)
    hours = free["pedal_down_ms"] / 3.6e6
    return Runs(free.frame.assign(robot=robot, recording=recording, hours=hours), runs.made)


def joined(parts: Sequence[Runs]) -> Runs:
    """Return the runs of several campaigns together."""
    return Runs(pd.concat([part.frame for part in parts], ignore_index=True), parts[0].made)


def median_times(runs: Runs, first_ms: np.ndarray) -> tuple[StudyEstimate, StudyEstimate]:
    """Return the medians of an alarm's delay after the fault's first effect, and of its lead over
    the unintended motion, with intervals over kinds of faults. `first_ms`: [runs], -1: never.
    """
    came, faults = first_ms >= 0, runs.faults
    spoke = np.where(came, first_ms, float(runs.made.duration_ms))
    delay = latency.delay_quantile(spoke - runs["active_ms"], came, 0.5, faults)
    value, low, high = latency.delay_quantile(spoke - runs["unintended_ms"], came, 0.5, faults)
    of = "faults with unintended motion"
    return (
        StudyEstimate(*delay, len(came), of),
        StudyEstimate(-value, -high, -low, len(came), of),
    )


def per_hour(free: Runs, counts: np.ndarray, of: str = "alarms") -> StudyEstimate:
    """Return the rate of `counts` [runs] per hour, with an interval by resampling recordings.

    There is no interval for too few recordings. For a count of zero, the interval is the exact
    Poisson one, as if the hours were independent.
    """
    total, hours = int(counts.sum()), float(free["hours"].sum())
    exact = alarm_rate(total, hours)
    low, high = exact.low, exact.high
    if total:
        band = units.ratio_band(counts, free["hours"], units.group_units(free["recording"]))
        low, high = float(band.low), float(band.high)
    return StudyEstimate(exact.per_hour, low, high, total, f"{of} in {hours:.1f} h")


def share(
    hit: np.ndarray, among: np.ndarray, faults: Units, of: str, resamples: int = 400
) -> StudyEstimate:
    """Return the rate of `hit` among `among` (bool [runs]), with its interval over kinds of faults
    (`units.rate_band`).

    `faults`: kinds of the runs. The rate is NaN if no run is among them.
    """
    mine = faults.where(among)
    rate = units.rate_band(hit[among], mine, resamples=resamples)
    words = f"{of}, {kinds.count(mine)}" if rate.n else of
    return StudyEstimate(rate.value, rate.low, rate.high, rate.n, words)


def faulty_variants(campaign: str) -> Iterator[Variant]:
    """Yield the campaign with its faults under each of MOTIONS."""
    yield Variant(BASELINE, campaign)
    for motion in MOTIONS[1:]:
        question = f"Does the motion matter? {motion}"
        yield Variant(motion, campaign, (f"operator.motion={motion}",), question)


def free_variant(
    campaign: str,
    recording: tuple[str, int],
    runs: int,
    seconds: float,
    question: str,
    kind: str = "free",
    more: tuple[str, ...] = (),
) -> Variant:
    """Return a fault-free recording of one motion: the first `runs` of a campaign, each of length
    `seconds`.
    """
    motion, seed = recording
    overrides = (
        f"campaign.limit={runs}",
        f"campaign.duration_s={seconds}",
        *more,
        f"operator.motion={motion}",
        f"operator.seed={seed}",
    )
    return Variant(
        f"{kind}_{motion}_{seed}", campaign, overrides, f"{question} {motion}, seed {seed}"
    )
