"""Selects the engine: by name, or the fastest that this machine supports."""

import os
from collections.abc import MutableMapping

from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError, suggest_name
from ravenjax.numbers.setup import Precision

ENGINES = ("cuda", "simd", "xla", "mjx")
"""Names of the engines, fastest first."""
SMALL_TICKS = 12_000_000
"""Ticks for each CPU core below which "auto" selects engine simd.

Engine simd computes this number in about two seconds. Engine cuda takes longer to start.
"""


def select_engine(
    name: str,
    precision: Precision,
    objects: MutableMapping[str, bytes] | None = None,
    ticks: int | None = None,
) -> Engine:
    """Return the engine of that name; "auto": this machine's fastest with this precision.

    objects: cache of compiled code that several processes share; None: no such cache. ticks: number
    of ticks of all runs; None: unknown, treated as a large campaign. Raises UserError.
    """
    if name == "auto":
        name = fastest_engine(precision, ticks)[0]
    if name == "cuda":
        from ravenjax.engines.gpu.engine import CudaEngine

        return CudaEngine(objects)
    if name == "simd":
        from ravenjax.engines.cpu.engine import SimdEngine

        return SimdEngine(objects)
    if name in ENGINES:
        from ravenjax.engines.xla import ScanEngine

        return ScanEngine(name)
    raise UserError(
        f"engine {name!r} is unknown: expected auto,"
        f" {', '.join(ENGINES)}{suggest_name(name, ENGINES)}"
    )


def fastest_engine(precision: Precision, ticks: int | None = None) -> tuple[str, str]:
    """Return the engine that "auto" selects, and the reason against "cuda" ("" if it is "cuda")."""
    if ticks is not None and ticks < SMALL_TICKS * len(os.sched_getaffinity(0)):
        return "simd", "this campaign is so small that engine simd ends before a GPU could start"
    from ravenjax.engines.gpu import device as cuda_device
    from ravenjax.engines.gpu import engine as cuda

    try:
        cuda.require_float32(precision)
        cuda_device.require_gpu()
    except UserError as error:
        return "simd", str(error)
    return "cuda", ""
