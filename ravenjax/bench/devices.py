"""The bare kernel beside whole campaigns on one GPU and on several, each number in a process
that sees no more.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence

from ravenjax.bench import apart, scaling
from ravenjax.bench.clock import Repeats
from ravenjax.bench.scaling import Scaling, ScalingPoint
from ravenjax.campaign import compile_cache
from ravenjax.engines import selection
from ravenjax.numbers.setup import CAMPAIGN

ENGINE, VISIBLE = "cuda", "CUDA_VISIBLE_DEVICES"
LANES, TICKS = 405_504, 10_000
"""Runs of the bare kernel for each GPU, which fill an H200 eight times; ticks of a run, of
campaigns as well.
"""
LEAST_RUNS = 2**17
"""Of a campaign for each GPU."""
BLOCKS = 2
"""Of the bare kernel for each GPU: while one runs, the next is packed."""


@dataclasses.dataclass(frozen=True)
class DeviceWork:
    """What is run for each device."""

    engine: str = ENGINE
    lanes: int = LANES
    ticks: int = TICKS
    least_runs: int = LEAST_RUNS


def counts(devices: int) -> list[int]:
    """1, 2, 4 .. and all."""
    return sorted({2**k for k in range(devices.bit_length()) if 2**k <= devices} | {devices})


def measure(
    seconds: float,
    names: Sequence[str],
    environment: Mapping[str, str],
    limit_s: float,
    work: DeviceWork | None = None,
) -> Scaling:
    """Measure for about so long beyond starts, on the first of these devices, the first two, and so
    on.

    environment: variables of every process. limit_s: of all; what has not come by then is left out.
    Raises RuntimeError where not even one device can be measured.
    """
    work, numbers = work or DeviceWork(), counts(len(names))
    points, complaints = list[ScalingPoint](), list[str]()
    end = time.perf_counter() + limit_s
    for number in numbers:
        only = dict(environment) | {VISIBLE: ",".join(names[:number])}
        runs = points[0].runs if points else None
        share = seconds / len(numbers)
        answer = apart.run(
            point,
            share,
            number,
            work,
            runs,
            limit_s=max(1.0, end - time.perf_counter()),
            environment=only,
        )
        if answer.why:
            complaints.append(f"{number}: {answer.why}")
        else:
            points.append(answer.value)
    if not points or points[0].count != 1:
        raise RuntimeError("; ".join(complaints))
    return Scaling(work.engine, tuple(points), work.ticks, work.ticks, "; ".join(complaints))


def point(seconds: float, number: int, work: DeviceWork, runs: int | None) -> ScalingPoint:
    """With all devices that this process sees, `number` of them. runs: of a campaign for each;
    None: as time allows.
    """
    engine = selection.select(work.engine, CAMPAIGN, compile_cache.objects())
    bare = scaling.blocks(engine, work.ticks, work.lanes // BLOCKS, BLOCKS * number)
    bare.ticks_per_s(engine.threads)  # loads the code on every device
    scaling.campaign_rate(work.engine, work.least_runs, work.ticks)
    runs = runs or scaling.affordable(
        lambda runs: scaling.campaign_rate(work.engine, runs, work.ticks),
        work.ticks,
        work.least_runs,
        0.25 * seconds,
    )
    kernel, campaign = list[float](), list[float]()

    def once() -> None:
        kernel.append(bare.ticks_per_s(engine.threads))
        campaign.append(scaling.campaign_rate(work.engine, number * runs, work.ticks))

    scaling.rounds(once, 0.7 * seconds)
    return ScalingPoint(
        number, False, Repeats(tuple(kernel)), Repeats(tuple(campaign)), number * runs
    )
