"""Which engine runs: by name, or the best that this machine has."""

from __future__ import annotations

from collections.abc import MutableMapping

from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError, suggestion

ENGINES = ("simd", "xla", "mjx")
"""On a CPU, fastest first."""


def select(name: str = "auto", objects: MutableMapping[str, bytes] | None = None) -> Engine:
    """The engine of that name; "auto" takes the fastest there is. Raises UserError for an unknown name.

    objects: where compiled code is kept between processes; None keeps it in this one.
    """
    if name == "auto":
        name = ENGINES[0]
    if name == "simd":
        from ravenjax.engines.simd import SimdEngine

        return SimdEngine(objects)
    if name in ENGINES:
        from ravenjax.engines.scan import ScanEngine

        return ScanEngine(name)
    raise UserError(f"engine {name!r} is unknown: expected auto, {', '.join(ENGINES)}{suggestion(name, ENGINES)}")
