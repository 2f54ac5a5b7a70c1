"""The bare kernel beside whole campaigns on 1, 2, 4 .. cores: real cores first, then their
hyper-threads.

CPUs that this process may not use, and time that its control group does not give it, are left
alone.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

from ravenjax.bench import machine, scaling
from ravenjax.bench.clock import Repeats
from ravenjax.bench.scaling import Scaling, ScalingPoint
from ravenjax.campaign import compile_cache
from ravenjax.engines import selection
from ravenjax.numbers.setup import CAMPAIGN

ENGINE = "simd"
LANES = 256
"""Of a block of the bare kernel."""
KERNEL_TICKS, TICKS = 10_000, 3000
"""Of a run of the bare kernel: a block takes tenths of a second. Of a campaign's run."""
LEAST_RUNS = 512
"""Of a campaign for each core."""


def counts(real: int, threads: int, usable: int) -> list[int]:
    """1, 2, 4 .. real cores, all of them, and all hyper-threads; none beyond what is usable."""
    powers = [2**k for k in range(real.bit_length()) if 2**k <= real]
    return sorted({n for n in (*powers, real, threads) if n <= usable} | {min(usable, threads)})


def measure(
    seconds: float,
    least_runs: int = LEAST_RUNS,
    kernel_ticks: int = KERNEL_TICKS,
    ticks: int = TICKS,
) -> Scaling:
    """Measure for about so long beyond tracing, each count in turn and again. Which CPUs this
    process uses is as before afterwards."""
    allowed = os.sched_getaffinity(0)
    order, quota = machine.spread(allowed), machine.quota()
    real = sum(not shared for _, shared in order)
    numbers = counts(real, len(order), machine.usable_cpus())
    engine = selection.select(ENGINE, CAMPAIGN, compile_cache.objects())
    bare = scaling.blocks(engine, kernel_ticks, LANES, numbers[-1])
    kernel, campaign = ({n: list[float]() for n in numbers} for _ in range(2))
    try:
        scaling.campaign_rate(ENGINE, least_runs, ticks)  # traces
        runs = _runs_for_each(order, least_runs, ticks, 0.3 * seconds / len(numbers))

        def once() -> None:
            for n in numbers:
                _use(order, n)
                kernel[n].append(bare.first(n).ticks_per_s(n))
                campaign[n].append(scaling.campaign_rate(ENGINE, n * runs, ticks))

        scaling.rounds(once, 0.8 * seconds)
    finally:
        os.sched_setaffinity(0, allowed)
    points = tuple(
        ScalingPoint(n, n > real, Repeats(tuple(kernel[n])), Repeats(tuple(campaign[n])), n * runs)
        for n in numbers
    )
    return Scaling(ENGINE, points, ticks, kernel_ticks, note(quota, len(order)))


def note(quota: float, cpus: int) -> str:
    """What limited the counts."""
    if quota >= cpus:
        return ""
    return f"the control group of this process gives it the time of {quota:.3g} of its {cpus} CPUs"


def _runs_for_each(
    order: Sequence[tuple[int, bool]], least: int, ticks: int, target_s: float
) -> int:
    _use(order, 1)
    return scaling.affordable(
        lambda runs: scaling.campaign_rate(ENGINE, runs, ticks), ticks, least, target_s
    )


def _use(order: Sequence[tuple[int, bool]], number: int) -> None:
    """Let this thread, and those that it starts, run on the first CPUs only."""
    os.sched_setaffinity(0, {cpu for cpu, _ in order[:number]})
