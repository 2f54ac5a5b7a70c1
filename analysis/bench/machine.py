"""Describes the machine of a benchmark: CPUs, GPUs and versions."""

import contextlib
import importlib.metadata
import os
import platform
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import joblib

from ravenjax.errors import UserError

CPUS = Path("/sys/devices/system/cpu")
PACKAGES = ("ravenjax", "jax", "jaxlib", "numpy", "llvmlite", "mujoco", "pandas", "pyarrow")


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
        "cpu": f"{host.cpu}, {host.vectors} ({host.width} float32)",
        "cores": len(order),
        "real_cores": sum(not shared for _, shared in order),
        "usable_cpus": joblib.cpu_count(),
        "memory_gb": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9,
        "gpus": gpus,
        "no_gpu": no_gpu,
        "system": f"{platform.platform()}, Python {platform.python_version()}",
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
        "code": manifest.code_hash(ROBOT)[:12],
    }


def order_cpus(allowed: Iterable[int], cpus: Path = CPUS) -> list[tuple[int, bool]]:
    """Return the allowed CPUs, first one of each real core, and whether each shares its core."""
    first, second, cores = [], [], set[str]()
    for cpu in sorted(allowed):
        core = str(cpu)
        with contextlib.suppress(OSError):
            core = (cpus / f"cpu{cpu}/topology/thread_siblings_list").read_text().strip()
        (second if core in cores else first).append(cpu)
        cores.add(core)
    return [(cpu, False) for cpu in first] + [(cpu, True) for cpu in second]
