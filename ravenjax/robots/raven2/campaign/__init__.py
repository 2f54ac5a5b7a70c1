"""The Raven-II's sections of a campaign file, and what a campaign needs from the robot.

See `ravenjax.campaign.prepared`. Names are imported when they are first used, so a file can be read
and checked without the tick.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Config": ("campaign.config", "RavenConfig"),
    "Params": ("loop.records", "TickParams"),
    "bases": ("campaign.trace", "bases"),
    "clocks": ("campaign.pedal", "clocks"),
    "explained": ("campaign.observers", "explained"),
    "phases": ("campaign.operation", "phases"),
    "prepare": ("campaign.program", "prepare"),
    "series": ("campaign.trace", "series"),
    "watched": ("campaign.observers", "watched"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(importlib.import_module(f"ravenjax.robots.raven2.{module}"), attribute)
