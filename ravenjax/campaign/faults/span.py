"""Computes the first tick in which the faults of a run may act, and the tick after their end."""

from collections.abc import Iterator, Mapping

import numpy as np

from ravenjax.faults.clocks import Clocks, Opening
from ravenjax.vocabulary.effects import TRIGGER_CODES

Faults = Mapping[str, np.ndarray]
"""Fault arrays of `table.fault_arrays`, each [runs, slots]."""

_TIME, _PACKET, _PEDAL = (TRIGGER_CODES[name] for name in ("time", "packet", "pedal"))


def first_active_ticks(faults: Faults, ticks: int) -> np.ndarray:
    """Return the first tick in which a fault of each run may act, int32 [runs].

    Up to that tick the run equals its golden run bit by bit. The result is `ticks` for a run in
    which no fault acts. Windows that count packets are treated as if a packet arrived in each tick.
    Windows that count time in pedal-down are treated as if the pedal was always down.
    """
    first = np.full(faults["code"].shape, ticks, np.int64)
    for trigger, where, _, opening in _openings(faults):
        if trigger == _TIME:
            first[where] = opening.first(0, ticks - 1)
        else:
            first[where] = opening.start - (trigger == _PACKET)
    return np.clip(first, 0, ticks).min(axis=1, initial=ticks).astype(np.int32)


def last_observed_ticks(
    faults: Faults, ticks: int, observe: int | None, clocks: Clocks | None = None
) -> np.ndarray:
    """Return the first tick in which each run is no longer observed, int32 [runs].

    This is `observe` ticks after the end of its last fault. It is `ticks` in these cases:

    - The run has no fault, or `observe` is None.
    - A fault never ends.
    - A fault counts time in pedal-down, and a fault may change the pedal.
    - A fault counts packets or time in pedal-down, and `clocks` is None.
    """
    if observe is None:
        return np.full(len(faults["code"]), ticks, np.int32)
    last = last_window_ends(faults, ticks, clocks)
    ended = np.where(last > 0, np.minimum(last + observe, ticks), 0).max(axis=1, initial=0)
    return np.where(ended == 0, ticks, ended).astype(np.int32)


def last_window_ends(faults: Faults, ticks: int, clocks: Clocks | None) -> np.ndarray:
    """Return the first tick after each fault's last window, int64 [runs, slots]; 0: no window."""
    last = np.zeros(faults["code"].shape, np.int64)
    for trigger, where, rows, opening in _openings(faults):
        if trigger == _TIME:
            last[where] = opening.last(0, ticks - 1) + 1
        elif clocks is None:
            last[where] = ticks
        elif trigger == _PACKET:
            last[where] = clocks.packet_end(rows, opening, ticks)
        else:
            moved = np.any(clocks.moved[faults["code"]], axis=1)[rows]
            last[where] = np.where(moved, ticks, clocks.pedal_end(rows, opening, ticks))
    return last


def _openings(faults: Faults) -> Iterator[tuple[int, tuple[np.ndarray, ...], np.ndarray, Opening]]:
    """Yield (trigger code, indices of its faults, runs of these, windows) of each used trigger."""
    for trigger in (_TIME, _PACKET, _PEDAL):
        where = np.nonzero((faults["code"] > 0) & (faults["trigger"] == trigger))
        if len(where[0]):
            names = ("start", "duration", "every")
            columns = (faults[name][where].astype(np.int64) for name in names)
            yield trigger, where, where[0], Opening(*columns)
