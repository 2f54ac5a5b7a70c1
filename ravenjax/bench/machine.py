"""What the benchmark runs on: CPU, caches, cores and hyper-threads, limits of its group, memory,
GPUs, versions.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ravenjax.bench.placement import numa_nodes
from ravenjax.errors import UserError

CPUS = Path("/sys/devices/system/cpu")
GROUPS, OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
PACKAGES = (
    "ravenjax",
    "jax",
    "jaxlib",
    "numpy",
    "llvmlite",
    "mujoco",
    "cuda-bindings",
    "pandas",
    "pyarrow",
)


@dataclasses.dataclass(frozen=True)
class BenchMachine:
    """What it was measured on."""

    cpu: str
    cores: int  # CPUs that this process may use; as many threads run
    real_cores: int  # of them that share their core with no other of them
    quota: float  # CPUs' worth of time that its control group may take; inf: all
    caches: tuple[str, ...]  # of the first CPU, in words
    nodes: int  # NUMA nodes
    memory_gb: float  # that it may use; nan: not told
    vectors: str
    width: int  # float32 lanes of a vector
    gpus: tuple[str, ...]
    no_gpu: str  # why there is none, in one line; "" where there are some
    system: str
    versions: Mapping[str, str]  # package -> version
    code: str  # hash of the package's code: two results of the same code have the same


def usable_cpus() -> int:
    """Threads that can be busy at a time: CPUs that this process may use, and no more than its
    control group allows.
    """
    cpus, limit = len(os.sched_getaffinity(0)), quota()
    return max(1, min(cpus, int(limit + 0.5))) if limit < cpus else cpus


def describe(seconds: float = 0.0) -> BenchMachine:
    """This machine. Starts no work on any device."""
    from ravenjax.engines.cpu import jit
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.store import manifest

    host, allowed = jit.host(), os.sched_getaffinity(0)
    gpus, no_gpu = _gpus()
    return BenchMachine(
        cpu=f"{_cpu_name()} ({host.cpu})",
        cores=len(allowed),
        real_cores=sum(not shared for _, shared in spread(allowed)),
        quota=quota(),
        caches=caches(),
        nodes=len(numa_nodes(allowed)),
        memory_gb=_memory_gb(),
        vectors=host.vectors,
        width=host.width,
        gpus=gpus,
        no_gpu=no_gpu,
        system=(
            f"{platform.system()} {platform.release()} {platform.machine()}, Python"
            f" {platform.python_version()}"
        ),
        versions=_versions(),
        code=manifest.code_hash(ROBOT),
    )


def spread(allowed: Iterable[int], cpus: Path = CPUS) -> list[tuple[int, bool]]:
    """The allowed CPUs in the order in which to use them, and whether each shares its core with an
    earlier one.

    First one of each real core, node by node, then their hyper-threads in the same order.
    """
    ordered = [cpu for node in numa_nodes(allowed) for cpu in node]
    first, second, cores = [], [], set[str]()
    for cpu in ordered:
        core = _text(cpus / f"cpu{cpu}/topology/thread_siblings_list") or str(cpu)
        (second if core in cores else first).append(cpu)
        cores.add(core)
    return [(cpu, False) for cpu in first] + [(cpu, True) for cpu in second]


def quota(groups: Path = GROUPS, own: Path = OWN_GROUPS) -> float:
    """CPUs' worth of time that the control groups of this process allow; inf where they set no
    limit.
    """
    limits = [float("inf")]
    for folder in _folders(groups, own, "cpu"):
        with contextlib.suppress(ValueError, ZeroDivisionError):
            words = _text(folder / "cpu.max").split() or [
                _text(folder / "cpu.cfs_quota_us"),
                _text(folder / "cpu.cfs_period_us"),
            ]
            share = (
                float(words[0]) / float(words[1]) if words[0] not in ("max", "") else float("inf")
            )
            limits.append(share if share > 0.0 else float("inf"))
    return min(limits)


def caches(cpus: Path = CPUS) -> tuple[str, ...]:
    """Those of the first CPU: "L2 2048K", and of how many CPUs where it is not its alone."""
    lines = []
    for folder in sorted(cpus.glob("cpu0/cache/index[0-9]*")):
        level, kind, size = (_text(folder / name) for name in ("level", "type", "size"))
        sharing = _count(_text(folder / "shared_cpu_list"))
        if level and kind != "Instruction":
            lines.append(f"L{level} {size}" + (f" for {sharing} CPUs" if sharing > 1 else ""))
    return tuple(lines)


def _memory_gb() -> float:
    try:
        limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9]
    except (ValueError, OSError):
        return float("nan")
    for folder in _folders(GROUPS, OWN_GROUPS, "memory"):
        for name in ("memory.max", "memory.limit_in_bytes"):
            if (text := _text(folder / name)).isdecimal():
                limits.append(int(text) / 1e9)
    return min(limits)


def _folders(groups: Path, own: Path, controller: str) -> list[Path]:
    """Folders of this process's group and of those above it, of both versions; a container's own
    is the top.
    """
    folders = [groups, groups / controller]
    for line in _text(own).splitlines():
        _, controllers, path = (line.split(":", 2) + ["", ""])[:3]
        if controllers in ("", controller) or controller in controllers.split(","):
            top = groups / controller if controllers else groups
            steps = Path(path.lstrip("/")).parts
            folders += [top.joinpath(*steps[:number]) for number in range(1, len(steps) + 1)]
    return folders


def _gpus() -> tuple[tuple[str, ...], str]:
    from ravenjax.engines.gpu import device as cuda_device

    try:
        cuda_device.require()
        return (
            tuple(
                f"{one.name}, {one.multiprocessors} multiprocessors"
                for one in cuda_device.devices()
            ),
            "",
        )
    except UserError as error:
        return (), str(error)


def _versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[package] = importlib.metadata.version(package)
    return versions


def _cpu_name() -> str:
    lines = _text(Path("/proc/cpuinfo")).splitlines()
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "CPU"
    )


def _text(path: Path) -> str:
    """What a file says; "" where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def _count(text: str) -> int:
    """CPUs of a list as the kernel writes it: 0-3,8."""
    ranges: list[Sequence[str]] = [part.split("-") for part in text.split(",") if part]
    return sum(int(ends[-1]) - int(ends[0]) + 1 for ends in ranges)
