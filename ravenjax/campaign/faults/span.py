"""When the faults of a run can act at the earliest, and when they have ended: what decides which of its ticks run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ravenjax.campaign.faults.table import FOREVER_TICKS
from ravenjax.vocabulary.effects import TRIGGER_CODES

Faults = Mapping[str, np.ndarray]
"""As `table.arrays`, each [runs, slots]."""


def acts(faults: Faults, ticks: int) -> np.ndarray:
    """The first tick in which a fault of each run may act, int32 [runs]; up to there it is its golden run to the bit.

    Where no fault acts in a run of `ticks`: that. A window that counts packets or time in pedal-down opens no earlier
    than if each tick brought a packet, or the pedal had been down from the beginning.
    """
    first = np.where(faults["trigger"] == TRIGGER_CODES["packet"], faults["start"] - 1, faults["start"])
    return np.where(faults["code"] > 0, np.clip(first, 0, ticks), ticks).min(axis=1, initial=ticks).astype(np.int32)


def ends(faults: Faults, ticks: int, observe: int | None) -> np.ndarray:
    """The first tick that each run is not observed, int32 [runs]: `observe` ticks after its last fault ended.

    A run goes on to its end, `ticks`, where nothing says when its last fault has ended before it runs: a fault lasts,
    comes again, or counts packets or time in pedal-down. So does one without a fault, and any where `observe` is None.
    """
    if observe is None:
        return np.full(len(faults["code"]), ticks, np.int32)
    bounded = (faults["trigger"] == TRIGGER_CODES["time"]) & (faults["every"] == 0)
    bounded &= faults["duration"] < FOREVER_TICKS
    after = np.where(bounded, faults["start"].astype(np.int64) + faults["duration"] + observe, ticks)
    last = np.where(faults["code"] > 0, np.minimum(after, ticks), 0).max(axis=1, initial=0)
    return np.where(last == 0, ticks, last).astype(np.int32)
