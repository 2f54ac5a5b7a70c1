"""Defines input data for compiled code that simulates robots (lanes), and snapshots of a run."""

import dataclasses
from collections.abc import Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Lanes:
    """The inputs of lanes that run together; on a CPU, of the whole vectors of one group. Inputs of
    ticks have the shape [ticks, numbers, lanes]. If lanes of a group have equal inputs, the shape
    is [ticks, numbers] on a CPU, and [groups, ticks, numbers] on a GPU. On a CPU, arrays begin with
    tick `first`, and an array of one tick is used in all ticks.
    """

    inputs: Sequence[np.ndarray]  # each [lanes]
    tick_inputs: np.ndarray  # inputs of each tick
    tables: np.ndarray  # all tables, concatenated
    # Outputs of each tick, [ticks, numbers, lanes], written by the code; None: not needed.
    out: np.ndarray | None
    first: int = 0  # first tick of `tick_inputs` and `out`; 0 on a GPU


EVERY = 25
"""Ticks from one snapshot to the next, if memory allows."""
STATE_BYTES = 2**12
"""Upper bound of the state of a lane and its group, bytes; 1.3 kB with one arm, two faults."""
SNAPSHOT_BYTES = 2**26
"""Largest memory for the snapshots of one golden run, bytes."""


@dataclasses.dataclass(frozen=True, eq=False)
class Trunk:
    """Snapshots of a golden run, the checkpoints from which faulty runs can start."""

    every: int  # ticks from one snapshot to the next; the first snapshot is that of tick 0
    group: np.ndarray  # uint32 [snapshots, words], state that its group shares
    lane: np.ndarray  # uint32 [snapshots, words], state of one lane

    @staticmethod
    def allocate(every: int, snapshots: int, group: int, lane: int) -> "Trunk":
        """Allocate snapshots. group, lane: 32-bit words of the state of a group and of a lane."""
        return Trunk(every, *(np.empty((snapshots, words), np.uint32) for words in (group, lane)))

    def start_ticks(self, first: np.ndarray) -> np.ndarray:
        """Return the tick of the last snapshot before each tick of `first`, int."""
        return np.clip((first - 1) // self.every, 0, len(self.lane) - 1) * self.every


def snapshot_bytes(ticks: int) -> int:
    """Return the largest memory of the snapshots of a golden run of `ticks` ticks, bytes."""
    return min(SNAPSHOT_BYTES, (ticks // EVERY + 1) * STATE_BYTES)


def snapshot_spacing(last: int, words: int) -> int:
    """Return the ticks between snapshots of `words` 32-bit words up to tick `last`."""
    largest_count = max(1, SNAPSHOT_BYTES // max(4 * words, 1))
    return max(EVERY, -(-last // largest_count))
