"""Records the largest forces of a run's instruments on tissue, on the vessel and on each other."""

from typing import Any

from ravenjax.numbers import Scalar, Setup, cast_to_real, jnp, record
from ravenjax.vocabulary import TICK_S


@record
class TouchState:
    """The contact of all instruments of a run so far."""

    peak: Scalar  # N, largest force of tissue and vessel on one instrument so far
    impulse: Scalar  # N s, impulse of tissue and vessel on all instruments
    vessel: Scalar  # N, largest force of the vessel on one instrument
    instrument: Scalar  # N, largest force between two instruments


def init(setup: Setup) -> TouchState:
    """Return the state before the first tick, without any contact."""
    zero = cast_to_real(setup, jnp.float32(0.0))
    return TouchState(peak=zero, impulse=zero, vessel=zero, instrument=zero)


def step(state: TouchState, instruments: tuple[Any, ...]) -> TouchState:
    """Return the state after a tick. instruments: for each instrument the forces on it, N: `tissue`
    (with the vessel), `vessel` and `instrument` (of the other instrument).
    """
    peak, impulse, vessel = state.peak, state.impulse, state.vessel
    for instrument in instruments:
        peak = jnp.maximum(peak, instrument.tissue)
        impulse = impulse + instrument.tissue * TICK_S
        vessel = jnp.maximum(vessel, instrument.vessel)
    # The force between two instruments is the same on both.
    between = jnp.maximum(state.instrument, instruments[0].instrument)
    return TouchState(peak, impulse, vessel, between)


def outcomes(setup: Setup, state: TouchState) -> dict[str, Scalar]:
    """Return the outcome columns of a run, N and N s."""
    columns = {
        "contact_peak_n": state.peak,
        "contact_impulse_n_s": state.impulse,
        "contact_vessel_peak_n": state.vessel,
    }
    if len(setup.arms) > 1:
        columns["contact_instruments_peak_n"] = state.instrument
    return columns
