"""What the study of detectors reads from its campaigns: faulty runs side by side, and motion
without a fault.

The faulty runs of all motions are pooled; faults of one kind resemble each other, so that kinds are
resampled. An alarm of a faulty run counts from the fault's first effect on: what spoke before tells
of something else. Of the built-in checks those count that tell a person or stop the robot; one that
limits a command or drops a packet tells nobody.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ravenjax.outcomes.events import Rules
from ravenjax.robots.raven2 import ROBOT
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.store import folder, manifest
from ravenjax.store.manifest import DetectorRecord, Manifest
from ravenjax.vocabulary import checks
from studies.framework import motions_alike
from studies.framework.motions_alike import Activated
from studies.framework.study import StudyEstimate

FREE = "free/"
"""Begin of the names of groups without faults."""
SCALE = "param:operator.scale"
CHECKS, STOPS, CUE = "built-in checks, flag or stop", "built-in checks, stop", "haptic cue, 3 mm"
OTHERS = (CHECKS, STOPS, CUE)
"""What speaks beside the detectors; each has one threshold."""


class FaultyScores(NamedTuple):
    """Activated faulty runs, one entry a run; times in ms from the start of the run, -1: never."""

    detectors: tuple[DetectorRecord, ...]
    cell: np.ndarray  # int, equal for runs of one fault
    kind: np.ndarray  # int, equal for runs of one kind of fault (`kinds`)
    family: np.ndarray  # int, stratum of the kind
    motion: np.ndarray  # int, number of the campaign that it is of
    layer: np.ndarray  # words
    active_ms: np.ndarray
    unintended_ms: np.ndarray  # when the unintended motion began
    hazard: np.ndarray  # words of `ravenjax.outcomes`
    jumped: np.ndarray  # bool, the reported tip jumped
    leapt: np.ndarray  # bool, the true tip jumped
    score: np.ndarray  # [runs, detectors]
    first_ms: tuple[np.ndarray, ...]  # of each detector [runs, thresholds]
    others_ms: Mapping[str, np.ndarray]  # of OTHERS
    duration_ms: int
    rules: Rules  # of the words

    @property
    def unintended(self) -> np.ndarray:
        """Which runs had an unintended motion."""
        return self.unintended_ms >= 0

    @property
    def faults(self) -> Units:
        """Kinds of faults of the runs, over which intervals are."""
        return units.units(self.kind, self.family)

    def spoke_ms(self, name: str, threshold: float) -> np.ndarray:
        """When a detector, or one of OTHERS (any threshold), first spoke of the fault, -1:
        never. Key-, ValueError.
        """
        if name in self.others_ms:
            return self.others_ms[name]
        d = names(self.detectors).index(name)
        return self.first_ms[d][:, self.detectors[d].thresholds.index(threshold)]

    def once(self) -> FaultyScores:
        """One run of each fault, the motions in turn."""
        return self.where(motions_alike.one_of_each_fault(self.cell, self.motion))

    def where(self, chosen: np.ndarray) -> FaultyScores:
        """Those of `chosen`, a mask or indices."""
        return self._replace(
            **{name: getattr(self, name)[chosen] for name in _BY_RUN},
            first_ms=tuple(times[chosen] for times in self.first_ms),
            others_ms={name: times[chosen] for name, times in self.others_ms.items()},
        )


_BY_RUN = (
    "cell",
    "kind",
    "family",
    "motion",
    "layer",
    "active_ms",
    "unintended_ms",
    "hazard",
    "jumped",
    "leapt",
    "score",
)


class FreeScores(NamedTuple):
    """Runs without a fault, one entry a run."""

    detectors: tuple[DetectorRecord, ...]
    robot: np.ndarray  # words: as modelled, uncertain robot ..
    recording: np.ndarray  # words, which motion; runs of one resemble each other
    scale: np.ndarray
    hours: np.ndarray  # in pedal-down
    score: np.ndarray  # [runs, detectors]
    alarms: tuple[np.ndarray, ...]  # of each detector [runs, thresholds]: separate alarms
    others: Mapping[str, np.ndarray]  # of OTHERS: 1 where a check tripped, pulses of the cue

    def count(self, name: str, threshold: float) -> np.ndarray:
        """Separate false alarms of each run. KeyError, ValueError as `FaultyScores.spoke_ms`."""
        if name in self.others:
            return self.others[name]
        d = names(self.detectors).index(name)
        return self.alarms[d][:, self.detectors[d].thresholds.index(threshold)]

    def where(self, chosen: np.ndarray) -> FreeScores:
        """Those of `chosen`."""
        return self._replace(
            **{name: getattr(self, name)[chosen] for name in _FREE_BY_RUN},
            alarms=tuple(counts[chosen] for counts in self.alarms),
            others={name: counts[chosen] for name, counts in self.others.items()},
        )

    def per_hour(self, counts: np.ndarray) -> StudyEstimate:
        """`per_hour` of these runs."""
        return per_hour(counts, self.hours, self.recording)


def per_hour(
    counts: np.ndarray, hours: np.ndarray, recording: np.ndarray, of: str = "alarms"
) -> StudyEstimate:
    """Rate of `counts` [runs] over `hours` [runs], its interval by resampling recordings, none with
    too few of them; where none came the exact Poisson one, as if the hours were independent."""
    total, all_hours = int(counts.sum()), float(hours.sum())
    exact = alarm_rate(total, all_hours)
    low, high = exact.low, exact.high
    if total:
        band = units.ratio(counts, hours, units.units(recording))
        low, high = float(band.low), float(band.high)
    return StudyEstimate(exact.per_hour, low, high, total, f"{of} in {all_hours:.1f} h")


_FREE_BY_RUN = ("robot", "recording", "scale", "hours", "score")


def names(detectors: Sequence[DetectorRecord]) -> list[str]:
    """Name of each."""
    return [detector.name for detector in detectors]


def faulty(folders: Sequence[Path]) -> FaultyScores:
    """Activated faulty runs of campaigns that differ in their motion alone. ValueError where
    their faults differ.
    """
    read = [(folder.read_all(path), manifest.read(path)) for path in folders]
    return pooled([frame for frame, _ in read], read[0][1])


def pooled(frames: Sequence[pd.DataFrame], made: Manifest) -> FaultyScores:
    """As `faulty`, of result tables at hand; `made`: manifest of the first."""
    return _joined([_faulty(one, made) for one in motions_alike.activated(frames, made)])


def _faulty(runs: Activated, made: Manifest) -> FaultyScores:
    frame, facts = runs.frame, runs.facts
    active = facts["active_ms"].to_numpy()

    def told(times: ArrayLike) -> np.ndarray:
        values = np.asarray(times)
        return np.where(values >= active, values, -1)

    stop = np.where(frame["response"].astype(str) == "stopped", frame["response_ms"], -1)
    return FaultyScores(
        detectors=made.detectors,
        cell=runs.cell,
        kind=runs.kind,
        family=runs.family,
        motion=np.full(len(frame), runs.motion),
        layer=facts["layer"].to_numpy(object),
        active_ms=active,
        unintended_ms=facts["unintended_ms"].to_numpy(),
        hazard=facts["hazard"].to_numpy(object),
        jumped=frame[made.verdict_jump].to_numpy(bool),
        leapt=frame["jump_tip"].to_numpy(bool),
        score=np.stack(
            [frame[f"detector{d}_score"].to_numpy(float) for d in range(len(made.detectors))],
            axis=1,
        ),
        first_ms=tuple(
            np.stack(
                [
                    told(frame[f"detector{d}_threshold{k}_first_ms"])
                    for k in range(len(one.thresholds))
                ],
                axis=1,
            )
            for d, one in enumerate(made.detectors)
        ),
        others_ms={
            CHECKS: told(facts["told_ms"]),
            STOPS: told(stop),
            CUE: told(facts["warned_ms"]),
        },
        duration_ms=made.duration_ms,
        rules=made.rules,
    )


def _joined(parts: Sequence[FaultyScores]) -> FaultyScores:
    first = parts[0]
    return first._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_RUN},
        first_ms=tuple(
            np.concatenate(times) for times in zip(*(part.first_ms for part in parts), strict=True)
        ),
        others_ms={
            name: np.concatenate([part.others_ms[name] for part in parts]) for name in OTHERS
        },
    )


def free(folders: Sequence[tuple[str, Path]]) -> FreeScores:
    """Runs without a fault of campaigns, each with the name of its recording; where there is noise,
    the robot as modelled is called another one."""
    parts = [alone(folder.read_all(path), manifest.read(path), name) for name, path in folders]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _FREE_BY_RUN},
        alarms=tuple(
            np.concatenate(counts) for counts in zip(*(part.alarms for part in parts), strict=True)
        ),
        others={name: np.concatenate([part.others[name] for part in parts]) for name in OTHERS},
    )


def alone(frame: pd.DataFrame, header: Manifest, recording: str) -> FreeScores:
    """As `free`, of one result table at hand; its faulty runs are left out."""
    noise = header.config["campaign"]["noise"]
    group = frame["group"].astype(str)
    rows = group.str.startswith(FREE) & (frame["failed"] == "")
    if not noise:
        rows &= group != FREE + MORE_NOISE  # as modelled once more
    frame = frame.loc[rows]
    robot = frame["group"].astype(str).str.removeprefix(FREE).to_numpy(object)
    if noise:
        robot = np.array([NOISY.get(word, word) for word in robot], object)
    return FreeScores(
        header.detectors,
        robot,
        np.full(len(frame), recording, object),
        frame[SCALE].to_numpy(float),
        frame["pedal_down_ms"].to_numpy(float) / 3.6e6,
        np.stack(
            [frame[f"detector{d}_score"].to_numpy(float) for d in range(len(header.detectors))],
            axis=1,
        ),
        tuple(
            np.stack(
                [
                    frame[f"detector{d}_threshold{k}_alarms"].to_numpy()
                    for k in range(len(one.thresholds))
                ],
                axis=1,
            )
            for d, one in enumerate(header.detectors)
        ),
        {
            CHECKS: _tripped(frame, "stop", "flag"),
            STOPS: _tripped(frame, "stop"),
            CUE: frame[f"cue{header.verdict_cue}_count"].to_numpy(),
        },
    )


def _tripped(frame: pd.DataFrame, *actions: checks.Action) -> np.ndarray:
    """1 for each run in which a check of these actions tripped, else 0.

    A run without a fault is its own golden run, so that its column `response` is silent whatever
    the checks did.
    """
    columns = [
        f"check_{name}_count" for name in checks.names(frame) if ROBOT.check(name).action in actions
    ]
    return (frame[columns].to_numpy() > 0).any(axis=1).astype(int)


AS_MODELLED, UNCERTAIN, NOISE, MORE_NOISE = "as modelled", "uncertain robot", "noise", "more noise"
NOISY = {AS_MODELLED: NOISE, UNCERTAIN: f"{UNCERTAIN}, {NOISE}"}
"""What a group without faults is called where the campaign has noise."""
