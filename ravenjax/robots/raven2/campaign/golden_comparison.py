"""A campaign's program with the observer of `loop.explained` in it, and the normal ranges that
it looks for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from ravenjax.engines.interface import TickProgram
from ravenjax.hazards import ranges
from ravenjax.robots.raven2.loop import explained as loop
from ravenjax.vocabulary.seams import Crossing

ROUNDED = 5e-6
"""Ranges are written with six digits: an end is so much of itself farther out, lest it exclude
what was measured.
"""


def explained(program: TickProgram) -> TickProgram:
    """The same runs, each compared with its golden run number by number."""
    setup = dataclasses.replace(program.setup, explained=spans(loop.listing(program.setup)))
    return dataclasses.replace(program, module=loop.__name__, setup=setup)


def spans(places: Iterable[Crossing]) -> tuple[tuple[float, float] | None, ...]:
    """Normal range of each number in its unit, None where nobody measured one."""
    return tuple(_span(place) for place in places)


def _span(place: Crossing) -> tuple[float, float] | None:
    if not place.channel.site:
        return None
    usual = ranges.normal(place.channel.site, place.channel.name, place.arm)
    return usual.low - ROUNDED * abs(usual.low), usual.high + ROUNDED * abs(usual.high)
