"""Measures full ticks per second of an engine, driven as a campaign drives it: blocks side by side,
with one golden run for all.
"""

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
"""Engines that generate code for the traced tick themselves. The others leave this to XLA."""
SIZES = {"cuda": (4096, 65_536, 811_008), "simd": (16, 256, 4096, 16_384)}
"""Runs of a batch, by engine."""
XLA_SIZES = {"cpu": (1024,), "gpu": (65_536, 524_288)}
"""Runs of a batch of `xla` and `mjx`, by JAX's backend. XLA needs 10 to 60 s to compile each."""
TICKS = {"cuda": 3000, "simd": 1000, "xla": 200, "mjx": 20}
"""Ticks of a run, by engine."""


def measure(seconds: float, name: str) -> list[dict[str, Any]]:
    """Measure the engine with a name for about `seconds` after its start. Raises UserError if it
    does not exist.
    """
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
    """Return the seconds until the first kernel is ready, and those of a kernel whose tick is
    already traced.
    """
    block = work.golden_runs(kernel.lanes)
    start = {"start_s": workload.measure_once(lambda: kernel.prepare(block, work.motion))}
    if engine.name in PRINTING:
        # Kernels of code-generating engines name the program that they compile.
        again: Any = engine.compile(work.program, runs)
        traced.forget_traces()
        traced.traced_forms(again.program, block, work.motion)
        start["ready_s"] = workload.measure_once(lambda: again.prepare(block, work.motion))
    return start
