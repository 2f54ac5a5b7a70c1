"""Which engine runs: by name, or the best that this machine has."""

from __future__ import annotations

from ravenjax.engines.interface import Engine
from ravenjax.engines.scan import ScanEngine
from ravenjax.errors import UserError, suggestion

ENGINES = ("xla", "mjx")
"""Fastest first."""


def select(name: str = "auto") -> Engine:
    """The engine of that name; "auto" takes the fastest there is. Raises UserError for an unknown name."""
    if name == "auto":
        name = ENGINES[0]
    if name not in ENGINES:
        raise UserError(f"engine {name!r} is unknown: expected auto, {', '.join(ENGINES)}{suggestion(name, ENGINES)}")
    return ScanEngine(name)
