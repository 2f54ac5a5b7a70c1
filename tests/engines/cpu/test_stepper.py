"""One robot stepped from outside is the robot of a campaign, bit for bit; its state and inputs
are plain memory.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.engines.cpu.stepper import StepCode, Stepper
from ravenjax.numbers.vec import record


@record
class Inputs:
    gain: jax.Array
    count: jax.Array


@record
class State:
    sum: jax.Array
    ticks: jax.Array
    spare: jax.Array


@pytest.fixture(scope="module")
def code():
    def begin(inputs):
        return State(inputs.gain * 0.0, jnp.int32(0), jnp.float32(7.0))

    def step(inputs, state, now, entering, tables):
        read = tables[0].at[now].get(mode="clip", wrap_negative_indices=False)
        new = State(
            state.sum + inputs.gain * read + entering[0], state.ticks + inputs.count, state.spare
        )
        return new, [new.sum, jnp.float32(now), jnp.float32(entering[1])]

    def finish(inputs, state):
        return {"ticks": state.ticks, "sum": state.sum, "spare": state.spare}

    entering = (np.float32(0.0), np.int32(0))
    return StepCode(begin, step, finish, Inputs(np.float32(2.0), np.int32(1)), entering, [4])


def stepped(stepper, ticks, first=0):
    out = np.zeros((ticks, 3), np.float32)
    for k in range(ticks):
        stepper.step(first + k, out[k].ctypes.data)
    return out


def test_a_tick_reads_tables_inputs_and_what_enters_and_tells_what_goes_out(code):
    stepper = Stepper(code, Inputs(np.float32(2.0), np.int32(1)))
    stepper.tables[0][:] = [1.0, 10.0, 100.0, 1000.0]
    stepper.step_inputs[0][0], stepper.step_inputs[1][0] = 0.5, -3
    out = stepped(stepper, 5)
    assert out[:, 0].tolist() == [2.5, 23.0, 223.5, 2224.0, 4224.5]  # the last look-up is clipped
    assert out[:, 1].tolist() == [0, 1, 2, 3, 4] and set(out[:, 2]) == {-3.0}
    assert stepper.outcomes() == {"ticks": 5, "sum": 4224.5, "spare": 7.0}


def test_a_function_changes_the_state_between_two_ticks(code):
    stepper = Stepper(code, Inputs(np.float32(2.0), np.int32(1)))
    stepper.tables[0][:] = 1.0
    stepped(stepper, 3)
    stepper.change(lambda state: State(state.sum + 0.25, state.ticks * 7, state.spare))
    assert stepper.outcomes() == {"ticks": 21, "sum": 6.25, "spare": 7.0}
    before = stepper.snapshot()
    stepper.change(lambda state: state)
    assert (stepper.snapshot() == before).all()
    assert stepped(stepper, 1, first=3)[0, 0] == 8.25
