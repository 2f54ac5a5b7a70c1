"""The Raven-II's sections of a campaign file, and the functions that a campaign calls.

`ravenjax.campaign.prepared` describes these functions. Each name is imported when it is first used,
so a campaign file can be read and checked without an import of the tick's code.
"""

import pkgutil
from typing import Any

# Name in this module -> module and name of its definition
_DEFINITIONS = {
    "Config": "campaign.config:RavenConfig",
    "Params": "loop.optional:Params",
    "acted": "campaign.program:add_action",
    "bases": "campaign.trace:arm_bases",
    "clocks": "campaign.pedal:trigger_clocks",
    "describe_figure": "campaign.figure:describe_figure",
    "more_series": "campaign.trace:more_series",
    "phases": "campaign.operation:phase_intervals",
    "prepare": "campaign.program:prepare_campaign",
}


def __getattr__(name: str) -> Any:
    if name not in _DEFINITIONS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return pkgutil.resolve_name(f"ravenjax.robots.raven2.{_DEFINITIONS[name]}")
