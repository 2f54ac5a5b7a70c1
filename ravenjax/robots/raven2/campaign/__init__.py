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
    "bases": ("campaign.trace", "arm_bases"),
    "clocks": ("campaign.pedal", "trigger_clocks"),
    "explained": ("campaign.observers", "explain_program"),
    "phases": ("campaign.operation", "phase_intervals"),
    "prepare": ("campaign.program", "prepare_campaign"),
    "series": ("campaign.trace", "trace_series"),
    "watched": ("campaign.observers", "watch_signals"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(importlib.import_module(f"ravenjax.robots.raven2.{module}"), attribute)
