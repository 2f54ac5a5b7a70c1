"""Full ticks per second of an engine, driven as a campaign drives it: blocks side by side, one
golden run for all.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

from bench import workload
from bench.workload import Workload
from ravenjax.engines import selection, traced
from ravenjax.engines.interface import Engine, Kernel
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.setup import CAMPAIGN

PRINTING = ("simd", "cuda")
"""Engines that print the traced tick themselves; the others leave it to XLA."""
SIZES = {"cuda": (4096, 65_536, 811_008), "simd": (16, 256, 4096, 16_384)}
"""Engine -> runs of a batch."""
XLA_SIZES = {"cpu": (1024,), "gpu": (65_536, 524_288)}
"""Backend of JAX -> runs of a batch of `xla` and `mjx`. XLA compiles each for 10 to 60 s."""
TICKS = {"cuda": 3000, "simd": 1000, "xla": 200, "mjx": 20}
"""Engine -> ticks of a run."""


def measure(seconds: float, name: str) -> list[dict[str, Any]]:
    """Measure the engine of that name for about so long beyond its start. Raises UserError where
    there is none.
    """
    engine = selection.select(name, CAMPAIGN)
    sizes = SIZES.get(name) or XLA_SIZES.get(jax.default_backend(), XLA_SIZES["gpu"])
    return measure_batches(engine, Workload(TICKS[name]), sizes, seconds)


def measure_batches(
    engine: Engine, work: Workload, sizes: Sequence[int], seconds: float
) -> list[dict[str, Any]]:
    """Time a batch of each of these numbers of runs."""
    kernels: dict[int, Kernel] = {}
    rows: list[dict[str, Any]] = []
    for runs in sizes:
        compiled = engine.compile(work.program, runs)
        kernel = kernels.setdefault(compiled.lanes, compiled)
        start = {} if rows else _time_start(engine, kernel, work, runs)
        run = functools.partial(
            work.run, kernel, work.blocks(kernel, runs, kernel.lanes), engine.threads
        )
        run()
        times = workload.repeat(run, seconds / len(sizes))
        rows.append(
            {
                "engine": engine.name,
                "device": engine.device,
                "runs": runs,
                "lanes": kernel.lanes,
                "ticks_per_s": runs * work.ticks / min(times),
                "seconds": times,
                **start,
            }
        )
    return rows


def _time_start(engine: Engine, kernel: Kernel, work: Workload, runs: int) -> dict[str, float]:
    """Seconds until the first kernel is ready; and those of a kernel whose tick is traced."""
    block = work.golden_runs(kernel.lanes)
    start = {"start_s": workload.measure_once(lambda: kernel.prepare(block, work.motion))}
    if engine.name in PRINTING:
        # Kernels of printing engines name the program that they print.
        again: Any = engine.compile(work.program, runs)
        traced.forget()
        traced.forms(again.program, block, work.motion)
        start["ready_s"] = workload.measure_once(lambda: again.prepare(block, work.motion))
    return start
