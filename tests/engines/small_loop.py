"""A small time loop with numbers that a group shares, that a lane keeps, that never change, that
nothing reads, and that are rare.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.ir import lowering, semantics
from ravenjax.ir.builder import contract_to_fma
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers.vec import if_rarely

F, I = jax.ShapeDtypeStruct((), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32)
TABLE = np.linspace(-1.0, 2.0, 12).astype(np.float32)


def begin(gain, kick):
    """State: clock, filtered table, position, never changing, swapped pair, flag, and what
    nothing reads.
    """
    pair = jnp.float32(1), kick
    return (
        *(jnp.int32(5), jnp.float32(0), kick * 0.5, kick + 1.0),
        *(*pair, jnp.bool_(False), jnp.float32(3)),
    )


def far(x):
    for k in range(20):
        x = x * 0.5 + 0.01 * k
    return x


def step(gain, kick, state, now, given, table):
    clock, smooth, position, fixed, left, right, flag, unread = state
    drive = table.at[clock % 12].get(mode="clip", wrap_negative_indices=False) * gain
    smooth = smooth + 0.1 * (drive - smooth)
    position = (
        position
        + 0.01 * (jnp.sin(smooth) - position * fixed)
        + jnp.where(now == 7, kick, 0.0)
        + given * 1e-3
    )
    position = if_rarely(position > 0.3, lambda: far(position), position)
    flag = flag | (position > 0.3) & (kick > 0.2)
    new = (clock + 1, smooth, position, fixed, right, left + 0.0, flag, unread + position)
    return new, (position, smooth)


def finish(gain, kick, state):
    return {
        "position": state[2],
        "clock": state[0],
        "flag": state[6],
        "left": state[4] * gain,
        "smooth": state[1],
    }


def loop() -> TimeLoop:
    table = jax.ShapeDtypeStruct(TABLE.shape, TABLE.dtype)
    first, state = jax.make_jaxpr(begin, return_shape=True)(F, F)
    middle = jax.make_jaxpr(step)(F, F, state, I, F, table)
    last = jax.make_jaxpr(finish)(F, F, state)
    return TimeLoop(
        *(contract_to_fma(lowering.lower_jaxpr(jaxpr)) for jaxpr in (first, middle, last))
    )


def in_numpy(found: TimeLoop, gain, kick, given, ticks):
    """Results, and what goes out [tick, number, lane]."""
    state = [
        np.broadcast_to(x, gain.shape) for x in semantics.run_program(found.begin, [gain, kick])
    ]
    out = []
    for tick in range(ticks):
        entering = [np.full(gain.shape, tick, np.int32), given[min(tick, len(given) - 1)]]
        results = semantics.run_program(found.step, [gain, kick, *state, *entering], [TABLE])
        state = results[: len(state)]
        out.append([np.broadcast_to(x, gain.shape) for x in results[len(state) :]])
    return semantics.run_program(found.finish, [gain, kick, *state]), np.array(out)
