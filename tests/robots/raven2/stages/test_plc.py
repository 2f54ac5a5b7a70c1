"""The assumed PLC: levels by start, READY, pedal; watchdog and button trips; latch; pins."""

import jax
import jax.numpy as jnp
import pytest

from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import plc

SETUP = RavenSetup()
PARAMS = plc.PlcParams()
STEP = jax.jit(
    lambda state, pins, estop, start: plc.step(
        SETUP, PARAMS, state, plc.PlcSignal(pins, estop, start)
    )
)
READY, PEDAL = 1 << 3, 1 << 2


def watchdog(tick: int) -> int:
    """Pin byte of the software's square wave: 25 ms high, 25 ms low."""
    return (1 << 4) if tick % 50 < 25 else 0


def drive(
    state: plc.PlcState,
    ticks: int,
    pins=READY,
    wave=watchdog,
    estop: bool = False,
    start: bool = False,
    second=None,
) -> tuple[plc.PlcState, list[plc.PlcOutput]]:
    """Ticks of a PLC; `second`: what a second board's byte is where it is not written like the
    first.
    """
    outs = []
    for tick in range(ticks):
        told = [pins | wave(tick)] + ([] if second is None else [second(tick)])
        state, out = STEP(state, tuple(map(jnp.int32, told)), jnp.bool_(estop), jnp.bool_(start))
        outs.append(out)
    return state, outs


def test_power_up_to_pedal_down_and_back() -> None:
    state = plc.init(SETUP, run_levels.E_STOP)
    state, outs = drive(state, 150, pins=0)
    levels = [int(out.runlevel) for out in outs]
    # Start pressed after 100 ms of living watchdog.
    assert levels[:100] == [0] * 100 and levels[-1] == run_levels.INIT
    assert int(outs[0].brakes) == 1 and int(outs[-1].brakes) == 0
    state, outs = drive(state, 1, pins=READY)
    assert int(outs[-1].runlevel) == run_levels.PEDAL_UP and int(outs[-1].brakes) == 1
    state, outs = drive(state, 1, pins=READY | PEDAL)
    assert int(outs[-1].runlevel) == run_levels.PEDAL_DOWN and int(outs[-1].brakes) == 0
    state, outs = drive(state, 1, pins=READY)
    assert int(outs[-1].runlevel) == run_levels.PEDAL_UP
    state, outs = drive(state, 1, pins=PEDAL)  # pedal without READY does not engage
    assert int(outs[-1].runlevel) == run_levels.PEDAL_UP


@pytest.mark.parametrize("level", [0, 16])
def test_a_watchdog_without_edges_trips_after_one_and_a_half_periods(level: int) -> None:
    state, _ = drive(plc.init(SETUP), 100, pins=READY | PEDAL)
    assert int(state.runlevel) == run_levels.PEDAL_DOWN
    # The wave ends low: a high pin is one more edge.
    quiet = int(state.quiet_ticks[0]) if level == 0 else -1
    state, outs = drive(state, 120, pins=READY | PEDAL, wave=lambda _: level)
    levels = [int(out.runlevel) for out in outs]
    assert levels.index(run_levels.E_STOP) == 75 - quiet
    lost = state.watchdog_lost
    assert int(state.trip_cause) == plc.CAUSE_WATCHDOG
    assert (int(lost.first_tick), int(lost.count)) == (100 + 75 - quiet, 1) and float(
        lost.margin
    ) < 0


def test_button_trips_at_once_and_the_trip_latches() -> None:
    state, outs = drive(plc.init(SETUP), 1, estop=True)
    assert int(outs[0].runlevel) == run_levels.E_STOP and int(state.trip_cause) == plc.CAUSE_BUTTON
    state, outs = drive(state, 400)
    assert {int(out.runlevel) for out in outs} == {run_levels.E_STOP}


def test_start_is_obeyed_after_a_trip_and_the_next_trip_counts_again() -> None:
    state, _ = drive(plc.init(SETUP), 10, estop=True)
    state, outs = drive(state, 1, start=True)
    assert int(outs[0].runlevel) == run_levels.INIT and int(state.trip_cause) == plc.CAUSE_NONE
    state, outs = drive(state, 100, pins=READY | PEDAL)
    assert int(outs[-1].runlevel) == run_levels.PEDAL_DOWN
    state, _ = drive(state, 120, pins=READY | PEDAL, wave=lambda _: 0)
    assert int(state.trip_cause) == plc.CAUSE_WATCHDOG and int(state.watchdog_lost.count) == 1


@pytest.mark.parametrize("held", [READY | PEDAL, READY | PEDAL | 16])
def test_the_watchdog_of_every_board_is_missed(held: int) -> None:
    both = lambda tick: READY | PEDAL | watchdog(tick)  # noqa: E731
    state, outs = drive(plc.init(SETUP, boards=2), 300, pins=READY | PEDAL, second=both)
    assert int(outs[-1].runlevel) == run_levels.PEDAL_DOWN
    state, outs = drive(state, 120, pins=READY | PEDAL, second=lambda _: held)
    assert (
        int(outs[-1].runlevel) == run_levels.E_STOP and int(state.trip_cause) == plc.CAUSE_WATCHDOG
    )
