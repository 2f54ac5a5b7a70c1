"""Describes the machine of a benchmark: CPUs, the limit of its control group, GPUs, versions."""

import importlib.metadata
import math
import os
import platform
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError

CPUS = Path("/sys/devices/system/cpu")
GROUPS, OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
PACKAGES = ("ravenjax", "jax", "jaxlib", "numpy", "llvmlite", "mujoco", "pandas", "pyarrow")


def count_usable_cpus() -> int:
    """Return the number of threads that can be busy at a time: CPUs that this process may use,
    limited by its control group.
    """
    cpus, limit = len(os.sched_getaffinity(0)), read_quota()
    return max(1, min(cpus, int(limit + 0.5))) if limit < cpus else cpus


def describe() -> dict[str, Any]:
    """Describe this machine. Starts no work on any device."""
    from ravenjax.engines.cpu import jit
    from ravenjax.engines.gpu import device as cuda_device
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.store import manifest

    host, order = jit.host_target(), order_cpus(os.sched_getaffinity(0))
    no_gpu, gpus = "", []
    try:
        cuda_device.require_gpu()
        gpus = [
            f"{g.name}, {g.multiprocessors} multiprocessors" for g in cuda_device.visible_gpus()
        ]
    except UserError as error:
        no_gpu = str(error)
    return {
        "cpu": f"{_cpu_name()} ({host.cpu}), {host.vectors} ({host.width} float32)",
        "cores": len(order),
        "real_cores": sum(not shared for _, shared in order),
        "usable_cpus": count_usable_cpus(),
        "memory_gb": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9,
        "gpus": gpus,
        "no_gpu": no_gpu,
        "system": f"{platform.platform()}, Python {platform.python_version()}",
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
        # Equal for two results of the same code.
        "code": manifest.code_hash(ROBOT)[:12],
    }


def order_cpus(allowed: Iterable[int], cpus: Path = CPUS) -> list[tuple[int, bool]]:
    """Return the allowed CPUs in the order of use: first one of each real core, then their
    hyper-threads.

    Each comes with whether it shares its core with an earlier one.
    """
    first, second, cores = [], [], set[str]()
    for cpu in sorted(allowed):
        core = _read(cpus / f"cpu{cpu}/topology/thread_siblings_list") or str(cpu)
        (second if core in cores else first).append(cpu)
        cores.add(core)
    return [(cpu, False) for cpu in first] + [(cpu, True) for cpu in second]


def read_quota(groups: Path = GROUPS, own: Path = OWN_GROUP) -> float:
    """Return the CPU time that the control groups of this process allow, in CPUs.

    It is the least of the limits of its own group and of those above it; inf without a limit.
    """
    limits = [math.inf]
    path = next((s[3:] for s in _read(own).splitlines() if s.startswith("0::")), "/")
    group = Path(path.lstrip("/"))
    for folder in [groups / group, *(groups / parent for parent in group.parents)]:
        words = _read(folder / "cpu.max").split()
        if len(words) == 2 and words[0] != "max":
            limits.append(int(words[0]) / int(words[1]))
    return min(limits)


def _cpu_name() -> str:
    lines = _read(Path("/proc/cpuinfo")).splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "CPU")


def _read(path: Path) -> str:
    """Return the content of a file; "" if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return ""
