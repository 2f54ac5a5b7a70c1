"""The cores and GPUs of this machine, as the benchmark counts them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

_NODES = Path("/sys/devices/system/node")


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
