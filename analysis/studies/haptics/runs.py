"""What the study of the haptic cue reads from its campaigns: what is felt in faulty runs, and
without a fault.

A cue of a faulty run counts from the fault's first effect on, and only where the golden run had
none by then: one that the golden run has, too, tells of the motion and not of the fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import severity
from ravenjax.outcomes.events import Rules
from ravenjax.report.data import facts as run_facts
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.store import folder, manifest
from ravenjax.store.manifest import CueRecord, Manifest
from studies.detection.runs import FREE, SCALE
from studies.framework import motions_alike
from studies.framework.motions_alike import Activated

UNINTENDED, INJURY, JUMP = "unintended motion", "injury-capable motion", "jump of the true tip"
KINDS = (UNINTENDED, INJURY, JUMP)
"""What a cue is to tell; the first is a hazard of `ravenjax.outcomes`."""


class FaultyCues(NamedTuple):
    """Activated faulty runs, one entry a run; times in ms from the start of the run, -1: never."""

    cues: tuple[CueRecord, ...]
    published: int  # number of the published set
    cell: np.ndarray  # int, equal for runs of one fault
    kind: np.ndarray  # int, equal for runs of one kind of fault (`kinds`)
    family: np.ndarray  # int, stratum of the kind
    group: np.ndarray  # words
    motion: np.ndarray  # int, number of the campaign that it is of
    layer: np.ndarray  # words
    active_ms: np.ndarray
    unintended_ms: np.ndarray  # when the unintended motion began
    kinds: np.ndarray  # bool [runs, KINDS]
    first_ms: np.ndarray  # [runs, cues], felt because of the fault
    shared: np.ndarray  # bool [runs, cues], the golden run has a cue, too
    force: np.ndarray  # [runs, cues], largest, device units
    felt_ms: np.ndarray  # [runs, cues], how long
    duration_ms: int
    rules: Rules  # of the words

    @property
    def unintended(self) -> np.ndarray:
        """Which runs had an unintended motion."""
        return self.kinds[:, KINDS.index(UNINTENDED)]

    @property
    def faults(self) -> Units:
        """Kinds of faults of the runs, over which intervals are."""
        return units.units(self.kind, self.family)

    def where(self, chosen: np.ndarray) -> FaultyCues:
        """Those of `chosen`, a mask or indices."""
        return self._replace(**{name: getattr(self, name)[chosen] for name in _BY_RUN})

    def once(self) -> FaultyCues:
        """One run of each fault, the motions in turn."""
        return self.where(motions_alike.one_of_each_fault(self.cell, self.motion))


_BY_RUN = (
    "cell",
    "kind",
    "family",
    "group",
    "motion",
    "layer",
    "active_ms",
    "unintended_ms",
    "kinds",
    "first_ms",
    "shared",
    "force",
    "felt_ms",
)


class FreeCues(NamedTuple):
    """Runs without a fault, one entry a run."""

    cues: tuple[CueRecord, ...]
    robot: np.ndarray  # words
    recording: np.ndarray  # words, motion and seed
    scale: np.ndarray
    hours: np.ndarray  # in pedal-down
    count: np.ndarray  # [runs, cues], separate pulses
    felt_hours: np.ndarray  # [runs, cues], how long

    def where(self, chosen: np.ndarray) -> FreeCues:
        """Those of `chosen`."""
        return self._replace(**{name: getattr(self, name)[chosen] for name in _FREE_BY_RUN})


_FREE_BY_RUN = ("robot", "recording", "scale", "hours", "count", "felt_hours")


def default_sets(cues: Sequence[CueRecord], published: int) -> list[int]:
    """Numbers of the sets with the published gains, by rising threshold."""
    own = cues[published]
    alike = [k for k, cue in enumerate(cues) if _gains(cue) == _gains(own)]
    return sorted(alike, key=lambda k: cues[k].threshold_mm)


def sets_at(cues: Sequence[CueRecord], threshold_mm: float) -> list[int]:
    """Numbers of the sets of one threshold."""
    return [k for k, cue in enumerate(cues) if cue.threshold_mm == threshold_mm]


def faulty(folders: Sequence[Path]) -> FaultyCues:
    """Activated faulty runs of campaigns that differ in their motion alone. ValueError where
    their faults differ.
    """
    read = [(folder.read_all(path), manifest.read(path)) for path in folders]
    return pooled([frame for frame, _ in read], read[0][1])


def pooled(frames: Sequence[pd.DataFrame], made: Manifest) -> FaultyCues:
    """As `faulty`, of result tables at hand; `made`: manifest of the first."""
    parts = [_faulty(one, made) for one in motions_alike.activated(frames, made)]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_RUN}
    )


def _faulty(runs: Activated, made: Manifest) -> FaultyCues:
    frame, facts = runs.frame, runs.facts
    active, every = facts["active_ms"].to_numpy(), range(len(made.cues))

    def columns(name: str) -> np.ndarray:
        return np.stack([frame[name.format(k)].to_numpy() for k in every], axis=1)

    own = np.stack([run_facts.warned(frame, k) for k in every], axis=1)
    return FaultyCues(
        cues=made.cues,
        published=made.verdict_cue,
        cell=runs.cell,
        kind=runs.kind,
        family=runs.family,
        group=frame["group"].to_numpy().astype(str).astype(object),
        motion=np.full(len(frame), runs.motion),
        layer=facts["layer"].to_numpy(object),
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
        shared=columns("golden_cue{}_first_ms") >= 0,
        force=columns("cue{}_peak_force").astype(float),
        felt_ms=columns("cue{}_ms"),
        duration_ms=made.duration_ms,
        rules=made.rules,
    )


def free(folders: Sequence[tuple[str, Path]]) -> FreeCues:
    """Runs without a fault of campaigns, each with the name of its recording."""
    parts = [alone(folder.read_all(path), manifest.read(path), name) for name, path in folders]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _FREE_BY_RUN}
    )


def alone(frame: pd.DataFrame, made: Manifest, recording: str) -> FreeCues:
    """As `free`, of one result table at hand; its faulty runs are left out."""
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
