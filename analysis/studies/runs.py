"""Reads the runs of a study's campaigns: columns of the result table with the values that the
report derives, and campaigns with different motions as one table.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.outcomes import verdict
from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections.reaction import EXCURSION, Pairs
from ravenjax.stats import latency, units
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.units import Units
from ravenjax.store import folder, manifest
from ravenjax.store.access import query
from ravenjax.store.manifest import Manifest
from studies import kinds
from studies.hazards import classes
from studies.study import Line, StudyEstimate, own_line

SCALE, DEFAULT_SCALE = "param:operator.scale", 0.1
FREE = "free/"
"""Prefix of the names of groups without faults."""
AS_MODELLED, UNCERTAIN = "as modelled", "uncertain robot"
"""Groups without faults, after the prefix."""
RECORDED, CLUTCHED = "recorded", "clutched"
"""Prefixes of people's recorded hands, and of recordings in which the pedal goes up and down."""
MOTIONS = ("suture", "reach", "peg_transfer", "palpate")
"""Variants with faults whose runs are pooled."""
MOVED = "runs with an unintended motion"


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
    """Read a result folder. Facts replace columns of the same name. Added are EXCURSION, `injury`
    (-capable), `stopped` (by a check) and `unwarned` (unintended motion without an earlier cue).
    """
    frame, made = folder.read_all(path), manifest.read_manifest(path)
    with query.open_empty() as table:
        run_facts.register_table(table, frame)
        run_facts.define_facts(table, run_facts.recorded_choices(made))
        facts = table.frame("SELECT * EXCLUDE row FROM facts ORDER BY row").set_axis(frame.index)
    words = ("response", "hazard", "outcome", "site", "layer", "block")
    facts = facts.astype({name: "str" for name in words if name in facts} | {"group": "category"})
    warned = (facts["warned_ms"] >= 0) & (facts["warned_ms"] < facts["unintended_ms"])
    events = {
        EXCURSION: frame[["unintended_mm", "unintended_off_mm"]].max(axis=1),
        "injury": classes.injury_capable(frame),
        "stopped": facts["response"] == "stopped",
        "unwarned": facts["unintended"] & ~warned,
    }
    plain = frame.drop(columns=frame.columns.intersection(facts.columns))
    # A copy is in one piece, so that columns can be added.
    return Runs(pd.concat([plain, pd.DataFrame(events), facts], axis=1).copy(), made)


def warning_times(runs: Runs, cue: int) -> np.ndarray:
    """Return when each run had a cue that its golden run did not have, ms [runs]; -1: never."""
    times = (runs[f"{prefix}cue{cue}_first_ms"] for prefix in ("", "golden_"))
    return verdict.beyond_golden(*times)


def changed_a_bit(runs: Runs) -> np.ndarray:
    """Return which runs have a fault that changed a bit, and a valid outcome, bool [runs]."""
    return runs["activated"] & runs["faulty"] & ~runs["failed"]


def acting_pairs(with_: pd.DataFrame, without: pd.DataFrame) -> Pairs:
    """Return the valid pairs of two tables of the same faults that changed a bit without it."""
    pairs = Pairs(*(part.sort_values("pair") for part in (with_, without)))
    failed = np.any([part["failed"] for part in pairs], axis=0)
    return pairs.where(~failed & pairs.without["activated"].to_numpy(bool))


def pooled(folders: Mapping[str, Path], motions: Iterable[str] = MOTIONS) -> Runs:
    """Pool the activated faulty runs of the campaigns named by these motions, in which nothing else
    differs. Adds `cell` (number of the fault, equal in every motion) and `motion`.
    """
    campaigns = [read(folders[name]) for name in motions if name in folders]
    first, parts = campaigns[0], []
    for motion, runs in enumerate(campaigns):
        numbered = runs.frame.assign(cell=first["distinct"], motion=motion)
        parts.append(numbered.loc[changed_a_bit(runs)])
    return Runs(pd.concat(parts, ignore_index=True), first.made)


def fault_free(path: Path) -> Runs:
    """Read the runs without a fault, and their robot, recording and pedal-down hours."""
    runs, (motion, seed) = read(path), path.name.partition("_")[2].rsplit("_", 1)
    group = runs.frame["group"].astype(str)
    free = runs.frame.assign(
        robot=group.str.removeprefix(FREE),
        recording=f"{motion} {seed}",
        hours=runs["pedal_down_ms"] / 3.6e6,
    )
    return Runs(free.loc[group.str.startswith(FREE).to_numpy() & ~runs["failed"]], runs.made)


def joined(parts: Sequence[Runs]) -> Runs:
    """Return the runs of several campaigns together."""
    return Runs(pd.concat([part.frame for part in parts], ignore_index=True), parts[0].made)


def of_robot(free: Runs, robot: str) -> Runs:
    """Return the fault-free runs of one robot."""
    return free.where(free["robot"] == robot)


def unclutched(free: Runs) -> Runs:
    """Return motion in which the pedal stays down."""
    return free.where(~np.char.startswith(free["recording"].astype(str), CLUTCHED))


def split_hands(free: Runs) -> tuple[Runs, Runs]:
    """Return motion without a fault of recorded hands (robot as modelled, default scale, no command
    that the overdrive check limits) and all generated motion.
    """
    recorded = np.char.startswith(free["recording"].astype(str), RECORDED)
    clean = (free["check_overdrive_clip_count"] == 0) & (free["check_estop_first_ms"] < 0)
    default = (free["robot"] == AS_MODELLED) & np.isclose(free[SCALE], DEFAULT_SCALE)
    return free.where(recorded & default & clean), free.where(~recorded)


def median_times(runs: Runs, first_ms: np.ndarray) -> tuple[StudyEstimate, StudyEstimate]:
    """Return the medians of an alarm's delay after the fault's first effect, and of its lead over
    the unintended motion, with intervals over kinds of faults. `first_ms`: [runs], -1: never.
    """
    came, faults = first_ms >= 0, runs.faults
    spoke = np.where(came, first_ms, float(runs.made.duration_ms))
    delay = latency.delay_quantile(spoke - runs["active_ms"], came, 0.5, faults)
    value, low, high = latency.delay_quantile(spoke - runs["unintended_ms"], came, 0.5, faults)
    over = len(came), "faults with an unintended motion"
    return StudyEstimate(*delay, *over), StudyEstimate(-value, -high, -low, *over)


def per_hour(free: Runs, counts: np.ndarray, of: str = "alarms") -> StudyEstimate:
    """Return the rate of `counts` [runs] per hour, with an interval by resampling recordings, if
    there are enough. For a count of zero it is the exact Poisson one.
    """
    total, hours = int(counts.sum()), float(free["hours"].sum())
    exact = alarm_rate(total, hours)
    low, high = exact.low, exact.high
    if total:
        _, low, high = units.ratio_band(counts, free["hours"], units.group_units(free["recording"]))
    words = f"{of} in {hours:.{1 if hours >= 0.1 else 2}f} h"
    return StudyEstimate(exact.per_hour, float(low), float(high), total, words)


def share(hit: np.ndarray, among: np.ndarray, faults: Units, of: str) -> StudyEstimate:
    """Return the rate of `hit` among `among` (bool [runs]), with its interval over kinds."""
    mine = faults.where(among)
    rate = units.rate_band(hit[among], mine, resamples=400)
    words = f"{of}, {kinds.count(mine)}" if rate.n else of
    return StudyEstimate(rate.value, rate.low, rate.high, rate.n, words)


def design_lines(faulty: Runs, modelled: Runs) -> Iterator[Line]:
    """Yield how many faults, runs and hours a comparison has."""
    moved = faulty["unintended"]
    of = f"{kinds.count(faulty.faults)}, {len(np.unique(faulty['motion']))} motions"
    cells = StudyEstimate(len(np.unique(faulty["cell"])), of=of)
    hit = StudyEstimate(int(moved.sum()), n=len(moved), of="runs in which the fault changed a bit")
    hours = StudyEstimate(round(float(modelled["hours"].sum()), 2))
    yield own_line("distinct faults", "", cells)
    yield own_line("faulty runs with an unintended motion", "runs", hit)
    yield own_line("fault-free motion, robot as modelled", "h", hours)
