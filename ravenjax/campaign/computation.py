"""Computes the runs of a campaign on an engine, in parallel blocks, together with their golden
runs.

Up to the first tick in which a fault may act, a run equals its golden run. If enough runs share a
golden run, they start from checkpoints of it. Rows are returned in order, one window of rows at a
time. While the last blocks of a window are computed, other threads already begin the next window.
So no thread waits for the slowest block.
"""

from __future__ import annotations

import copy
import dataclasses
import re
import time
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import cast

import numpy as np

from ravenjax import interruption
from ravenjax.campaign import outcomes
from ravenjax.campaign.golden_runs import Branches, Computed, FastForwardPlan, GoldenRuns
from ravenjax.campaign.memory_windows import (
    Columns,
    Pair,
    Window,
    WindowLimits,
    concatenate,
    cut_into_windows,
    join_blocks,
    take_rows,
)
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines.interface import Block, BranchingKernel, Engine
from ravenjax.engines.lanes import snapshot_bytes
from ravenjax.store import schema

GOLDEN_BYTES = 2**29
"""Memory for the time series and checkpoints of the golden runs of a window, bytes.

Two windows may be in progress at a time. If each run has a different golden run, copies need the
same amount again.
"""
GPU_TIMES = 2
"""Factor on GOLDEN_BYTES for a GPU, which computes many lanes in parallel and copies their series.
"""
AHEAD, ENOUGH_ROWS = 4, 2**18
"""A window has AHEAD blocks for each thread, or fewer if it would have more than ENOUGH_ROWS rows.

With several blocks, a thread can start the next block while results of the last one are stored.
"""
STANDS_STILL = 0.1
"""Share of its duration for which a golden run may stand still without a note."""
_FROM_GOLDEN = re.compile(r"\b(unintended|loss|false_report|from_golden)\b")
SORTED_ROWS, SORTED_TICKS = 2**14, 2**28
"""Number of rows in a window, and of ticks of these rows, with which enough rows have faults that
begin at about the same time. Such rows can start from one checkpoint.
"""


class Computation:
    """A plan and the compiled kernel that computes its rows."""

    def __init__(
        self,
        plan: Plan,
        engine: Engine,
        progress: Progress,
        runs: int | None = None,
        threads: int | None = None,
        whole: bool = False,
    ):
        """runs: number of rows that are computed together, for the size of blocks. threads: number
        of parallel blocks; None: the engine's default. whole: compute every run from its beginning.
        """
        self.plan, self.progress, self.whole = plan, progress, whole
        self.threads = max(1, threads or engine.threads)
        self.kernel = engine.compile(plan.program, runs or plan.runs)
        self._on_gpu = engine.name == "cuda"

    def compile(self) -> None:
        """Compile the kernel, so that the time of compilation is not counted as computation."""
        self.progress.tell("compile")
        start = time.perf_counter()
        rows = np.arange(min(self.plan.runs, self.kernel.lanes))
        self.kernel.prepare(self._block(rows, None), self.plan.columns)
        interruption.check_interruption()
        self.progress.began(time.perf_counter() - start)

    def of(self, plan: Plan) -> Computation:
        """Return a computation with the same kernel for other rows of the same program."""
        other = copy.copy(self)
        other.plan = plan
        return other

    def blocks(self, ranges: Sequence[range]) -> Generator[Pair]:
        """Yield the outcomes of the rows of `ranges`, and those of their golden runs, in order.

        Each item is a window of rows. Close the generator to cancel the work in progress. Use the
        generator inside `interruption.delay_signals`.
        """
        self._fast_forward = FastForwardPlan(self.plan, 0 if self.whole else self.kernel.branches)
        self._fault_free_outcomes: list[Columns] = []
        self._ended = False
        under_way: deque[tuple[Window, list[Future[Pair]]]] = deque()
        golden_runs: GoldenRuns | None = None

        def finish_window() -> Pair:
            window, blocks = under_way.popleft()
            return join_blocks(window, [interruption.wait_for_result(block) for block in blocks])

        with ThreadPoolExecutor(self.threads) as pool:
            try:
                limits = self._limits(max(map(len, ranges), default=1))
                for window in cut_into_windows(ranges, self.plan.golden, self.plan.acts, limits):
                    golden_runs = self._golden_runs(pool, window, golden_runs)
                    blocks = [
                        pool.submit(self._faulty, window.rows[places], golden_runs)
                        for places in window.blocks
                    ]
                    under_way.append((window, blocks))
                    if len(under_way) == 2:
                        yield finish_window()
                while under_way:
                    yield finish_window()
                self._note_fault_free()
            except BaseException:
                self._ended = True
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def tables(self, ranges: Sequence[range]) -> Pair:
        """Return the columns of all rows of `ranges` together; see `blocks`."""
        with interruption.delay_signals():
            rows, golden_runs = zip(*self.blocks(ranges), strict=True)
        return concatenate(rows), concatenate(golden_runs)

    def _note_fault_free(self):
        # Adds notes about golden runs that stand still or have alarms, which may mislead.
        if not self._fault_free_outcomes:
            return
        runs = concatenate(self._fault_free_outcomes)
        halted = runs.get("halted_ms", np.zeros(0))
        length = self.plan.config.campaign.duration_ms
        still = halted > STANDS_STILL * length
        if still.any():
            tripped = [
                name.removeprefix("check_").removesuffix("_count")
                for name, count in runs.items()
                if name.startswith("check_") and name.endswith("_count") and count[still].any()
            ]
            self.progress.note(
                f"in {still.sum()} of {len(still)} golden runs the robot stands still for up to"
                f" {int(halted.max()):,} of {length:,} ms in which it should move. The robot stops"
                " without a fault, and faults after that have no effect. See"
                " column golden_halted_ms. Checks that tripped in these runs:"
                f" {', '.join(tripped) or 'none'}. `ravenjax trace` of a run shows when, and the"
                " positions and set points of each joint. Write a shorter campaign.duration_s,"
                " another motion, or a check that permits more"
            )
        config = self.plan.config
        watching = {
            f"cue{number}": f"the cue of haptics.threshold_mm = {cue.threshold_m * 1e3:g}"
            for number, cue in enumerate(config.haptics.cues())
        } | {
            f"detector{number}_threshold0": f"detector {name!r}, threshold = {limit:g},"
            for number, (name, _, (limit, *_)) in enumerate(config.detectors)
        }
        for column, name in watching.items():
            first = runs[f"{column}_first_ms"]
            if (first >= 0).all():
                self.progress.note(
                    f"{name} is on in every golden run, from {first.max()} ms at the latest, so it"
                    " cannot show a later fault: write a larger threshold"
                )
        for harm in config.harm:
            happens = runs[f"harm_{harm.name}_first_ms"] >= 0
            # Golden runs are computed without their own tip as the reference of these signals.
            if happens.any() and not _FROM_GOLDEN.search(harm.when):
                self.progress.note(
                    f"harm {harm.name!r} happens in {happens.sum()} of {len(happens)} golden runs,"
                    " so a fault does not cause it there: write another limit"
                )

    def _count(self, ticks: int):
        """Count computed ticks. Raise CancelledError if the work was cancelled."""
        if self._ended:
            raise CancelledError
        self.progress.ticks(ticks)

    def _limits(self, chunk: int) -> WindowLimits:
        """Return the largest sizes of windows and blocks, for files of `chunk` rows.

        A file can be written when all windows with its rows are finished.
        """
        program, lanes = self.plan.program, self.kernel.lanes
        setup = program.setup
        numbers = program.ticks * program.loop.series_length(setup)
        a_series = numbers * np.dtype(setup.precision.real).itemsize
        snapshots = snapshot_bytes(program.ticks) if self._fast_forward.branches.any() else 0
        a_golden = a_series + snapshots
        blocks = max(self.threads, min(AHEAD * self.threads, ENOUGH_ROWS // lanes))
        if self.kernel.branches:
            ticks = max(1.0, float((self.plan.ends - self.plan.acts).mean()))
            blocks = max(blocks, int(min(SORTED_ROWS, SORTED_TICKS / ticks)) // lanes)
        blocks = min(blocks, max(self.threads, -(-chunk // lanes)))
        room, copies = (
            (GPU_TIMES * GOLDEN_BYTES, 1) if self._on_gpu else (GOLDEN_BYTES, self.threads)
        )
        alone = self._whole_vectors(room // a_series // copies)
        return WindowLimits(lanes, blocks, self._whole_vectors(room // a_golden), alone)

    def _whole_vectors(self, lanes: int) -> int:
        vector = self.kernel.size(1)
        return max(1, lanes // vector * vector or lanes)

    # --- golden runs ---

    def _golden_runs(
        self, pool: ThreadPoolExecutor, window: Window, earlier: GoldenRuns | None
    ) -> GoldenRuns:
        """Return the golden runs of a window. Start computing those that are not in `earlier`.

        Each golden run has the parameters of the first row that belongs to it.
        """
        numbers, first = np.unique(self.plan.golden[window.rows], return_index=True)
        rows = window.rows[first]
        there = np.isin(numbers, () if earlier is None else earlier.numbers)
        if earlier is not None and there.all():
            golden_runs = earlier
        else:
            lacking = rows[~there]
            lanes = min(self.kernel.lanes, self.kernel.size(-(-len(lacking) // self.threads)))
            parts = [
                pool.submit(self._fault_free, lacking[i : i + lanes])
                for i in range(0, len(lacking), lanes)
            ]
            kept = earlier if there.any() else None
            golden_runs = GoldenRuns(
                numbers,
                pool.submit(Computed.join, parts, kept and kept.computed, numbers),
                {n: b for n, b in kept.branches.items() if n in numbers} if kept else {},
            )
        for number, row in zip(numbers.tolist(), rows, strict=True):
            if self._fast_forward.branches[number] and number not in golden_runs.branches:
                golden_runs.branches[number] = pool.submit(self._branches, row, golden_runs)
        return golden_runs

    def _fault_free(self, rows: np.ndarray) -> Computed:
        # Computes the golden runs of these rows: their signals, and their outcomes.
        self.progress.more_due(self.kernel.size(len(rows)) * self.plan.program.ticks)
        block = self._block(rows, None, harmless=True)
        if block.ends is not None:
            block = dataclasses.replace(
                block, ends=self._fast_forward.last_end[self.plan.golden[self._filled(rows)]]
            )
        result = self.kernel.run(block, self.plan.columns, self._count)
        columns = take_rows(outcomes.of_golden(result.outcomes), slice(len(rows)))
        self._fault_free_outcomes.append(columns)
        return Computed(self.plan.golden[rows], result.reference[:, :, : len(rows)], columns)

    def _branches(self, row: int, golden_runs: GoldenRuns) -> Branches:
        # Computes a golden run again with checkpoints, from which runs with late faults can start.
        number = self.plan.golden[row]
        last, ends = int(self._fast_forward.last_act[number]), self._fast_forward.early_ends(number)
        kernel = cast(BranchingKernel, self.kernel)
        block = self._block(np.array([row]), golden_runs.computed.result(), harmless=True)
        trunk, columns = kernel.trunk(block, self.plan.columns, last, ends)
        return Branches(trunk, ends, outcomes.of_golden(columns))

    def _golden_outcomes(self, rows: np.ndarray, golden_runs: GoldenRuns) -> Columns:
        """Return the outcomes of the golden run of each row, at the end of the row.

        Rows may end at different times. Each end of a golden run is computed once.
        """
        computed = golden_runs.computed.result()
        golden, ends = self.plan.golden[rows], self.plan.ends[rows]
        early = self._fast_forward.early[rows]
        if len(computed.numbers) == 1 and not early.any():
            return {
                name: np.broadcast_to(values, len(rows))
                for name, values in computed.outcomes.items()
            }
        at_end = np.searchsorted(computed.numbers, golden)
        columns = take_rows(computed.outcomes, at_end)
        for number in np.unique(golden[early]).tolist():
            mine = early & (golden == number)
            if number in golden_runs.branches:
                branches = golden_runs.branches[number].result()
                early &= ~mine
                moment = np.searchsorted(branches.ends, ends[mine])
                for name, values in branches.outcomes.items():
                    columns[name][mine] = values[moment]
        if early.any():
            moments = golden[early] * (1 + self.plan.program.ticks) + ends[early]
            _, first, of_moment = np.unique(moments, return_index=True, return_inverse=True)
            block = self._block(rows[early][first], computed, harmless=True)
            result = self.kernel.run(block, self.plan.columns)
            for name, values in columns.items():
                values[early] = result.outcomes[name][of_moment]
        return columns

    # --- blocks ---

    def _faulty(self, rows: np.ndarray, golden_runs: GoldenRuns) -> Pair:
        # Computes runs with faults. Runs start from checkpoints of their golden run, if available.
        self.progress.more_due((self.kernel.size(len(rows)) - len(rows)) * self.plan.program.ticks)
        computed = golden_runs.computed.result()
        coming = [golden_runs.branches.get(number) for number in computed.numbers.tolist()]
        here = np.isin(computed.numbers, self.plan.golden[rows]).tolist()
        trunks = [
            future.result().trunk if future and near else None
            for future, near in zip(coming, here, strict=True)
        ]
        block = dataclasses.replace(self._block(rows, computed), trunks=trunks)
        result = self.kernel.run(block, self.plan.columns, self._count)
        columns = take_rows(result.outcomes, slice(len(rows)))
        if self.plan.program.ends:
            columns[schema.OBSERVED] = self.plan.ends[rows] * self.plan.tick_ms
        return columns, self._golden_outcomes(rows, golden_runs)

    def _block(self, rows: np.ndarray, computed: Computed | None, harmless: bool = False) -> Block:
        # Returns the inputs of a kernel for these rows. The last row is repeated to fill all lanes.
        plan, filled, golden = self.plan, self._filled(rows), None
        if computed is not None:
            golden = np.searchsorted(computed.numbers, plan.golden[filled])
        return Block(
            *plan.lanes(rows, len(filled), harmless),
            reference=None if computed is None else computed.reference,
            golden=golden,
            acts=plan.acts[filled],
            ends=plan.ends[filled] if plan.program.ends else None,
            rows=len(rows),
        )

    def _filled(self, rows: np.ndarray) -> np.ndarray:
        return rows[np.minimum(np.arange(self.kernel.size(len(rows))), len(rows) - 1)]
