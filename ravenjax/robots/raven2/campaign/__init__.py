"""What a campaign file may say of a Raven-II, and what a campaign asks of it; see
`ravenjax.campaign.prepared`.

Names are imported when they are first used: a file is read and checked without the tick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ravenjax.robots.raven2.campaign.config import RavenConfig as Config
    from ravenjax.robots.raven2.campaign.golden_comparison import explained
    from ravenjax.robots.raven2.campaign.operation import phases
    from ravenjax.robots.raven2.campaign.pedal import clocks
    from ravenjax.robots.raven2.campaign.program import prepare
    from ravenjax.robots.raven2.campaign.trace import bases, series
    from ravenjax.robots.raven2.campaign.watching import watched
    from ravenjax.robots.raven2.loop.records import TickParams as Params

_HOMES = {
    "Config": ("ravenjax.robots.raven2.campaign.config", "RavenConfig"),
    "Params": ("ravenjax.robots.raven2.loop.records", "TickParams"),
    "bases": ("ravenjax.robots.raven2.campaign.trace", "bases"),
    "clocks": ("ravenjax.robots.raven2.campaign.pedal", "clocks"),
    "phases": ("ravenjax.robots.raven2.campaign.operation", "phases"),
    "explained": ("ravenjax.robots.raven2.campaign.golden_comparison", "explained"),
    "prepare": ("ravenjax.robots.raven2.campaign.program", "prepare"),
    "series": ("ravenjax.robots.raven2.campaign.trace", "series"),
    "watched": ("ravenjax.robots.raven2.campaign.watching", "watched"),
}

__all__ = [
    "Config",
    "Params",
    "bases",
    "clocks",
    "explained",
    "phases",
    "prepare",
    "series",
    "watched",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, own = _HOMES[name]
    return getattr(importlib.import_module(module), own)
