"""Measures the full ticks per second of an engine, under the conditions of a campaign: blocks of
runs in parallel, with one golden run for all blocks.
"""

import functools
from collections.abc import Sequence
from typing import Any

from bench import workload
from bench.workload import Workload
from ravenjax.engines import selection, traced
from ravenjax.engines.interface import Engine, Kernel
from ravenjax.engines.xla import ScanKernel
from ravenjax.ir.regions import Region, arrange_regions
from ravenjax.ir.time_loop import Split, split_lanes
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.setup import CAMPAIGN

PRINTING = ("simd", "cuda")
"""Engines that generate code for the traced tick themselves. The others leave this to XLA."""
SIZES = {"cuda": (4096, 65_536, 811_008), "simd": (16, 256, 4096, 16_384)}
"""Runs of a batch, by engine."""
XLA_SIZES = {"cpu": (8192,), "gpu": (65_536, 524_288)}
"""Runs of a batch of `xla` and `mjx`, by JAX's backend. XLA needs 10 to 60 s to compile each."""
_FREE = ("neg", "bitcast", "constant", "input")
"""Operations without a cost: they become part of others, or disappear."""
TICKS = {"cuda": 3000, "simd": 1000, "xla": 200, "mjx": 100}
"""Ticks of a run, by engine."""


def measure(seconds: float, name: str) -> list[dict[str, Any]]:
    """Measure an engine for about `seconds` after its start. Raises UserError if it is unknown."""
    engine = selection.select_engine(name, CAMPAIGN)
    sizes = SIZES.get(name) or XLA_SIZES.get(jax.default_backend(), XLA_SIZES["gpu"])
    return measure_batches(engine, Workload(TICKS[name]), sizes, seconds)


def measure_batches(
    engine: Engine, work: Workload, sizes: Sequence[int], seconds: float
) -> list[dict[str, Any]]:
    """Time a batch of each of these numbers of runs."""
    kernels: dict[int, Kernel] = {}
    rows: list[dict[str, Any]] = []
    for runs in sizes:
        compiled = engine.compile(work.plan.program, runs)
        kernel = kernels.setdefault(compiled.lanes, compiled)
        start = {} if rows else _time_start(engine, kernel, work, runs)
        run = functools.partial(
            work.run, kernel, work.blocks(kernel, runs, kernel.lanes), engine.threads
        )
        run()
        operations = count_operations(kernel, work)
        times = workload.repeat(run, seconds / len(sizes))
        rate = runs * work.ticks / min(times)
        rows.append(
            {
                "engine": engine.name,
                "device": engine.device,
                "runs": runs,
                "lanes": kernel.lanes,
                "ticks_per_s": rate,
                "operations_per_tick": operations,
                "operations_per_s": operations * rate,
                "seconds": times,
                **start,
            }
        )
    return rows


def count_operations(kernel: Any, work: Workload) -> float:
    """Return the operations of a tick in each run: of printed code those that every tick needs (a
    multiply-add counts as one), of XLA its own count (it counts as two).
    """
    if isinstance(kernel, ScanKernel):
        lanes, compiled = max(kernel.compiled.items())
        # XLA counts the loop body once.
        return float((compiled.cost_analysis() or {}).get("flops", 0.0)) / lanes
    if not isinstance(kernel, traced.PrintedKernel):
        return 0.0
    loop = kernel.forms(work.golden_runs(kernel.lanes), work.plan.columns).traced.without_signals()
    return float(len(list_operations(split_lanes(loop, len(work.plan.program.varied), True))[0]))


def list_operations(parted: Split) -> tuple[list[int], list[int]]:
    """Return the numbers of the operations of each run, and of those that runs share, without those
    that cost nothing or that only some ticks need.
    """
    step, loop = parted.loop.step, parted.loop
    leaving = [*(step.outputs[k] for k in parted.lane_state), *step.outputs[loop.states :]]
    of_groups = [*parted.row, *(step.outputs[k] for k in parted.shared_state)]
    lane, shared = (
        [i for i in numbers if not isinstance(i, Region) and step.operations[i].name not in _FREE]
        for numbers in (
            arrange_regions(step.operations, parted.lane, leaving),
            arrange_regions(step.operations, parted.shared, of_groups),
        )
    )
    return lane, shared


def _time_start(engine: Engine, kernel: Kernel, work: Workload, runs: int) -> dict[str, float]:
    """Return the seconds until the first kernel is ready, and if its tick is already traced."""
    block = work.golden_runs(kernel.lanes)
    start = {"start_s": workload.measure_once(lambda: kernel.prepare(block, work.plan.columns))}
    if engine.name in PRINTING:
        # Kernels of code-generating engines name the program that they compile.
        again: Any = engine.compile(work.plan.program, runs)
        traced.FORMS.clear()
        traced.traced_forms(again.program, block, work.plan.columns)
        start["ready_s"] = workload.measure_once(lambda: again.prepare(block, work.plan.columns))
    return start
