"""When packets come, beside what runs receive; windows and levers in packets."""

import numpy as np
import pytest

from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from studies.dsn16 import attacks

TICKS = 300


def planned(**campaign) -> plan.Plan:
    raw = {
        "campaign": {"name": "x", "duration_s": TICKS / 1e3, **campaign},
        "operator": {"motion": "reach"},
        "group": [{"name": "a", "repeats": 3}] if "packets" in campaign else [{"name": "a"}],
    }
    return plan.make_plan(loading.from_dict(raw))


def received(ready: plan.Plan, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Ticks at which a run gets a packet, and the numbers of these."""
    varied, faults = ready.lanes([row], 1)
    block = Block(varied, faults, None)
    packet = SimdEngine().tracer(ready.program, 1).run(block, block, ready.columns)[2].packet
    fresh = np.flatnonzero(packet.received)
    return fresh, np.asarray(packet.sequence)[fresh]


@pytest.mark.slow
@pytest.mark.parametrize("choice", ["measured", "bursts", (0.2, 0.3, 0.5)])
def test_drawn_packets_are_those_that_runs_receive(choice):
    ready = planned(packets=choice)
    ticks = attacks.packet_ticks_of(ready)
    for row in (0, 2):
        fresh, number = received(ready, row)
        mine = ticks.ticks[row][ticks.ticks[row] < TICKS]
        assert mine.tolist() == fresh.tolist() and number.tolist() == list(range(1, len(fresh) + 1))
        np.testing.assert_array_equal(ticks.packet(np.full(len(fresh), row), fresh), number)
        np.testing.assert_array_equal(ticks.motion_row(np.full(len(fresh), row), number), fresh)
        assert ticks.packet(np.array([row, row]), np.array([-1, fresh[5] - 1])).tolist() == [0, 5]
