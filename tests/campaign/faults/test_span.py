"""When faults of a run may act first, and when it is no longer observed: by windows that are
opened tick by tick.
"""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign.faults import span
from ravenjax.campaign.faults.table import ARRAYS, FOREVER_TICKS
from ravenjax.faults import fault
from ravenjax.numbers.setup import Injection
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.effects import TRIGGER_CODES

TICKS = 24

SLOT = st.fixed_dictionaries(
    {
        "code": st.integers(0, 1),
        "trigger": st.sampled_from(sorted(TRIGGER_CODES.values())),
        "start": st.integers(0, TICKS + 3),
        "duration": st.sampled_from([1, 2, 7, FOREVER_TICKS]),
        "every": st.sampled_from([0, 0, 9]),
    }
)


def faults_of(slots):
    out = {name: np.zeros((1, len(slots)), dtype) for name, dtype in ARRAYS.items()}
    for s, slot in enumerate(slots):
        for name, value in slot.items():
            out[name][0, s] = value
    return out


def active_ticks(slots, cycles, down):
    """Ticks in which a window is open: packets last `cycles`, the pedal goes down in tick
    `down`.
    """
    setup = RavenSetup(injection=Injection(len(slots), (), tuple(TRIGGER_CODES)))
    faults = {name: values[0] for name, values in faults_of(slots).items()}
    records = fault.Faults(
        tuple(
            fault.FaultSlot(**{name: jnp.asarray(v[s]) for name, v in faults.items()})
            for s in range(len(slots))
        )
    )
    state, ticks = fault.init(setup), []
    for tick in range(TICKS):
        clocks = fault.TriggerClocks(
            jnp.int32(tick),
            jnp.int32(tick // cycles + 1),
            jnp.int32(tick - down - 1 if tick > down else -1),
        )
        state = fault.open_windows(setup, records, state, clocks)
        if any(bool(slot.active) for slot in state.slots):
            ticks.append(tick)
    return ticks


@given(st.lists(SLOT, min_size=1, max_size=2), st.integers(1, 3), st.integers(0, 9))
def test_no_fault_acts_before_and_none_where_a_run_is_cut(slots, cycles, down):
    ticks, faults = active_ticks(slots, cycles, down), faults_of(slots)
    first = span.first_active_ticks(faults, TICKS)[0]
    assert not ticks or first <= ticks[0]
    of_time = [slot for slot in slots if slot["code"] and slot["trigger"] == TRIGGER_CODES["time"]]
    if len(of_time) == sum(slot["code"] for slot in slots):
        assert first == (ticks[0] if ticks else TICKS), "a time is known exactly"
    end = span.observation_ends(faults, TICKS, 3)[0]
    assert end == TICKS or end == ticks[-1] + 1 + 3, "so long after the last tick in which one acts"
    assert span.observation_ends(faults, TICKS, None)[0] == TICKS
