"""A restart counts if the foot stayed on the pedal since the stop."""

from types import SimpleNamespace

import pytest

from ravenjax.numbers.lazy import run_eagerly
from ravenjax.robots.raven2.loop.optional import STAGES, RestartState


@pytest.mark.parametrize(
    ("foot", "soft", "first"),
    [("11111", "00000", 4), ("11011", "00000", -1), ("11111", "11000", 4), ("00111", "00000", -1)],
)
def test_only_a_foot_that_never_left_the_pedal_restarts(foot, soft, first):
    state = RestartState(False, -1)
    for tick, level in enumerate((3, 0, 1, 2, 3)):
        stops = soft[tick] == "1"
        control = SimpleNamespace(runlevel=level, soft_estopped=int(stops))
        sight = SimpleNamespace(
            tick=tick,
            foot_on_pedal=foot[tick] == "1",
            live=level == 3 and not stops,
            signals=SimpleNamespace(control=control),
        )
        with run_eagerly():
            state = STAGES["restart"].watch(state, sight)
    assert state.restart_tick == first
