"""Which thread of a launch computes which lane."""

from __future__ import annotations

import dataclasses

import numpy as np

from ravenjax.engines.gpu.kernel import WARP


@dataclasses.dataclass(frozen=True)
class Places:
    """Which thread computes which lane."""

    lane: np.ndarray  # [threads], the lane that each computes; whole blocks of them
    thread: np.ndarray  # [lanes], where each lane is computed
    group: np.ndarray  # int32 [warps]
    first: np.ndarray  # [groups], a lane of each
    in_order: bool  # thread by thread computes lane by lane


def place(group: np.ndarray, threads: int) -> Places:
    """Whole warps for the lanes of each group, whole blocks of `threads` for all; the last lane
    of each fills them.
    """
    if not group.any():
        lanes = np.arange(len(group))
        total = -(-len(group) // threads) * threads
        lane = np.minimum(np.arange(total), len(group) - 1)
        return Places(lane, lanes, np.zeros(total // WARP, np.int32), lanes[:1], True)
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group)
    warps = -(-sizes // WARP)
    starts = np.concatenate([[0], np.cumsum(warps)[:-1]]) * WARP
    before = np.cumsum(sizes) - sizes
    sorted_group = group[order]
    position = starts[sorted_group] + np.arange(len(group)) - before[sorted_group]
    total = -(-int(warps.sum()) * WARP // threads) * threads
    filled = np.zeros(total, np.int64)
    filled[position] = np.arange(len(group))
    lane = order[np.maximum.accumulate(filled)]
    thread = np.empty(len(group), np.int64)
    thread[order] = position
    return Places(lane, thread, group[lane[::WARP]].astype(np.int32), order[before], False)
