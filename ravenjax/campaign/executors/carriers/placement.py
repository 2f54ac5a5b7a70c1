"""Where worker processes run: each with a GPU, or with cores of one NUMA node, of its own."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

CORES = 8
"""Cores of a worker where nobody chose a number: a block of 256 runs of 0.5 s takes engine simd 17
ms of a core and holds Python for 2 ms of them, so that more threads of one process would wait for
each other."""
_NODES = Path("/sys/devices/system/node")


@dataclass(frozen=True)
class Seat:
    """Where one worker runs."""

    cpus: tuple[int, ...]
    environment: dict[str, str] = field(default_factory=dict)


def seats(workers: int | None, gpus: Sequence[str]) -> list[Seat]:
    """A seat for each worker. gpus: what CUDA_VISIBLE_DEVICES may name, none where the engine uses
    none.

    workers: None for one a GPU, or one for every `CORES` cores of a NUMA node.
    """
    nodes = numa_nodes(os.sched_getaffinity(0))
    count = workers or len(gpus) or sum(-(-len(node) // CORES) for node in nodes)
    return [
        Seat(cpus, {"CUDA_VISIBLE_DEVICES": gpus[number % len(gpus)]} if gpus else {})
        for number, cpus in enumerate(groups(nodes, count))
    ]


def groups(nodes: Sequence[Sequence[int]], count: int) -> list[tuple[int, ...]]:
    """The CPUs of `nodes` in `count` groups as even as can be, neighbours together; shared where
    they are too few.
    """
    cpus = [cpu for node in nodes for cpu in node]
    if count >= len(cpus):
        return [(cpus[number % len(cpus)],) for number in range(count)]
    cuts = [number * len(cpus) // count for number in range(count + 1)]
    return [tuple(cpus[a:b]) for a, b in itertools.pairwise(cuts)]


def numa_nodes(allowed: Iterable[int], folder: Path = _NODES) -> list[list[int]]:
    """The allowed CPUs by NUMA node, ascending; one node where the system names none."""
    left = set(allowed)
    nodes = []
    for path in sorted(
        folder.glob("node[0-9]*/cpulist"), key=lambda path: int(path.parent.name[4:])
    ):
        here = sorted(left & set(_cpus(path.read_text())))
        if here:
            nodes.append(here)
            left -= set(here)
    return [*nodes, sorted(left)] if left else nodes


def visible_gpus(count: int) -> list[str]:
    """Names of the GPUs that this process sees, as CUDA_VISIBLE_DEVICES has them."""
    named = [
        name.strip()
        for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")
        if name.strip()
    ]
    return named[:count] if named else [str(number) for number in range(count)]


def _cpus(text: str) -> Iterable[int]:
    """CPU numbers of a list as the kernel writes it: 0-3,8."""
    for first, last in re.findall(r"(\d+)(?:-(\d+))?", text):
        yield from range(int(first), int(last or first) + 1)
