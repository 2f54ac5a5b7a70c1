"""When packets come: what runs receive, beside what the studies of the attacks read."""

import numpy as np
import pytest

from ravenjax.campaign import loading, plan, runner
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.store.folder import read_all
from studies.series import Recorder

TICKS, START = 300, 60


def received(ready: plan.Plan, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Ticks at which a run gets a packet, and the numbers of these."""
    varied, faults = ready.lanes([row], 1)
    block = Block(varied, faults, None)
    packet = SimdEngine().tracer(ready.program, 1).run(block, block, ready.columns)[2].packet
    fresh = np.flatnonzero(packet.received)
    return fresh, np.asarray(packet.sequence)[fresh]


@pytest.mark.slow
@pytest.mark.parametrize("choice", ["measured", "bursts", (0.2, 0.3, 0.5)])
def test_a_fault_starts_in_the_tick_of_its_packet(choice, tmp_path):
    """The number of the newest packet is the one that the run received last."""
    fault = {"site": "usb_out", "channel": "shoulder", "effect": "offset", "value": 100}
    fault |= {"trigger": "packet", "start_ms": START, "duration_ms": 4}
    raw = {
        "campaign": {"name": "x", "duration_s": TICKS / 1e3, "packets": choice},
        "operator": {"motion": "reach"},
        "group": [{"name": "a", "repeats": 3, "fault": [fault]}],
    }
    config = loading.from_dict(raw)
    runner.run_campaign(config, tmp_path)
    ready, table = plan.make_plan(config), read_all(tmp_path).set_index("index")
    newest = Recorder(("last_seq",)).measure(tmp_path, lambda _, series: series["last_seq"])
    for row in (0, 2):
        fresh, number = received(ready, row)
        assert number.tolist() == list(range(1, len(fresh) + 1))
        assert table.loc[row, "first_active_ms"] == fresh[START - 1]
        expected = np.searchsorted(fresh, np.arange(TICKS), side="right")
        np.testing.assert_array_equal(newest[row], expected)
