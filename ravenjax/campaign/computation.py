"""Rows of a plan through an engine: blocks side by side, each beside the golden runs that it is compared with.

Blocks come out in the order of their rows. A few more than run at a time are under way, so that no thread waits for the
slowest; the golden runs of the next stretch are computed while the last blocks of this one run.
"""

from __future__ import annotations

import copy
import time
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from ravenjax.campaign import outcomes, stretches
from ravenjax.campaign.golden_runs import Computed, GoldenRuns
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress.counts import Progress
from ravenjax.campaign.stretches import Stretch
from ravenjax.engines.interface import Block, Engine

GOLDEN_BYTES = 2**30
"""Memory that the time series of a stretch's golden runs may take; two stretches may be under way."""
AHEAD = 4
"""Blocks of a stretch for each that runs at a time."""

Columns = dict[str, np.ndarray]


class Computation:
    """A plan and the kernel that its rows go through."""

    def __init__(
        self,
        ready: Plan,
        engine: Engine,
        progress: Progress,
        runs: int | None = None,
        threads: int | None = None,
    ) -> None:
        """runs: how many are computed at a time, which sizes blocks; threads: blocks side by side, where the engine is
        not to decide."""
        self.ready, self.progress = ready, progress
        self.threads = max(1, threads or engine.threads)
        self.kernel = engine.compile(ready.program, runs or ready.runs)

    def compile(self) -> None:
        """Trace and compile, before the clock of the runs starts."""
        self.progress.tell("compile")
        start = time.perf_counter()
        rows = range(min(self.ready.runs, self.kernel.lanes))
        block = Block(*self.ready.lanes(rows, self.kernel.size(len(rows))), None)
        self.kernel.prepare(block, self.ready.columns)
        self.progress.began(time.perf_counter() - start)

    def of(self, ready: Plan) -> Computation:
        """The same kernel for other rows of the same program."""
        other = copy.copy(self)
        other.ready = ready
        return other

    def blocks(self, ranges: Sequence[range]) -> Generator[tuple[Columns, Columns]]:
        """Outcomes of the rows of `ranges`, in order, block by block; and `outcomes.of_golden` of their golden runs.

        Close it to give up what is under way.
        """
        setup = self.ready.program.setup
        program = self.ready.program
        a_golden = program.ticks * program.loop.series_length(setup) * np.dtype(setup.precision.real).itemsize
        most_golden_runs = max(1, GOLDEN_BYTES // a_golden)
        ahead = AHEAD * self.threads
        under_way: deque[Future[tuple[Columns, Columns]]] = deque()
        golden_runs = GoldenRuns(np.zeros(0, self.ready.golden.dtype), ())
        with ThreadPoolExecutor(self.threads) as pool:
            try:
                for stretch in stretches.cut(ranges, self.ready.golden, self.kernel.lanes, most_golden_runs, ahead):
                    golden_runs = golden_runs.followed(
                        stretch.golden_runs, lambda lacking, s=stretch: self._start(pool, s, lacking)
                    )
                    for rows in stretch.blocks:
                        if len(under_way) == 2 * self.threads:
                            yield under_way.popleft().result()
                        under_way.append(pool.submit(self._faulty, rows, golden_runs))
                while under_way:
                    yield under_way.popleft().result()
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def _start(self, pool: ThreadPoolExecutor, stretch: Stretch, lacking: np.ndarray) -> list[Future[Computed]]:
        """Start the golden runs `lacking` of a stretch: with the parameters of the first row of each."""
        rows = np.concatenate(stretch.blocks)
        numbers, first = np.unique(self.ready.golden[rows], return_index=True)
        rows = rows[first[np.isin(numbers, lacking)]]
        lanes = self.kernel.lanes
        return [pool.submit(self._fault_free, rows[i : i + lanes]) for i in range(0, len(rows), lanes)]

    def _fault_free(self, rows: np.ndarray) -> Computed:
        lanes = self.kernel.size(len(rows))
        self.progress.more_due(lanes * self.ready.program.ticks)
        varied, faults = self.ready.lanes(rows, lanes, harmless=True)
        result = self.kernel.run(Block(varied, faults, None), self.ready.columns, self.progress.ticks)
        columns = {name: result.outcomes[name][: len(rows)] for name in outcomes.of_golden(result.outcomes)}
        return Computed(self.ready.golden[rows], result.reference[:, :, : len(rows)], columns)

    def _faulty(self, rows: np.ndarray, golden_runs: GoldenRuns) -> tuple[Columns, Columns]:
        lanes, own = self.kernel.size(len(rows)), golden_runs.get()
        self.progress.more_due((lanes - len(rows)) * self.ready.program.ticks)
        golden = np.searchsorted(own.numbers, self.ready.golden[rows])
        filled = golden[np.minimum(np.arange(lanes), len(rows) - 1)]
        block = Block(*self.ready.lanes(rows, lanes), own.reference, filled)
        result = self.kernel.run(block, self.ready.columns, self.progress.ticks)
        columns = {name: values[: len(rows)] for name, values in result.outcomes.items()}
        return columns, {name: values[golden] for name, values in own.outcomes.items()}
