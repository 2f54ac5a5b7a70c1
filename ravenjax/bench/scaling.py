"""How fast the bare kernel and whole campaigns are with what this process has now: its CPUs, or its
GPUs.

Both get as much work for each core or device however many there are, so that a point takes as long
as any other. The bare kernel's blocks are made before the clock starts and are long, so that hardly
any Python runs beside them: what it loses, it loses to shared cores, clocks and memory. What
campaigns lose beyond that, they lose to what surrounds it.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ravenjax.bench import clock, workload
from ravenjax.bench.clock import Repeats
from ravenjax.bench.workload import Workload
from ravenjax.campaign import runner
from ravenjax.engines.interface import Block, Engine, Kernel

LARGEST_RUNS = 2**23
"""Of a campaign, for each core or device: its fault table must fit in memory."""


@dataclasses.dataclass(frozen=True)
class ScalingPoint:
    """With so many cores or devices."""

    count: int
    shared: bool  # hyper-threads of cores that are in use already are among them
    kernel: Repeats  # full ticks/s of the bare kernel
    campaign: Repeats  # full ticks/s of whole campaigns: planning, golden run, tables; in memory
    runs: int  # of the campaign


@dataclasses.dataclass(frozen=True)
class Scaling:
    """Over numbers of cores or devices."""

    engine: str
    points: tuple[ScalingPoint, ...]  # ascending by their count
    ticks: int  # of a campaign's run
    kernel_ticks: int  # of a run of the bare kernel
    note: str  # what limited the counts, in one line; "" for nothing

    def efficiency(self, point: ScalingPoint) -> tuple[float, float]:
        """Of the bare kernel and of whole campaigns: rate over that of the first point times as
        many, at its best.
        """
        first = self.points[0]
        share = first.count / point.count
        return (
            share * point.kernel.largest / first.kernel.largest,
            share * point.campaign.largest / first.campaign.largest,
        )


@dataclasses.dataclass(frozen=True, eq=False)
class KernelBlocks:
    """A kernel and blocks of distinct runs, ready to run."""

    kernel: Kernel
    work: Workload
    blocks: Sequence[Block]
    runs: int  # of all blocks

    def ticks_per_s(self, threads: int) -> float:
        """Full ticks/s of all blocks once, so many at a time."""
        with ThreadPoolExecutor(threads) as pool:
            spent = clock.seconds(lambda: list(pool.map(self._one, self.blocks)))
        return self.runs * self.work.ticks / spent

    def first(self, number: int) -> KernelBlocks:
        """So many blocks of them."""
        return dataclasses.replace(
            self, blocks=self.blocks[:number], runs=self.runs * number // max(1, len(self.blocks))
        )

    def _one(self, block: Block) -> None:
        self.kernel.run(block, self.work.motion)


def blocks(engine: Engine, ticks: int, lanes: int, number: int) -> KernelBlocks:
    """`number` blocks of `lanes` runs each of so many ticks; tracing and compiling are done."""
    work = Workload(ticks)
    kernel = engine.compile(work.program, lanes * number)
    lanes = min(kernel.size(lanes), kernel.lanes)
    golden = kernel.run(work.golden_runs(kernel.size(1)), work.motion).reference[:, :, 0]
    parts = [work.block(first, lanes, lanes, golden) for first in range(0, lanes * number, lanes)]
    return KernelBlocks(kernel, work, parts, lanes * number)


def campaign_rate(engine: str, runs: int, ticks: int) -> float:
    """Full ticks/s of a whole campaign in memory."""
    config = workload.campaign(runs, ticks)
    return runs * ticks / clock.seconds(lambda: runner.run_campaign(config, None, engine))


def affordable(
    rate: Callable[[int], float], ticks: int, least: int, target_s: float, most: int = LARGEST_RUNS
) -> int:
    """Runs of a campaign that take about `target_s` seconds: `least` times a power of two, `most`
    at most.

    rate: ticks/s by runs.

    Tells it by campaigns that grow until one is long enough to go by.
    """
    runs = least
    while True:
        spent = runs * ticks / rate(runs)
        if spent * 4.0 >= target_s or runs * 4 > most:
            break
        runs *= 4
    steps = int(np.log2(max(1.0, target_s / spent)))
    return min(most, runs * 2**steps)


def rounds(measure: Callable[[], None], seconds: float, most: int = 9) -> None:
    """`measure` again and again, as often as it fits into `seconds`; once at least."""
    end = time.perf_counter() + seconds
    for number in range(1, most + 1):
        spent = clock.seconds(measure)
        if number == most or time.perf_counter() + spent > end:
            return
