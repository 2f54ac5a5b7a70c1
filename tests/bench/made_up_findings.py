"""Findings of benchmarks that never ran: numbers from which ratios, shares and sentences follow
by heart.
"""

from __future__ import annotations

import dataclasses

import bench_work

from ravenjax.bench.campaigns import Campaigns
from ravenjax.bench.clock import Repeats, WorkTiming
from ravenjax.bench.fault_times import FaultTime, FaultTimes
from ravenjax.bench.operations import Operations
from ravenjax.bench.peers import Peer
from ravenjax.bench.scaling import Scaling, ScalingPoint
from ravenjax.bench.software import SoftwareSpeed
from ravenjax.bench.speed import Batch, Speed
from ravenjax.bench.start import ShellStart
from ravenjax.bench.suite import BenchFindings, PartClock


def point(
    count: int, kernel: tuple[float, ...], campaign: tuple[float, ...], shared: bool = False
) -> ScalingPoint:
    """Rates in M ticks/s."""
    million = [Repeats(tuple(1e6 * value for value in values)) for values in (kernel, campaign)]
    return ScalingPoint(count, shared, *million, 1000 * count)


def scaling(*points: ScalingPoint, engine: str = "simd", note: str = "") -> Scaling:
    return Scaling(engine, points, 3000, 10_000, note)


def fault_time(start_ms: int, observe_ms: int | None, run_s: float) -> FaultTime:
    """Of a run of 10 s."""
    after = 10_000 - start_ms if observe_ms is None else min(observe_ms, 10_000 - start_ms)
    return FaultTime(start_ms, observe_ms, after, Repeats((run_s, 1.1 * run_s)))


def starts(cold: tuple[float, ...], others: tuple[float, ...]) -> tuple[ShellStart, ...]:
    return (
        ShellStart("ravenjax run quick, nothing cached", Repeats(cold), 6.5, 512.0),
        ShellStart("ravenjax run quick again", Repeats(others), 3.0, 240.0),
        ShellStart("ravenjax run quick with other values", Repeats(others), 3.0, 241.0),
    )


def whole() -> BenchFindings:
    """One second for a million ticks by simd, a thousandth of that by mjx."""
    one = WorkTiming(1.0, 2.0, 3)
    batches = Batch(500, 16, 1000, WorkTiming(0.6, 0.7, 3)), Batch(1000, 256, 1000, one)
    return BenchFindings(
        machine=bench_work.MACHINE,
        load_before=0.5,
        load_after=1.5,
        clocks=(
            PartClock("engine simd", 20.0, 12.0, 300.0, 0.1),
            PartClock("starts", 30.0, 27.0, 50.0, 0.0),
        ),
        absent={
            "devices": "no GPU",
            "engine xla": "left out: 3 s were left, it takes 14 s; more with --seconds",
        },
        engines=(
            Speed("simd", "a CPU", 2, 3.0, 0.5, batches),
            Speed("mjx", "a CPU", 2, 9.0, 8.0, (Batch(10, 16, 100, one),)),
        ),
        operations=Operations({"robot.step": 1000, "": 500}, {"nominal.step": 200}),
        peak={"simd": 3e9},
        peers=(Peer("mujoco.rollout", "CPU", 10, 200, 0.0, WorkTiming(0.01, 0.02, 3)),),
        published_model=Peer(
            "published 3-joint Euler model",
            "CPU, 1 core",
            1,
            1000,
            0.1,
            WorkTiming(0.0055, 0.006, 3),
        ),
        campaigns=Campaigns("simd", 1000, 5.0, {100: 3.0, 1100: 4.0}),
        software=SoftwareSpeed(
            2000, 200, WorkTiming(0.02, 0.03, 3), WorkTiming(0.01, 0.02, 3), WorkTiming(0.2, 0.3, 3)
        ),
        starts=starts((4.9, 5.0), (1.9, 2.0)),
        cores=scaling(
            point(1, (15.0, 15.1), (12.0, 12.1)),
            point(2, (30.0, 30.2), (21.78, 21.7)),
            point(3, (33.0, 33.1), (25.0, 25.1), shared=True),
        ),
        fault_times=FaultTimes(
            "simd",
            10_000,
            256,
            (
                fault_time(0, None, 1e-3),
                fault_time(5000, None, 0.6e-3),
                fault_time(9000, None, 0.28e-3),
                fault_time(0, 1000, 0.2e-3),
                fault_time(9000, 1000, 0.25e-3),
            ),
        ),
    )


def with_other(**fields: object) -> BenchFindings:
    """The same with other parts."""
    return dataclasses.replace(whole(), **fields)  # type: ignore[arg-type]


def nothing(**fields: object) -> BenchFindings:
    """A benchmark of which nothing came, but these parts."""
    return dataclasses.replace(BenchFindings(None, float("nan"), float("nan")), **fields)  # type: ignore[arg-type]
