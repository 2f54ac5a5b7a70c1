"""The Raven-II's sections of a campaign file, and what a campaign needs from the robot.

See `ravenjax.campaign.prepared`. Names are imported when they are first used, so a file can be read
and checked without the tick.
"""

import pkgutil
from typing import Any

_HOMES = {
    "Config": "campaign.config:RavenConfig",
    "Params": "loop.records:TickParams",
    "acted": "campaign.program:add_action",
    "bases": "campaign.trace:arm_bases",
    "clocks": "campaign.pedal:trigger_clocks",
    "describe_figure": "campaign.figure:describe_figure",
    "more_series": "campaign.trace:more_series",
    "phases": "campaign.operation:phase_intervals",
    "prepare": "campaign.program:prepare_campaign",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return pkgutil.resolve_name(f"ravenjax.robots.raven2.{_HOMES[name]}")
