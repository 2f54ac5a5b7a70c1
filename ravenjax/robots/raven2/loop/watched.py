"""Returns the state of a run's detectors as signals.

This module is a `Loop` of `ravenjax.engines.interface`: the loop of `run` with other signals.
"""

from typing import Any

from ravenjax.numbers import Scalar, record
from ravenjax.robots.raven2.loop import observers, run
from ravenjax.robots.raven2.loop.records import TickParams, TickState
from ravenjax.robots.raven2.loop.run import init, outcomes, series_length
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages.detectors import DetectorsState

__all__ = ["advance", "init", "outcomes", "series_length"]


@record
class WatchedSignals:
    """The detectors' state after a tick."""

    detectors: DetectorsState
    live: Scalar  # bool, whether the detectors were armed, ignoring `armed_after`


def advance(
    setup: RavenSetup, params: TickParams, faults: Any, state: TickState, *inputs: Any
) -> tuple[TickState, tuple[Scalar, ...], WatchedSignals]:
    """Compute one tick; see `ravenjax.engines.interface.Loop`."""
    state, series, signals = run.advance(setup, params, faults, state, *inputs)
    live = observers.is_live(signals.control.runlevel, state.control.state_machine.soft_estopped)
    return state, series, WatchedSignals(state.stages["detectors"], live)
