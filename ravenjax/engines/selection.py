"""Which engine runs: by name, or the best that this machine has."""

from __future__ import annotations

from collections.abc import MutableMapping

from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError, suggestion
from ravenjax.numbers.setup import Precision

ENGINES = ("cuda", "simd", "xla", "mjx")
"""Fastest first."""


def select(
    name: str, precision: Precision, objects: MutableMapping[str, bytes] | None = None
) -> Engine:
    """The engine of that name; "auto" takes the fastest that computes in this precision here.
    Raises UserError.

    objects: where compiled code is kept between processes; None keeps it in this one.
    """
    if name == "auto":
        name = fastest(precision)[0]
    if name == "cuda":
        from ravenjax.engines.gpu.engine import CudaEngine

        return CudaEngine(objects)
    if name == "simd":
        from ravenjax.engines.cpu.engine import SimdEngine

        return SimdEngine(objects)
    if name in ENGINES:
        from ravenjax.engines.xla.engine import ScanEngine

        return ScanEngine(name)
    raise UserError(
        f"engine {name!r} is unknown: expected auto,"
        f" {', '.join(ENGINES)}{suggestion(name, ENGINES)}"
    )


def fastest(precision: Precision) -> tuple[str, str]:
    """The engine that "auto" means on this machine, and in one line why it is not "cuda", empty
    if it is.
    """
    from ravenjax.engines.gpu import device as cuda_device
    from ravenjax.engines.gpu import engine as cuda

    try:
        cuda.require_float32(precision)
        cuda_device.require()
    except UserError as error:
        return "simd", str(error)
    return "cuda", ""
