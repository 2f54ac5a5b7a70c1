"""The parts of the benchmark: what each measures, under which name it is asked for, and what it
costs.

Every one runs in a process of its own. The most telling come first: where time is short, the last
are left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

from ravenjax.bench import (
    campaigns,
    cores,
    devices,
    fault_times,
    operations,
    peak,
    peers,
    software,
    speed,
    start,
)
from ravenjax.bench.effort import PartCost

Name = Literal[
    "engines",
    "shell",
    "cores",
    "devices",
    "fault_times",
    "campaigns",
    "software",
    "operations",
    "peak",
    "peers",
]
"""What `--only` takes."""
NAMES: tuple[Name, ...] = get_args(Name)
MACHINE, DEVICES = "machine", "devices"
MACHINE_COST = PartCost(1.5, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class BenchPart:
    """Something that is measured by itself."""

    name: str  # in the findings
    option: Name | Literal["machine"]  # what `--only` takes for it
    what: str  # in words, while it runs
    work: Callable[..., Any]  # seconds to measure, then `arguments`
    cost: PartCost
    quick: bool = False  # part of a quick run, too
    arguments: tuple[Any, ...] = ()
    needs_gpu: bool = False


def _engine(name: str, cost: PartCost, quick: bool = False) -> BenchPart:
    return BenchPart(
        f"engine {name}",
        "engines",
        f"engine {name}",
        speed.of_engine,
        cost,
        quick,
        (name,),
        name == "cuda",
    )


PARTS: tuple[BenchPart, ...] = (
    _engine("cuda", PartCost(8.0, 4.0, 20.0), True),
    _engine("simd", PartCost(4.0, 1.5, 12.0), True),
    BenchPart(
        "peak cuda",
        "peak",
        "peak of the GPUs",
        peak.measure,
        PartCost(2.0, 2.0, 4.0),
        True,
        ("cuda",),
        True,
    ),
    BenchPart(
        "peak simd",
        "peak",
        "peak of the CPU",
        peak.measure,
        PartCost(1.0, 0.5, 2.0),
        True,
        ("simd",),
    ),
    BenchPart(
        "operations",
        "operations",
        "operations of a tick",
        operations.measure,
        PartCost(3.5, 0.0, 0.0),
        True,
    ),
    BenchPart(
        "starts", "shell", "commands from the shell", start.measure, PartCost(1.0, 9.0, 30.0), True
    ),
    BenchPart(
        "large_starts",
        "shell",
        "a million runs from the shell",
        start.measure_large,
        PartCost(2.0, 16.0, 40.0),
        needs_gpu=True,
    ),
    BenchPart("cores", "cores", "one core and several", cores.measure, PartCost(5.0, 8.0, 30.0)),
    BenchPart(
        DEVICES,
        "devices",
        "one GPU and several",
        devices.measure,
        PartCost(0.0, 0.0, 0.0),
        needs_gpu=True,
    ),
    BenchPart(
        "fault_times",
        "fault_times",
        "runs by when their fault strikes",
        fault_times.measure,
        PartCost(5.0, 4.0, 15.0),
    ),
    BenchPart(
        "software",
        "software",
        "the control software alone",
        software.measure,
        PartCost(4.0, 1.0, 6.0),
        True,
    ),
    BenchPart(
        "campaigns",
        "campaigns",
        "whole campaigns in memory",
        campaigns.measure,
        PartCost(4.0, 2.0, 10.0),
    ),
    BenchPart(
        "mujoco.rollout", "peers", "mujoco.rollout", peers.rollout, PartCost(2.0, 0.5, 5.0), True
    ),
    BenchPart(
        "published_model",
        "peers",
        "the published model",
        peers.published_model,
        PartCost(3.0, 0.3, 2.0),
        True,
    ),
    BenchPart("jax.vmap(mjx.step)", "peers", "mjx.step", peers.mjx_step, PartCost(12.0, 1.0, 6.0)),
    _engine("wasm", PartCost(7.0, 2.0, 10.0)),
    _engine("xla", PartCost(14.0, 4.0, 8.0)),
    _engine("mjx", PartCost(38.0, 4.0, 8.0)),
)
A_COUNT_OF_DEVICES = PartCost(10.0, 4.0, 20.0)
"""What each number of GPUs costs."""


def wanted(quick: bool, only: Sequence[Name], gpus: int) -> list[BenchPart]:
    """The parts that are to be measured, in order. only: those alone, also of a quick run; all
    where empty.
    """
    some = [part for part in PARTS if (part.option in only if only else part.quick or not quick)]
    return [_for_devices(part, gpus) if part.name == DEVICES else part for part in some]


def _for_devices(part: BenchPart, gpus: int) -> BenchPart:
    one, number = A_COUNT_OF_DEVICES, len(devices.counts(gpus)) if gpus else 0
    return dataclasses.replace(
        part, cost=PartCost(one.usual_s * number, one.least_s * number, one.most_s * number)
    )
