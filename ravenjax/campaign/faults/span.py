"""Computes the first tick in which the faults of a run may act, and the tick after their end."""

from collections.abc import Iterator, Mapping

import numpy as np

from ravenjax.faults.clocks import Clocks, Opening
from ravenjax.vocabulary.effects import TRIGGER_CODES

Faults = Mapping[str, np.ndarray]
"""Fault arrays of `table.fault_arrays`, each [runs, slots]."""

_TIME, _PACKET, _PEDAL = (TRIGGER_CODES[name] for name in ("time", "packet", "pedal"))


def first_active_ticks(faults: Faults, ticks: int) -> np.ndarray:
    """Return the first tick in which a fault of each run may act, int32 [runs]; `ticks` if none
    acts. Up to that tick the run equals its golden run bit by bit. Windows that count packets are
    treated as if a packet arrived in each tick. Windows that count time in pedal-down are treated
    as if the pedal was always down.
    """
    first = np.full(faults["code"].shape, ticks, np.int64)
    for trigger, indices, _, opening in _group_by_trigger(faults):
        if trigger == _TIME:
            first[indices] = opening.first(0, ticks - 1)
        else:
            # The first packet has number 1, and the first tick number 0.
            first[indices] = opening.start - (trigger == _PACKET)
    return np.clip(first, 0, ticks).min(axis=1, initial=ticks).astype(np.int32)


def observation_ends(
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
    window_ends = last_window_ends(faults, ticks, clocks)
    # 0 marks a fault without a window, and a run in which no fault has one.
    ends = np.where(window_ends > 0, np.minimum(window_ends + observe, ticks), 0)
    last_ends = ends.max(axis=1, initial=0)
    return np.where(last_ends == 0, ticks, last_ends).astype(np.int32)


def last_window_ends(faults: Faults, ticks: int, clocks: Clocks | None) -> np.ndarray:
    """Return the first tick after each fault's last window, int64 [runs, slots]; 0: no window."""
    ends = np.zeros(faults["code"].shape, np.int64)
    for trigger, indices, runs, opening in _group_by_trigger(faults):
        if trigger == _TIME:
            ends[indices] = opening.last(0, ticks - 1) + 1
        elif clocks is None:
            ends[indices] = ticks
        elif trigger == _PACKET:
            ends[indices] = clocks.packet_end(runs, opening, ticks)
        else:
            # If a fault of the run may change the pedal, the time in pedal-down is unknown.
            moves_pedal = np.any(clocks.moved[faults["code"]], axis=1)[runs]
            ends[indices] = np.where(moves_pedal, ticks, clocks.pedal_end(runs, opening, ticks))
    return ends


def _group_by_trigger(
    faults: Faults,
) -> Iterator[tuple[int, tuple[np.ndarray, ...], np.ndarray, Opening]]:
    """Yield (trigger code, indices [runs, slots], runs, windows) of the faults of each trigger."""
    for trigger in (_TIME, _PACKET, _PEDAL):
        indices = np.nonzero((faults["code"] > 0) & (faults["trigger"] == trigger))
        if len(indices[0]):
            names = ("start", "duration", "every")
            columns = (faults[name][indices].astype(np.int64) for name in names)
            yield trigger, indices, indices[0], Opening(*columns)
