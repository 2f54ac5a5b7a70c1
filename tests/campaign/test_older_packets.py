"""Packets that the network delivers late or again, where each lasts a number of cycles that is
drawn.

What reaches the robot is compared with the packets of the golden run, which draws the same lengths:
the n-th packet, k packets late, must be the (n - k)-th one with all its numbers.
"""

import jax
import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines

from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.stages import channel

TICKS, START, SEED = 1000, 600, 0.5
LATE, AGAIN = (1, 7, 40), (1, 20)
MEASURED, BURSTS = 1, 2
NUMBERS = ("sequence", "delta", "quat", "grasp", "surgeon_mode")


def group(name: str, **fault) -> dict:
    return {"name": name, "fault": [{"site": "network", "start_ms": START, **fault}]}


def tables(*groups: dict, **campaign) -> dict:
    campaign = {"name": "x", "duration_s": TICKS / 1e3, **campaign}
    return {"campaign": campaign, "operator": {"motion": "circle"}, "group": list(groups)}


def planned(*groups: dict, **campaign) -> plan.Plan:
    return plan.make_plan(loading.from_dict(tables(*groups, **campaign)))


FAULTS = (
    group("late", channel="delay", effect="overwrite", value=list(LATE)),
    group("again", channel="lag", effect="overwrite", value=list(AGAIN)),
    group("jitter", channel="jitter", effect="overwrite", value=SEED),
)


def packet(tracer, ready: plan.Plan, row: int, struck: bool):
    """The packet as it reaches the robot in each tick of a run, or of its golden run."""
    varied, harmless = ready.lanes([row], 1, harmless=True)
    _, faults = ready.lanes([row], 1, harmless=not struck)
    return tracer.run(Block(varied, harmless, None), Block(varied, faults, None), ready.columns)[
        2
    ].packet


class Packets:
    """Packets of a run, one a tick, and those of its golden run."""

    def __init__(self, ready: plan.Plan, tracer, row: int) -> None:
        self.sent, self.got = (packet(tracer, ready, row, struck) for struck in (False, True))
        self.ticks = np.flatnonzero(self.sent.received)  # of packet 0, 1, ..
        # Packets that are sent while the fault lasts.
        self.struck = np.flatnonzero(self.ticks >= START)

    def numbers(self, of, ticks) -> np.ndarray:
        """What packets say, [ticks, numbers]."""
        leaves = jax.tree.leaves([getattr(of, name) for name in NUMBERS])
        return np.stack([np.asarray(leaf, float)[ticks] for leaf in leaves], axis=1)


@pytest.fixture(scope="module")
def packets_of():
    """Packets by group, distribution and place in the group."""
    ready = plan.make_plan(
        loading.from_dict(tables(*FAULTS) | {"cross": {"network.packets": [MEASURED, BURSTS]}})
    )
    tracer = SimdEngine().tracer(ready.program, 1)

    def of(name: str, choice: int, place: int = 0) -> Packets:
        rows = np.flatnonzero(
            (ready.rows["group"] == name) & (ready.varied["network.packets"] == choice)
        )
        return Packets(ready, tracer, rows[place])

    return of


@pytest.mark.parametrize("choice", [MEASURED, BURSTS])
@pytest.mark.parametrize("place", range(len(LATE)))
def test_a_delay_of_k_packets_delivers_the_packet_of_k_before(packets_of, choice, place):
    packets, late = packets_of("late", choice, place), LATE[place]
    n = packets.struck
    arrived = packets.got.received[packets.ticks[n]] != 0
    # What was there before does not come again.
    np.testing.assert_array_equal(arrived, n - late >= n[0])
    n = n[arrived]
    assert len(n) > 20
    old = packets.numbers(packets.sent, packets.ticks[n - late])
    np.testing.assert_array_equal(packets.numbers(packets.got, packets.ticks[n]), old)
    assert len(np.unique(old[:, 1:4], axis=0)) > 3  # the hand moves


@pytest.mark.parametrize("choice", [MEASURED, BURSTS])
@pytest.mark.parametrize("place", range(len(AGAIN)))
def test_a_packet_that_is_sent_again_is_the_same_packet(packets_of, choice, place):
    packets, lag = packets_of("again", choice, place), AGAIN[place]
    n = packets.struck
    assert (packets.got.received[packets.ticks[n]] == (n >= lag)).all()
    n = n[n >= lag]
    old = packets.numbers(packets.sent, packets.ticks[n - lag])
    np.testing.assert_array_equal(packets.numbers(packets.got, packets.ticks[n]), old)


@pytest.mark.parametrize("choice", [MEASURED, BURSTS])
def test_a_packet_that_arrives_late_is_the_newest_that_is_old_enough(packets_of, choice):
    packets = packets_of("jitter", choice)
    newest, arrivals = packets.struck[0] - 1, 0
    delays = np.asarray(
        jax.vmap(lambda n: channel.delay_ms(np.float32(SEED), n))(packets.struck.astype(np.int32))
    )
    for n, delay in zip(packets.struck, delays, strict=True):
        now = packets.ticks[n]
        old_enough = np.flatnonzero(packets.ticks <= now - delay)
        arrives = len(old_enough) > 0 and old_enough[-1] > newest
        assert bool(packets.got.received[now]) == arrives
        if arrives:
            newest, arrivals = old_enough[-1], arrivals + 1
            old = packets.numbers(packets.sent, packets.ticks[[newest]])
            np.testing.assert_array_equal(packets.numbers(packets.got, [now]), old)
    assert arrivals > 3


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    late = {
        "site": "network",
        "channel": "delay",
        "effect": "overwrite",
        "value": 5,
        "start_ms": 20,
    }
    check_engines(
        planned({"name": "late", "fault": [late]}, packets="measured", duration_s=0.06), 1
    )


def test_a_history_that_is_too_long_is_refused():
    fault = group("g", channel="delay", effect="overwrite", value=3000)
    assert planned(fault, packets="measured").program.setup.packet_history == TICKS
    with pytest.raises(UserError) as error:
        planned(fault, packets="measured", duration_s=20.0)
    assert "may send packets that are 12008 ms old, expected at most 8192" in str(error.value)
    loading.from_dict(tables(fault, duration_s=20.0))
