"""Assigns simulated robots (lanes) to threads of a GPU, and plans the ticks of blocks of threads.

Until its fault acts, a robot equals its golden run. A block can therefore begin from a snapshot of
the golden run. All threads of a block begin in the same tick: the first tick that any of its lanes
needs. The block stops when its last lane ends.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ravenjax.engines.gpu.kernel import WARP
from ravenjax.engines.lanes import Trunk


@dataclasses.dataclass(frozen=True)
class Places:
    """Assignment of lanes to threads."""

    lane: np.ndarray  # [threads]: the lane of each thread, in whole blocks
    thread: np.ndarray  # [lanes]: the thread of each lane
    group: np.ndarray  # int32 [warps]: group of each warp
    first: np.ndarray  # [groups]: one lane of each group


def place_lanes(group: np.ndarray, threads: int) -> Places:
    """Assign lanes to threads. Each group fills whole warps, and all groups fill whole blocks.
    group: group of each lane, int [lanes]. threads: number per block. A thread without its own lane
    repeats the lane of the thread before it.
    """
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group)
    warps = -(-sizes // WARP)
    starts = np.concatenate([[0], np.cumsum(warps)[:-1]]) * WARP
    # Number of lanes in earlier groups. Below, lanes are sorted by group.
    lanes_before = np.cumsum(sizes) - sizes
    sorted_group = group[order]
    thread_of_sorted = starts[sorted_group] + np.arange(len(group)) - lanes_before[sorted_group]
    threads_in_total = -(-int(warps.sum()) * WARP // threads) * threads
    sorted_lane = np.zeros(threads_in_total, np.int64)
    sorted_lane[thread_of_sorted] = np.arange(len(group))
    # A thread without its own lane has 0 here. The running maximum gives it the lane before.
    lane = order[np.maximum.accumulate(sorted_lane)]
    thread = np.empty(len(group), np.int64)
    thread[order] = thread_of_sorted
    return Places(lane, thread, group[lane[::WARP]].astype(np.int32), order[lanes_before])


EVERY = 100
"""Ticks from one snapshot of a golden run to the next. A snapshot needs two launches."""


@dataclasses.dataclass(frozen=True, eq=False)
class BlockCourse:
    """The ticks that each block of threads runs, and the snapshots from which it starts."""

    # int32 [blocks, 2]: the first tick of each block, and the first tick that it does not run.
    spans: np.ndarray
    ends: np.ndarray  # int32 [threads]: the first tick that the thread's lane does not run
    snapshots: np.ndarray  # uint32 [snapshots, words]: states of a lane from which warps start
    # int32 [warps]: index of each warp's snapshot in `snapshots`; -1: it starts in tick 0.
    snapshot_of_warp: np.ndarray
    # uint32 [groups, words]: state of each group at tick `first`; None: `first` is 0.
    group_state: np.ndarray | None

    @property
    def first(self) -> int:
        """The first tick that any block runs."""
        return int(self.spans[:, 0].min())

    @property
    def last(self) -> int:
        """The first tick that no block runs."""
        return int(self.spans[:, 1].max())

    @property
    def scattered(self) -> bool:
        """Whether blocks run at such different times that most blocks are idle in most ticks."""
        block_ticks = (self.spans[:, 1] - self.spans[:, 0]).sum(dtype=np.int64)
        return 2 * block_ticks < len(self.spans) * (self.last - self.first)

    def lane_ticks(self, places: Places, first: int, until: int) -> int:
        """Return the ticks from `first` to before `until` that lanes run, summed over lanes."""
        blocks = len(self.spans)
        # Lanes of each block, without threads that only repeat a lane.
        lanes = np.bincount(places.thread // (len(places.lane) // blocks), minlength=blocks)
        begins, ends = np.clip(self.spans, first, until).T
        return int(lanes @ np.maximum(ends - begins, 0))


def plan_course(
    places: Places,
    threads: int,
    ends: np.ndarray,
    acts: np.ndarray | None = None,
    trunks: Sequence[Trunk | None] = (),
) -> BlockCourse:
    """Plan the ticks of each block of threads. A block begins at the last snapshot of a golden run
    before the fault of any of its lanes acts, and stops at the last end of its lanes. acts, ends:
    int [lanes], as in `interface.Block`. trunks: snapshots of each group's golden run, every
    `EVERY` ticks; None: the group has none; (): every block begins in tick 0. threads: number per
    block.
    """
    acts = np.zeros_like(ends) if acts is None else acts
    thread_ends = ends[places.lane].astype(np.int32)
    # First tick that a lane of each warp needs. Every lane runs at least its last tick.
    needed = np.minimum(acts[places.lane], thread_ends - 1).reshape(-1, WARP).min(axis=1)
    warp_begins = np.zeros(len(needed), np.int64)
    for number, trunk in enumerate(trunks):
        is_member = places.group == number
        if trunk:
            warp_begins[is_member] = trunk.start_ticks(needed[is_member])
    begins = warp_begins.reshape(-1, threads // WARP).min(axis=1)
    block_ends = thread_ends.reshape(-1, threads).max(axis=1)
    spans = np.stack([begins, block_ends], axis=1).astype(np.int32)
    # All groups are computed from the tick on in which the first block begins.
    first = int(begins.min()) // EVERY
    group_state = np.stack([trunk.group[first] for trunk in trunks if trunk]) if first else None
    number_of_warp = np.repeat(begins // EVERY, threads // WARP)
    snapshots, snapshot_of_warp = _lane_states(places.group, number_of_warp, trunks)
    return BlockCourse(spans, thread_ends, snapshots, snapshot_of_warp, group_state)


def _lane_states(group: np.ndarray, number: np.ndarray, trunks: Sequence[Trunk | None]):
    """Return the states from which warps start, uint32 [states, words], and each warp's index into
    them, -1 for a warp that starts in tick 0. group: of each warp, int [warps]. number: of its
    snapshot, int [warps]; 0: tick 0.
    """
    has_snapshot = number > 0
    pairs = np.stack([group, number], axis=1)[has_snapshot]
    used_pairs, index = np.unique(pairs, axis=0, return_inverse=True)
    states = [trunks[k].lane[row] for k, row in used_pairs.tolist()]
    state_of_warp = np.full(len(group), -1, np.int32)
    state_of_warp[has_snapshot] = index.reshape(-1)
    return np.stack(states) if states else np.zeros((0, 0), np.uint32), state_of_warp
