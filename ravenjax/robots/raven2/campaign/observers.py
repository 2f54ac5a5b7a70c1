"""A campaign's program with an observer in its loop: signals of detectors, or the comparison with
the golden run.
"""

from __future__ import annotations

import dataclasses

from ravenjax.engines.interface import TickProgram
from ravenjax.hazards import ranges
from ravenjax.robots.raven2.loop import explained as explained_loop
from ravenjax.robots.raven2.loop import watched as watched_loop
from ravenjax.vocabulary.seams import Crossing

ROUNDED = 5e-6
"""Ranges are written with six digits: an end is so much of itself farther out, lest it exclude
what was measured.
"""


def watched(program: TickProgram) -> TickProgram:
    """The same runs with signals of their detectors alone."""
    return dataclasses.replace(program, module=watched_loop.__name__)


def explained(program: TickProgram) -> TickProgram:
    """The same runs, each compared with its golden run number by number."""
    spans = tuple(normal_range(place) for place in explained_loop.listing(program.setup))
    setup = dataclasses.replace(program.setup, explained=spans)
    return dataclasses.replace(program, module=explained_loop.__name__, setup=setup)


def normal_range(place: Crossing) -> tuple[float, float] | None:
    """Normal range of a number in its unit, None where nobody measured one."""
    if not place.channel.site:
        return None
    usual = ranges.normal(place.channel.site, place.channel.name, place.arm)
    return usual.low - ROUNDED * abs(usual.low), usual.high + ROUNDED * abs(usual.high)
