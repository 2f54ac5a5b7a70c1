"""Full ticks per second of an engine, driven as a campaign drives it: blocks side by side, one
golden run for all.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ravenjax.bench import clock
from ravenjax.bench.clock import WorkTiming
from ravenjax.bench.workload import Workload
from ravenjax.engines import selection, traced
from ravenjax.engines.interface import Engine, Kernel
from ravenjax.errors import UserError
from ravenjax.numbers.setup import CAMPAIGN

PRINTING = ("simd", "wasm", "cuda")
"""Engines that print the traced tick themselves; the others leave it to XLA."""
SIZES = {
    "cuda": (4096, 65_536, 811_008),
    "simd": (16, 256, 4096, 65_536),
    "wasm": (16, 256, 4096),
    "xla": (1024,),
    "mjx": (1024,),
}
"""Engine -> runs of a batch, ascending; XLA compiles ten seconds for each, and half a minute
with mjx.
"""
TICKS = {"cuda": 3000, "simd": 1000, "wasm": 1000, "xla": 200, "mjx": 20}
"""Engine -> ticks of a run."""
_TWICE = 2.5
"""Times that a batch is run at least: once untimed; a larger one is a little slower than it
promises.
"""


@dataclasses.dataclass(frozen=True)
class Batch:
    """So many runs at once."""

    runs: int
    lanes: int  # of a block
    ticks: int  # of a run
    timing: WorkTiming

    @property
    def ticks_per_s(self) -> float:
        """Full ticks, those of lanes that only fill a block not counted."""
        return self.runs * self.ticks / self.timing.best_s


@dataclasses.dataclass(frozen=True)
class Speed:
    """What one engine does."""

    engine: str
    device: str
    threads: int  # blocks side by side
    start_s: float  # s, first kernel of this process: tracing and making it ready
    ready_s: float  # s of a start that come after tracing
    batches: tuple[Batch, ...]

    @property
    def best(self) -> Batch:
        """The fastest batch."""
        return max(self.batches, key=lambda batch: batch.ticks_per_s)

    @property
    def growth(self) -> tuple[float, float] | None:
        """(s, s a run) of the line through the two largest batches, start not counted; None with
        one batch.
        """
        if len(self.batches) < 2:
            return None
        less, more = sorted(self.batches, key=lambda batch: batch.runs)[-2:]
        marginal = (more.timing.best_s - less.timing.best_s) / (more.runs - less.runs)
        return more.timing.best_s - marginal * more.runs, marginal


def find(name: str) -> Engine | str:
    """The engine, or in one line why there is none; nothing that it compiles is taken from or
    left in a cache.
    """
    try:
        engine = selection.select(name, CAMPAIGN)
        return engine if engine.device else f"engine {name!r} names no device"
    except UserError as error:
        return str(error)


def of_engine(seconds: float, name: str) -> Speed:
    """Measure the engine of that name for about so long beyond its start. Raises UserError where
    there is none.
    """
    engine = find(name)
    if isinstance(engine, str):
        raise UserError(engine)
    sizes = SIZES[name]
    return measure(
        engine, Workload(TICKS[name]), sizes, clock.REPEATS, 0.5 * seconds / len(sizes), seconds
    )


def measure(
    engine: Engine,
    workload: Workload,
    sizes: Sequence[int],
    repeats: int,
    enough_s: float,
    seconds: float = math.inf,
) -> Speed:
    """Time batches of these numbers of runs, ascending; the first always, the next if they promise
    to fit into `seconds`."""
    kernels: dict[int, Kernel] = {}
    start = ready = 0.0
    batches = list[Batch]()
    left = seconds
    for runs in sizes:
        if batches and _TWICE * batches[-1].timing.median_s * runs / batches[-1].runs > left:
            break
        began = time.perf_counter()
        kernel = engine.compile(workload.program, runs)
        if kernel.lanes not in kernels:
            spent, compiling = _prepare(kernel, workload)
            start, ready = (start, ready) if kernels else (spent, compiling)
            kernels[kernel.lanes] = kernel
            began += spent
        batches.append(_batch(engine, kernels[kernel.lanes], workload, runs, repeats, enough_s))
        left -= time.perf_counter() - began
    if engine.name in PRINTING:
        ready = _ready_after_tracing(engine, workload, sizes[0])
    return Speed(engine.name, engine.device, engine.threads, start, ready, tuple(batches))


def _prepare(kernel: Kernel, workload: Workload) -> tuple[float, float]:
    """Seconds until the kernel is ready, and those of them that XLA compiles."""
    block = workload.golden_runs(kernel.lanes)
    with clock.xla_compiling() as compiling:
        spent = clock.seconds(lambda: kernel.prepare(block, workload.motion))
    return spent, sum(compiling)


def _ready_after_tracing(engine: Engine, workload: Workload, runs: int) -> float:
    """Seconds in which a kernel whose tick is traced becomes ready: printing and compiling, the
    better of two.
    """

    def once() -> float:
        kernel: Any = engine.compile(
            workload.program, runs
        )  # those of printing engines say what they print
        block = workload.golden_runs(kernel.lanes)
        traced.forget()
        traced.forms(kernel.program, block, workload.motion)
        return clock.seconds(lambda: kernel.prepare(block, workload.motion))

    return min(once() for _ in range(2))


def _batch(
    engine: Engine, kernel: Kernel, workload: Workload, runs: int, repeats: int, enough_s: float
) -> Batch:
    lanes = kernel.lanes
    reference = kernel.run(workload.golden_runs(kernel.size(1)), workload.motion).reference[:, :, 0]
    parts = [(first, min(lanes, runs - first)) for first in range(0, runs, lanes)]
    blocks = [workload.block(first, rows, kernel.size(rows), reference) for first, rows in parts]
    with ThreadPoolExecutor(engine.threads) as pool:

        def work() -> None:
            for _ in pool.map(lambda block: kernel.run(block, workload.motion), blocks):
                pass

        timing = clock.timed(work, repeats, enough_s)
    return Batch(runs, lanes, workload.program.ticks, timing)
