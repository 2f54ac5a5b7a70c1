"""Computes the runs of a campaign on an engine, in parallel blocks, with their golden runs.

Up to the first tick in which a fault may act, a run equals its golden run. If enough runs share a
golden run, they start from checkpoints of it. Rows are returned in order, one window of rows at a
time. While the last blocks of a window are computed, other threads already begin the next window.
So no thread waits for the slowest block.
"""

import copy
import dataclasses
import math
import re
import time
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import cast

import numpy as np

from ravenjax import interruption
from ravenjax.campaign import memory_windows, outcomes
from ravenjax.campaign.golden_runs import Branches, Computed, FastForwardPlan, GoldenRuns
from ravenjax.campaign.memory_windows import Columns, OutcomePair, Window, WindowLimits, take_rows
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, BranchingKernel, Engine
from ravenjax.engines.lanes import snapshot_bytes
from ravenjax.store import schema
from ravenjax.vocabulary import checks

GOLDEN_BYTES = 2**29
"""Memory for the time series and checkpoints of the golden runs of a window, bytes. Two windows may
be in progress at a time. If each run has a different golden run, copies need as much again.
"""
GPU_TIMES = 2
"""Factor on GOLDEN_BYTES for a GPU, which computes many lanes at once and copies their series."""
BLOCKS_PER_THREAD, MAX_WINDOW_ROWS = 4, 2**18
"""Number of blocks of a window for each thread, and the number of rows above which there are fewer.

With several blocks, a thread can start the next block while results of the last one are stored.
"""
MAX_HALT_SHARE = 0.1
"""Share of its duration for which a golden run may stand still without a note."""
_USES_GOLDEN_TIP = re.compile(r"\b(unintended|loss|false_report|from_golden)\b")
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
        progress: Progress | None = None,
        runs: int | None = None,
        threads: int | None = None,
        whole: bool = False,
    ):
        """Compile the kernel. The time of compilation is not counted as computation.
        progress: None: progress is not reported. runs: number of rows that are computed together,
        for the size of blocks. threads: number of parallel blocks; None: the engine's default.
        whole: compute every run from its beginning, not from a checkpoint.
        """
        self.plan, self.whole = plan, whole
        self.progress = progress or Progress("", plan.runs, plan.runs, plan.program.ticks)
        self.threads = max(1, threads or engine.threads)
        self.kernel = engine.compile(plan.program, runs or plan.runs)
        self._on_gpu = selection.engine_properties(engine.name).needs_gpu
        self.progress.tell("compile")
        start = time.perf_counter()
        # The first rows, as golden runs, are an example of the kernel's inputs.
        rows = np.arange(min(plan.runs, self.kernel.lanes))
        self.kernel.prepare(self._block(rows, None), plan.columns)
        interruption.check_interruption()
        self.progress.began(time.perf_counter() - start)

    def of(self, plan: Plan) -> "Computation":
        """Return a computation of other rows of the same program, with the same kernel."""
        computation = copy.copy(self)
        computation.plan = plan
        return computation

    def blocks(self, ranges: Sequence[range]) -> Generator[OutcomePair]:
        """Yield the outcomes of the rows of `ranges`, and those of their golden runs, in order.
        Each item is a window of rows. Close the generator to cancel the work. Use the generator
        inside `interruption.delay_signals`. With `whole`, no run starts from a checkpoint.
        """
        self._fast_forward = FastForwardPlan(self.plan, 0 if self.whole else self.kernel.branches)
        self._fault_free_outcomes: list[Columns] = []
        self._is_cancelled = False
        pending: deque[tuple[Window, list[Future[OutcomePair]]]] = deque()
        golden_runs: GoldenRuns | None = None

        def finish_window() -> OutcomePair:
            window, blocks = pending.popleft()
            results = [interruption.wait_for_result(block) for block in blocks]
            return memory_windows.join_blocks(window, results)

        with ThreadPoolExecutor(self.threads) as pool:
            try:
                limits = self._window_limits(max(map(len, ranges), default=1))
                windows = memory_windows.cut_into_windows(
                    ranges, self.plan.golden, self.plan.acts, limits
                )
                for window in windows:
                    golden_runs = self._submit_golden_runs(pool, window, golden_runs)
                    blocks = [
                        pool.submit(self._compute_faulty_runs, window.rows[indices], golden_runs)
                        for indices in window.blocks
                    ]
                    pending.append((window, blocks))
                    # The threads already compute the second window when the first is finished.
                    if len(pending) == 2:
                        yield finish_window()
                while pending:
                    yield finish_window()
                self._note_fault_free()
            except BaseException:
                self._is_cancelled = True
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def tables(self, ranges: Sequence[range]) -> OutcomePair:
        """Return the outcomes of all rows of `ranges`, and of their golden runs; see `blocks`."""
        with interruption.delay_signals():
            rows, golden_runs = zip(*self.blocks(ranges), strict=True)
        return memory_windows.concatenate(rows), memory_windows.concatenate(golden_runs)

    def _note_fault_free(self):
        # Adds notes about golden runs that stand still or have alarms, which may mislead.
        if not self._fault_free_outcomes:
            return
        golden = memory_windows.concatenate(self._fault_free_outcomes)
        halted_ms = golden.get("halted_ms", np.zeros(0))
        duration_ms = self.plan.config.campaign.duration_ms
        stands_still = halted_ms > MAX_HALT_SHARE * duration_ms
        if stands_still.any():
            tripped = [
                name
                for name in checks.check_names(golden)
                if golden[f"check_{name}_count"][stands_still].any()
            ]
            self.progress.note(
                f"in {stands_still.sum()} of {len(stands_still)} golden runs the robot stands still"
                f" for up to {int(halted_ms.max()):,} of {duration_ms:,} ms, although it should"
                " move (column golden_halted_ms). Faults have no effect after the robot stops."
                f" Checks that tripped in these runs: {', '.join(tripped) or 'none'}. `ravenjax"
                " trace` shows how the joints of a run move. To prevent the stop, shorten"
                " campaign.duration_s, change the motion, or change the limits of the checks"
            )
        config = self.plan.config
        alarms = {
            f"cue{number}": f"the cue of haptics.threshold_mm = {cue.threshold_m * 1e3:g}"
            for number, cue in enumerate(config.haptics.cues())
        }
        for number, (name, _, thresholds) in enumerate(config.detectors):
            alarms[f"detector{number}_threshold0"] = (
                f"detector {name!r}, threshold = {thresholds[0]:g},"
            )
        for column, alarm in alarms.items():
            first_ms = golden[f"{column}_first_ms"]
            if (first_ms >= 0).all():
                self.progress.note(
                    f"{alarm} is on in every golden run, from {first_ms.max()} ms at the latest, so"
                    " it cannot show a later fault: write a larger threshold"
                )
        for harm in config.harm:
            happens = golden[f"harm_{harm.name}_first_ms"] >= 0
            # Golden runs are computed without their own tip as the reference of these signals.
            if happens.any() and not _USES_GOLDEN_TIP.search(harm.when):
                self.progress.note(
                    f"harm {harm.name!r} happens in {happens.sum()} of {len(happens)} golden runs,"
                    " so a fault does not cause it there: write another limit"
                )

    def _count(self, ticks: int):
        """Count computed ticks. Raise CancelledError if the work was cancelled."""
        if self._is_cancelled:
            raise CancelledError
        self.progress.ticks(ticks)

    def _window_limits(self, rows_per_file: int) -> WindowLimits:
        # Returns the largest sizes of a window of rows and of its blocks.
        program, lanes = self.plan.program, self.kernel.lanes
        # Memory of a golden run: its time series, and perhaps checkpoints.
        numbers = program.ticks * program.loop.series_length(program.setup)
        series_bytes = numbers * np.dtype(program.setup.precision.real).itemsize
        golden_bytes = series_bytes
        if self._fast_forward.uses_checkpoints.any():
            golden_bytes += snapshot_bytes(program.ticks)
        useful_blocks = min(BLOCKS_PER_THREAD * self.threads, MAX_WINDOW_ROWS // lanes)
        # Runs whose faults begin at similar times share a checkpoint. A large window has more.
        if self.kernel.branches:
            ticks_per_row = max(1.0, float((self.plan.ends - self.plan.acts).mean()))
            sorted_rows = int(min(SORTED_ROWS, SORTED_TICKS / ticks_per_row))
            useful_blocks = max(useful_blocks, sorted_rows // lanes)
        # A file is stored when all its rows are computed, so a window has no more rows than a file.
        blocks = max(self.threads, min(useful_blocks, math.ceil(rows_per_file / lanes)))
        # On a CPU, each thread may copy golden runs' series for a block at the same time.
        memory, copies = GOLDEN_BYTES, self.threads
        if self._on_gpu:
            memory, copies = GPU_TIMES * GOLDEN_BYTES, 1
        return WindowLimits(
            lanes=lanes,
            blocks=blocks,
            golden_runs=self._whole_vectors(memory // golden_bytes),
            unshared_lanes=self._whole_vectors(memory // series_bytes // copies),
        )

    def _whole_vectors(self, lanes: int) -> int:
        # Rounds a number of lanes down to a multiple of the smallest block, which is one vector. A
        # smaller number stays, but becomes at least 1.
        vector = self.kernel.size(1)
        return max(1, lanes // vector * vector or lanes)

    # --- golden runs ---

    def _submit_golden_runs(
        self, pool: ThreadPoolExecutor, window: Window, earlier: GoldenRuns | None
    ) -> GoldenRuns:
        # Returns the golden runs of a window, as futures, whose computations are submitted to
        # `pool`. earlier: the golden runs of the window before; those that this window needs, too,
        # are not computed again. A golden run has the parameters of the first row that uses it.
        numbers, first = np.unique(self.plan.golden[window.rows], return_index=True)
        rows = window.rows[first]
        is_known = np.isin(numbers, () if earlier is None else earlier.numbers)
        if earlier is not None and is_known.all():
            golden_runs = earlier
        else:
            new_rows = rows[~is_known]
            # The new golden runs are divided evenly among the threads. `size` rounds up to the
            # number of lanes of a block that the kernel can compute.
            lanes_per_thread = self.kernel.size(math.ceil(len(new_rows) / self.threads))
            lanes = min(self.kernel.lanes, lanes_per_thread)
            parts = [
                pool.submit(self._compute_golden_runs, new_rows[i : i + lanes])
                for i in range(0, len(new_rows), lanes)
            ]
            # branches: checkpoints of each golden run, by its number.
            kept, branches = None, {}
            if earlier is not None and is_known.any():
                kept = earlier.computed
                branches = {n: b for n, b in earlier.branches.items() if n in numbers}
            joined = pool.submit(Computed.join, parts, kept, numbers)
            golden_runs = GoldenRuns(numbers, joined, branches)
        for number, row in zip(numbers.tolist(), rows, strict=True):
            if self._fast_forward.uses_checkpoints[number] and number not in golden_runs.branches:
                golden_runs.branches[number] = pool.submit(self._make_branches, row, golden_runs)
        return golden_runs

    def _compute_golden_runs(self, rows: np.ndarray) -> Computed:
        # Computes the golden runs of these rows: their signals, and their outcomes.
        self.progress.more_due(self.kernel.size(len(rows)) * self.plan.program.ticks)
        block = self._block(rows, None, harmless=True)
        # A golden run must last until the last of its faulty runs ends.
        if block.ends is not None:
            golden = self.plan.golden[self._fill_lanes(rows)]
            block = dataclasses.replace(block, ends=self._fast_forward.last_end[golden])
        result = self.kernel.run(block, self.plan.columns, self._count)
        # Lanes after the last row only fill the block.
        golden_outcomes = outcomes.select_golden_outcomes(self.plan.shape, result.outcomes)
        columns = take_rows(golden_outcomes, slice(len(rows)))
        self._fault_free_outcomes.append(columns)
        return Computed(self.plan.golden[rows], result.reference[:, :, : len(rows)], columns)

    def _make_branches(self, row: int, golden_runs: GoldenRuns) -> Branches:
        # Computes the golden run of a row again, with checkpoints from which runs can start.
        number = self.plan.golden[row]
        # No run starts from a checkpoint after the last tick in which a fault begins to act.
        last_tick = int(self._fast_forward.last_act[number])
        ends = self._fast_forward.early_ends(number)
        kernel = cast(BranchingKernel, self.kernel)
        block = self._block(np.array([row]), golden_runs.computed.result(), harmless=True)
        trunk, columns = kernel.trunk(block, self.plan.columns, last_tick, ends)
        return Branches(trunk, ends, outcomes.select_golden_outcomes(self.plan.shape, columns))

    def _golden_outcomes(self, rows: np.ndarray, golden_runs: GoldenRuns) -> Columns:
        # Returns the outcomes that the golden run of each row has at the end of the row's run.
        computed = golden_runs.computed.result()
        golden, ends = self.plan.golden[rows], self.plan.ends[rows]
        # Rows that end before the last row of the same golden run. `computed` has outcomes only at
        # the last end, so those of these rows are missing.
        missing = self._fast_forward.ends_early[rows]
        if len(computed.numbers) == 1 and not missing.any():
            columns = computed.outcomes.items()
            return {name: np.broadcast_to(values, len(rows)) for name, values in columns}
        # 1. The outcomes at the last end.
        columns = take_rows(computed.outcomes, np.searchsorted(computed.numbers, golden))
        # 2. A golden run with checkpoints also has the outcomes at all earlier ends.
        for number in np.unique(golden[missing]).tolist():
            if number in golden_runs.branches:
                branches = golden_runs.branches[number].result()
                found = missing & (golden == number)
                missing &= ~found
                end_indices = np.searchsorted(branches.ends, ends[found])
                for name, values in branches.outcomes.items():
                    columns[name][found] = values[end_indices]
        # 3. Other golden runs are computed again up to each earlier end.
        if missing.any():
            # One number for each pair of golden run and end, so that no pair is computed twice.
            pairs = golden[missing] * (1 + self.plan.program.ticks) + ends[missing]
            _, first, pair_of_row = np.unique(pairs, return_index=True, return_inverse=True)
            block = self._block(rows[missing][first], computed, harmless=True)
            result = self.kernel.run(block, self.plan.columns)
            for name, values in columns.items():
                values[missing] = result.outcomes[name][pair_of_row]
        return columns

    # --- blocks ---

    def _compute_faulty_runs(self, rows: np.ndarray, golden_runs: GoldenRuns) -> OutcomePair:
        # Returns the outcomes of runs with faults, and those of their golden runs.
        # Lanes that only fill the block are computed, too: the progress must count their ticks.
        self.progress.more_due((self.kernel.size(len(rows)) - len(rows)) * self.plan.program.ticks)
        computed = golden_runs.computed.result()
        is_used = np.isin(computed.numbers, self.plan.golden[rows]).tolist()
        # For each golden run all its checkpoints, from which runs start; None: none, or not used.
        trunks = []
        for number, used in zip(computed.numbers.tolist(), is_used, strict=True):
            branches = golden_runs.branches.get(number)
            trunks.append(branches.result().trunk if branches and used else None)
        block = dataclasses.replace(self._block(rows, computed), trunks=trunks)
        result = self.kernel.run(block, self.plan.columns, self._count)
        columns = take_rows(result.outcomes, slice(len(rows)))
        # Runs that may end early have a column with their length.
        if self.plan.program.ends:
            columns[schema.OBSERVED] = self.plan.ends[rows] * self.plan.tick_ms
        return columns, self._golden_outcomes(rows, golden_runs)

    def _block(self, rows: np.ndarray, computed: Computed | None, harmless: bool = False) -> Block:
        # Returns the inputs of a kernel for these rows. computed: golden runs of the rows; None:
        # the rows are golden runs, which need no reference. harmless: leave out all faults.
        plan = self.plan
        row_of_lane = self._fill_lanes(rows)
        # Index of each lane's golden run in `computed`.
        golden = None
        if computed is not None:
            golden = np.searchsorted(computed.numbers, plan.golden[row_of_lane])
        return Block(
            *plan.lanes(rows, len(row_of_lane), harmless),
            reference=None if computed is None else computed.reference,
            golden=golden,
            acts=plan.acts[row_of_lane],
            ends=plan.ends[row_of_lane] if plan.program.ends else None,
            rows=len(rows),
        )

    def _fill_lanes(self, rows: np.ndarray) -> np.ndarray:
        # Returns the row of each lane of a block. The last row is repeated to fill all lanes.
        return rows[np.minimum(np.arange(self.kernel.size(len(rows))), len(rows) - 1)]
