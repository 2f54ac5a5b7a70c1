"""Adds an observer to a campaign's program: detector signals, or the comparison with the golden
run.
"""

from __future__ import annotations

import dataclasses

from ravenjax.engines.interface import TickProgram
from ravenjax.hazards import ranges
from ravenjax.robots.raven2.loop import explained as explained_loop
from ravenjax.robots.raven2.loop import watched as watched_loop
from ravenjax.vocabulary.seams import Crossing

ROUNDED = 5e-6
"""Relative margin by which each end of a range is widened.

Ranges are written with six digits; without the margin an end could exclude a measured value.
"""


def watch_signals(program: TickProgram) -> TickProgram:
    """Return a program of the same runs that outputs only the signals of their detectors."""
    return dataclasses.replace(program, module=watched_loop.__name__)


def explain_program(program: TickProgram) -> TickProgram:
    """Return a program of the same runs, each compared with its golden run number by number."""
    spans = tuple(normal_range(place) for place in explained_loop.list_numbers(program.setup))
    setup = dataclasses.replace(program.setup, explained=spans)
    return dataclasses.replace(program, module=explained_loop.__name__, setup=setup)


def normal_range(place: Crossing) -> tuple[float, float] | None:
    """Return the normal range of a number in its unit, None if no range was measured."""
    if not place.channel.site:
        return None
    usual = ranges.normal_range(place.channel.site, place.channel.name, place.arm)
    return usual.low - ROUNDED * abs(usual.low), usual.high + ROUNDED * abs(usual.high)
