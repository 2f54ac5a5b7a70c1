"""The same runs with signals of their detectors alone."""

from __future__ import annotations

import dataclasses

from ravenjax.engines.interface import TickProgram
from ravenjax.robots.raven2.loop import watched as loop


def watched(program: TickProgram) -> TickProgram:
    """See `ravenjax.campaign.prepared`."""
    return dataclasses.replace(program, module=loop.__name__)
