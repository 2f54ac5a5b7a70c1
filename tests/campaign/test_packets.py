"""Packets whose length is drawn: what a campaign file may say of them, and what runs make of
them.
"""

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.robots.raven2.campaign.program import PACKET_KEY
from ravenjax.vocabulary import packets

FAULT = fault("usb_out", "shoulder", "offset", [2000, 14000], 250)
TICKS = 400


def tables(**campaign) -> dict:
    return {
        "campaign": {"name": "x", "duration_s": TICKS / 1e3, **campaign},
        "operator": {"motion": "reach"},
        "group": [{"name": "free"}, {"name": "a", "fault": [{**FAULT, "duration_ms": 32}]}],
    }


def planned(**campaign) -> plan.Plan:
    return plan.make_plan(rj.load_campaign(tables(**campaign)))


def traced(ready: plan.Plan, row: int, engine=None):
    """Signals of a run: arrays [ticks]."""
    varied, harmless = ready.lanes([row], 1, harmless=True)
    _, faults = ready.lanes([row], 1)
    blocks = Block(varied, harmless, None), Block(varied, faults, None)
    return (engine or SimdEngine()).tracer(ready.program, 1).run(*blocks, ready.columns)[2]


@pytest.fixture(scope="module")
def bursts():
    return planned(packets="bursts")


@pytest.mark.slow
def test_every_run_draws_its_own_packets_and_shares_them_with_its_golden_run(bursts):
    keys = bursts.varied[PACKET_KEY]
    assert keys.dtype == np.uint32 and len(set(keys.tolist())) == 3
    assert bursts.golden.tolist() == [0, 1, 2]
    received = [traced(bursts, row).packet.received for row in (1, 2)]
    assert (received[0] != received[1]).any(), "another run has other packets"
    varied, harmless = bursts.lanes([2], 1, harmless=True)
    alone = Block(varied, harmless, None)
    golden = SimdEngine().tracer(bursts.program, 1).run(alone, alone, bursts.columns)
    np.testing.assert_array_equal(golden[2].packet.received, received[1])


@pytest.mark.parametrize("console", ["increments", "absolute"])
def test_no_motion_is_lost_or_doubled(console):
    """Each packet has the hand's place at its tick: as a sum of increments, or as it is."""
    ready = planned(packets="bursts", console=console, duration_s=1.2)
    packet = traced(ready, 0).packet
    fresh = np.flatnonzero(packet.received)
    assert np.diff(fresh).max() > 6 and len(fresh) < 600
    assert packet.sequence[fresh].tolist() == list(range(1, len(fresh) + 1))
    scale = float(ready.program.params.operator.scale)
    place = np.stack([ready.columns[i] for i in range(3)], axis=1)[
        np.minimum(fresh, len(ready.columns[0]) - 1)
    ]
    sent = np.stack([packet.delta[0][i][fresh] for i in range(3)], axis=1)
    if console == "increments":
        down = packet.surgeon_mode[fresh] != 0
        first = int(np.argmax(down)) - 1  # what hands do with the pedal up is not sent
        whole = np.trunc(np.float32(place) * np.float32(scale)).astype(int)
        np.testing.assert_array_equal(np.cumsum(sent, axis=0)[first:], whole[first:] - whole[first])
        assert np.abs(whole[-1] - whole[first]).max() > 50
    else:
        every = planned(console=console, duration_s=1.2)
        same = traced(every, 0).packet
        for i in range(3):
            np.testing.assert_array_equal(packet.delta[0][i][fresh], same.delta[0][i][fresh])


def test_where_every_packet_lasts_one_cycle_the_bits_are_those_without_a_clock():
    results = [
        rj.run(rj.load_campaign(tables(packets=value))) for value in ("every_cycle", [1.0, 0.0])
    ]
    for name in results[0].columns.drop("run_id"):
        assert results[0][name].equals(results[1][name]), name


def test_pairs_have_the_same_packets_but_for_their_distribution():
    raw = tables() | {"cross": {"network.packets": [0, 1, 2]}}
    ready = plan.make_plan(rj.load_campaign(raw))
    assert ready.program.setup.packets[:3] == packets.SHARES
    assert len(ready.rows) == 9 and len(set(ready.varied[PACKET_KEY].tolist())) == 3
    shares = {}
    for choice in range(3):
        row = int(np.flatnonzero(ready.varied["network.packets"] == choice)[0])
        shares[choice] = traced(ready, row).packet.received.mean()
    assert (
        shares[0] == 1.0 and shares[1] == pytest.approx(0.49, abs=0.03) and 0.2 < shares[2] < 0.45
    )


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    raw = tables(packets="bursts", duration_s=0.06)
    raw["group"][1]["fault"] = [{**FAULT, "start_ms": 20, "duration_ms": 30}]
    check_engines(plan.make_plan(loading.from_dict(raw)), 3)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([0.5, 0.4], "whose sum is 0.9, expected shares of packets that last 1, 2, 3, .. cycles"),
        ([], "got 0 shares, expected 1 to 32"),
    ],
)
def test_what_is_no_distribution_is_refused(value, words):
    with pytest.raises(UserError) as error:
        loading.from_dict(tables(packets=value))
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"parameters": {"network.cycles_per_packet": 2}},
            "has no effect where the lengths of packets are drawn: remove",
        ),
        ({"parameters": {"network.packets": 3}}, "which selects the shares in campaign.packets"),
    ],
)
def test_what_does_not_go_with_drawn_packets_is_refused(changes, words):
    with pytest.raises(UserError) as error:
        loading.from_dict(tables(packets="measured") | changes)
    assert words in str(error.value)
