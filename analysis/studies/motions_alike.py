"""Pools campaigns that differ only in their motion: faulty runs side by side, and fault-free
recordings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data import facts as run_facts
from ravenjax.store.manifest import Manifest
from studies import kinds
from studies.study import Variant

BASELINE = "suture"
MOTIONS = (BASELINE, "reach", "peg_transfer", "palpate")
"""Variants with faults whose runs are pooled."""
RECORDINGS = (
    *((motion, seed) for motion in ("suture", "reach", "peg_transfer") for seed in (11, 12)),
    *((motion, 11) for motion in ("palpate", "circle", "clutched")),
)
"""Motion and seed of each fault-free recording. None is one of the faulty motions."""


class Activated(NamedTuple):
    """The activated faulty runs of one motion that had a valid outcome."""

    frame: pd.DataFrame  # rows of the result table
    facts: pd.DataFrame  # from run_facts.of, for the same rows
    cell: np.ndarray  # [rows] number of the fault, equal in every motion
    kind: np.ndarray  # [rows] number of its kind (`kinds`), equal in every motion
    family: np.ndarray  # [rows] number of the kind's stratum
    motion: int


def activated(frames: Sequence[pd.DataFrame], made: Manifest) -> Iterator[Activated]:
    """Return the activated runs of each motion. `made`: manifest of the first. Raises ValueError if
    the faults of two motions differ.
    """
    distinct = run_facts.derive_from_manifest(frames[0], made)["distinct"].to_numpy()
    faults = kinds.of(frames[0]["group"])
    family = faults.stratum[faults.unit]
    for motion, frame in enumerate(frames):
        if not np.array_equal(frame["group"].astype(str), frames[0]["group"].astype(str)):
            raise ValueError(
                f"campaign {motion} of a comparison of motions has other groups than the first"
            )
        facts = run_facts.derive_from_manifest(frame, made)
        mask = (facts["faulty"] & facts["activated"] & ~facts["failed"]).to_numpy()
        yield Activated(
            frame.loc[mask],
            facts.loc[mask],
            distinct[mask],
            faults.unit[mask],
            family[mask],
            motion,
        )


def one_of_each_fault(cell: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return indices [faults] of one run of each fault, taking the motions in turn. `cell` and
    `motion` are those of the runs.
    """
    motions = np.unique(motion)
    exact = motion == motions[cell % len(motions)]
    # If that run was not activated, take another run of the fault.
    order = np.lexsort((~exact, cell))
    return np.sort(order[np.unique(cell[order], return_index=True)[1]])


def faulty(campaign: str) -> tuple[Variant, ...]:
    """Return the campaign with its faults under each of MOTIONS."""
    others = (
        Variant(
            motion, campaign, (f"operator.motion={motion}",), f"Does the motion matter? {motion}"
        )
        for motion in MOTIONS[1:]
    )
    return Variant(BASELINE, campaign), *others


def fault_free(
    campaign: str, motion: str, seed: int, runs: int, seconds: float, question: str
) -> Variant:
    """Return a fault-free recording of one motion: the first `runs` of a campaign, each of length
    `seconds`.
    """
    overrides = (
        f"campaign.limit={runs}",
        f"campaign.duration_s={seconds}",
        f"operator.motion={motion}",
        f"operator.seed={seed}",
    )
    return Variant(
        f"free_{motion}_{seed}", campaign, overrides, f"{question} {motion}, seed {seed}"
    )
