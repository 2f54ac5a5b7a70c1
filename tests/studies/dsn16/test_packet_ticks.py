"""When packets come, beside what runs receive; windows and levers in packets."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.vocabulary import packets
from studies.dsn16 import attacks
from studies.study import read_variants

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


@pytest.mark.parametrize("cycles", [1, 2])
def test_regular_packets_are_rows_of_the_motion_however_long_they_last(cycles):
    ticks = attacks.regular(2, 10, cycles)
    assert ticks.ticks.shape == (2, 10 // cycles)
    number = np.array([1, 3])
    np.testing.assert_array_equal(ticks.packet(np.zeros(2, int), (number - 1) * cycles), number)
    assert ticks.packet(np.array([1]), np.array([2 * cycles - 1])).tolist() == [2]
    assert ticks.motion_row(np.zeros(2, int), number).tolist() == [0, 2]


@pytest.mark.slow
@pytest.mark.parametrize("campaign", ["dsn16_a.toml", "dsn16_b.toml"])
def test_runs_are_long_enough_for_their_last_fault(campaign):
    """Longest window of the latest onset, in every run's own packets, and the time that the
    first baseline left.
    """
    lengths = ("baseline", "every_cycle", "one_or_two", "bursts", "slow_replay")
    variants = read_variants(campaign.removesuffix(".toml"))
    for overrides in (one.overrides for one in variants if one.name in lengths):
        ready = plan.make_plan(loading.load(campaign, list(overrides)))
        table = ready.table[ready.table["fault0_site"] != ""]
        last = int((table["fault0_start_ms"] + table["fault0_duration_ms"]).max())
        ticks = attacks.packet_ticks_of(ready).ticks
        assert ticks.shape[1] > last
        ends = ticks[:, last - 1]
        assert ends.max() + 500 < ready.config.campaign.ticks, overrides


def test_the_hand_keeps_its_speed():
    """Packet 1000 of two cycles is of the hand 1.9 s into its motion; with a packet each cycle
    it is at 1 s.
    """
    config = loading.load("dsn16_b.toml")
    ready = plan.make_plan(config)
    ticks = attacks.packet_ticks_of(ready)
    rows = ticks.motion_row(np.arange(ready.runs), np.full(ready.runs, 1000))
    assert rows.mean() == pytest.approx(
        999 * packets.mean(packets.SHARES[packets.MEASURED]), rel=2e-3
    )
    slow = attacks.packet_ticks_of(
        plan.make_plan(loading.load("dsn16_b.toml", ["campaign.packets=every_cycle"]))
    )
    assert slow.motion_row(np.array([5]), np.array([1000])).tolist() == [999]
    assert attacks.lever(config, rows).low > 0
