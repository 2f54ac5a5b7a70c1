"""The same faults with a hand that the cue's force moves and with one that no force reaches."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data import facts as run_facts
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate
from ravenjax.store import folder, manifest
from studies.framework import kinds

NEWTONS, GRIP, TURN = "param:hand.newtons_per_unit", "param:hand.grip", "param:hand.turn_deg"


class HandRuns(NamedTuple):
    """A campaign's result table and its facts, rows in the same order."""

    frame: pd.DataFrame
    facts: pd.DataFrame


class HandPairs(NamedTuple):
    """Faults that changed a bit, one row each in the same order: under a force, and under none."""

    on: HandRuns
    off: HandRuns

    @property
    def faults(self) -> Units:
        """Kinds of these faults."""
        return kinds.of(self.off.facts["group"])

    @property
    def stopped(self) -> np.ndarray:
        """Pairs in which a check stopped one of the robots, bool [pairs]: then the model alone
        follows the hand.
        """
        on, off = ((part.frame["response"] == "stopped").to_numpy(bool) for part in self)
        return on | off

    def where(self, chosen: np.ndarray) -> HandPairs:
        """Those of `chosen` (bool [pairs])."""
        return HandPairs(
            *(HandRuns(part.frame.loc[chosen], part.facts.loc[chosen]) for part in self)
        )

    def change(self, column: str) -> np.ndarray:
        """A column under the force minus under none, [pairs]."""
        on, off = (part.frame[column].to_numpy(float) for part in self)
        return on - off


class HandEffect(NamedTuple):
    """What a force on the hand changed, over the faults in which it moved one; intervals over
    kinds of faults.
    """

    pairs: int  # faults
    pulled: int  # of them, faults in which the hand moved
    kinds: Units  # of the latter
    hand: Estimate  # mm, mean of the largest displacement
    model: Estimate  # mm, mean change of the root mean square distance from the model
    golden: Estimate  # mm, mean change of the root mean square distance from the golden run
    # mean absolute change of the distance from the model, by what the tip was asked to move
    model_share: Estimate
    golden_share: Estimate  # the same of the distance from the golden run
    cue_ms: Estimate  # mean change of the cue's time
    pulses: Estimate  # mean change of the number of separate pulls
    path: Estimate  # mean change of the tip's path, as a share of the path
    unintended: tuple[int, int]  # faults with an unintended motion: under no force, under the force
    difference: Estimate  # of their shares of all pairs


def read(path: Path) -> HandRuns:
    """The runs of a result folder. Raises StoreError."""
    frame, header = folder.read_all(path), manifest.read(path)
    return HandRuns(frame, run_facts.of(frame, header))


def paired(runs: HandRuns, newtons: float, grip: float) -> HandPairs:
    """Every fault that changed a bit, with that force per unit and that grip, and under no force.
    ValueError where the campaign has no such runs."""
    at_grip = np.isclose(runs.frame[GRIP], grip)
    on, off = (at_grip & np.isclose(runs.frame[NEWTONS], value) for value in (newtons, 0.0))
    if not on.any() or on.sum() != off.sum():
        raise ValueError(
            f"the campaign has {on.sum()} runs of {newtons:g} N a unit at grip {grip:g},"
            f" {off.sum()} of 0"
        )
    order = [
        np.flatnonzero(mask)[np.argsort(runs.frame.loc[mask, "pair"].to_numpy())]
        for mask in (on, off)
    ]
    both = HandPairs(*(HandRuns(runs.frame.iloc[rows], runs.facts.iloc[rows]) for rows in order))
    valid = ~(both.on.facts["failed"].to_numpy(bool) | both.off.facts["failed"].to_numpy(bool))
    return both.where(valid & both.off.facts["activated"].to_numpy(bool))


def effect(pairs: HandPairs, scale: float) -> HandEffect:
    """What the force changed; scale: teleoperation scale."""
    moved = (pairs.on.frame["hand_mm"] > 0).to_numpy()
    pulled = pairs.where(moved)
    among = pulled.faults
    hand_mm = pulled.on.frame["hand_mm"].to_numpy(float)
    model, golden = (pulled.change(f"rms_{name}_deviation_mm") for name in ("model", "golden"))
    hits = [part.facts["unintended"].to_numpy(bool) for part in pairs]
    return HandEffect(
        len(moved),
        int(moved.sum()),
        among,
        _ratio(hand_mm, 1.0, among),
        _ratio(model, 1.0, among),
        _ratio(golden, 1.0, among),
        _ratio(np.abs(model), scale * hand_mm, among),
        _ratio(np.abs(golden), scale * hand_mm, among),
        _ratio(pulled.change("cue0_ms"), 1.0, among),
        _ratio(pulled.change("cue0_count"), 1.0, among),
        _ratio(
            pulled.change("tip_path_mm"), pulled.off.frame["tip_path_mm"].to_numpy(float), among
        ),
        (int(hits[1].sum()), int(hits[0].sum())),
        kinds.difference(hits[0], hits[1], pairs.faults),
    )


def _ratio(above: np.ndarray, below: np.ndarray | float, among: Units) -> Estimate:
    band = units.ratio(above, below, among)
    return Estimate(band.value, band.low, band.high)
