"""Faults on arrays of NumPy and JAX against the injection of campaigns, element by element."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from empty_faults import no_fault
from test_faults import EFFECTS, SETUP, TICKS, Signal, _tick, clean

from ravenjax import faults
from ravenjax.errors import UserError
from ravenjax.faults import fault as slots
from ravenjax.numbers.counter_random import CHANNEL_STRIDE
from ravenjax.numbers.vec import Vec
from ravenjax.vocabulary import effects

CHANNELS = {"float32": 1, "int32": 4, "bool": 5}
NUMBERS = {"bit_flip": 5.0, "stuck": None}


def fault_of(effect, **more):
    value = NUMBERS.get(effect, 2.5)
    words = {"periodic": {"period": 7}, "random": {"key": 12345}}.get(effect, {})
    return faults.Fault(effect, value, **words, **more)


def signals(dtype):
    return np.array([clean(tick)[CHANNELS[dtype] - 1] for tick in range(TICKS)], dtype)


def run(library, fault, columns, apply=faults.apply):
    """Signals and masks of all ticks, and the last state; columns: [ticks, ...]."""
    state, rows = faults.init(library.asarray(columns[0]), fault), []
    for tick, x in enumerate(columns):
        y, state, mask = apply(library.asarray(x), state, tick, fault)
        rows.append((np.asarray(y), np.asarray(mask)))
    return *map(np.stack, zip(*rows, strict=True)), state


@jax.jit
@partial(jax.vmap, in_axes=(None, None, None, 0, 0, 0, 0))
def by_campaign(effect, value, code, start, duration, every, key):
    """All channels and the activation as a campaign's injection has them, one run at a time."""
    made = slots.FaultSlot(code, effect, value, jnp.int32(0), start, duration, every, 7, key)

    def tick(state, x):
        i, left, right, *others = x
        clock = slots.TriggerClocks(i, i + 1, jnp.int32(-1))
        signal = Signal(Vec((left, right)), *others)
        state, out = _tick(slots.Faults((made, no_fault())), state, signal, clock)
        return state, (jax.tree.leaves(out), state.slots[0].changed_ticks)

    types = ("float32", "float32", "int32", "int32", "bool")
    columns = zip(zip(*map(clean, range(TICKS)), strict=True), types, strict=True)
    rows = [jnp.asarray(column, dtype) for column, dtype in columns]
    return jax.lax.scan(tick, slots.init(SETUP), (jnp.arange(TICKS), *rows))[1]


@pytest.mark.parametrize("dtype", CHANNELS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_arrays_are_struck_as_a_campaigns_channels(effect, dtype):
    if (effect, dtype) == ("bit_flip", "bool"):
        pytest.skip("a campaign flips no bit of a flag")
    shape = (2, 3)
    start, duration = np.array([[0, 3, 9], [5, 5, 30]]), np.array([4, 1, 9])
    every = np.array([[13], [11]])
    fault = fault_of(effect, start=start, duration=duration, every=every)
    columns = np.broadcast_to(signals(dtype)[:, None, None], (TICKS, *shape))
    keys = (12345 + np.arange(6, dtype=np.uint32) * np.uint32(CHANNEL_STRIDE)).reshape(shape)
    lanes = (a.ravel() for a in np.broadcast_arrays(start, duration, every, keys))
    value, code = np.float32(fault.value or 0.0), CHANNELS[dtype]
    leaves, changed = by_campaign(effects.EFFECT_CODES[effect], value, code, *lanes)
    expected, changed = (
        np.asarray(x).T.reshape(TICKS, *shape) for x in (leaves[code - 1], changed)
    )
    ours, masks, state = run(np, fault, columns)
    theirs, their_masks, _ = run(jnp, fault, columns[:20])
    # the compiler of JAX fuses products with sums
    close = {"rtol": 1e-6, "atol": 1e-5} if dtype == "float32" else {"atol": 0}
    np.testing.assert_allclose(ours, expected, **close)
    np.testing.assert_allclose(theirs, expected[:20], **close)
    np.testing.assert_array_equal(masks.cumsum(axis=0), changed)
    np.testing.assert_array_equal(masks[:20], their_masks)
    np.testing.assert_array_equal(state.slot.changed_ticks, changed[-1])


@pytest.mark.parametrize("shape", [(), (4,), (4, 3)])
@pytest.mark.parametrize("library", [np, jnp])
def test_shapes_types_and_vmap(shape, library):
    columns = np.random.default_rng(1).normal(size=(TICKS, *shape)).astype(np.float32)
    fault = faults.Fault("offset", 2.0, start=2, duration=3, probability=0.2, key=5)
    apply = jax.jit(faults.apply) if library is jnp else faults.apply
    ours, masks, state = run(library, fault, columns, apply)
    np.testing.assert_allclose(ours, columns + 2.0 * masks)
    assert state.slot.age.shape == ours.shape[1:] == shape and 0 < masks.mean() < 0.9
    assert (
        not masks[:2].any()
        and (masks == masks.reshape(TICKS, -1)[:, :1].reshape(TICKS, *(1,) * len(shape))).all()
    )
    if shape and library is jnp:
        along = jax.jit(jax.vmap(faults.apply, (0, 0, None, None)))
        np.testing.assert_array_equal(run(jnp, fault, columns, along)[0], ours)


def test_delays_and_resets_of_single_environments():
    columns = np.arange(40, dtype=np.int64).reshape(20, 2) * 10
    fault = faults.Fault("delay", [[1], [3]], start=4)
    state, late = faults.init(columns[:2], fault), []
    for tick in range(20):
        signal = np.stack([columns[tick], columns[tick]])
        y, state, _ = faults.apply(signal, state, tick, fault)
        late.append(tick - y[:, 0] // 20)
        state = faults.reset(state, np.array([False, tick == 9]))
    late = np.array(late)
    assert late[:, 0].tolist() == [0] * 4 + [1] * 16
    assert late[:, 1].tolist() == [0] * 4 + [3] * 6 + [0] * 4 + [3] * 6


def test_windows_follow_a_clock():
    fault, columns = faults.Fault("overwrite", 1.0, start=1, duration=2), np.zeros((6, 1))
    clock = iter([-1, 0, 1, 2, -1, 1])
    _, masks, _ = run(np, fault, columns, lambda *given: faults.apply(*given, clock=[next(clock)]))
    assert masks[:, 0].tolist() == [False, False, True, True, False, True]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"effect": "ofset", "value": 1}, "Did you mean 'offset'"),
        ({"effect": "offset"}, "needs value"),
        ({"effect": "stuck", "value": 1}, "takes no value"),
        ({"effect": "stuck", "period": 2}, "takes no period"),
        ({"effect": "stuck", "probability": 0.1}, "needs key"),
        ({"effect": "stuck", "duration": [1, 0]}, "duration is 0"),
        ({"effect": "bit_flip", "value": 32}, "value is 32"),
        ({"effect": "stuck", "probability": 0.1, "key": 1, "every": 2}, "not both"),
        ({"effect": "offset", "value": [1, 2]}, "value has shape"),
    ],
)
def test_what_is_refused(words, told):
    with pytest.raises(UserError, match=told):
        fault = faults.Fault(**words)
        faults.apply(np.zeros(3), faults.init(np.zeros(3), fault), 0, fault)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_vector_environment_of_gymnasium(mode):
    gymnasium = pytest.importorskip("gymnasium")
    from ravenjax.faults.vector_env import FaultyVectorEnv

    modes = {"autoreset_mode": gymnasium.vector.AutoresetMode(mode)}
    env = gymnasium.make_vec("CartPole-v1", 2, vectorization_mode="sync", vector_kwargs=modes)
    pushed = faults.Fault("overwrite", 1, at=[True, False])
    shifted = faults.Fault("offset", [0, 0, 9, 0], start=2)
    faulty = FaultyVectorEnv(env, [pushed], [shifted])
    faulty.reset(seed=3)
    age, before = np.zeros(2, int), np.zeros(2, bool)
    for _ in range(40):
        observation, _, ended, _, info = faulty.step(np.zeros(2, np.int64))
        age = np.where(ended if mode == "SameStep" else before, 0, age + 1)
        before = ended
        assert info["faults"]["actions"][0].tolist() == [True, False]
        assert ((observation[:, 2] > 5) == (age >= 2)).all()
        assert (info["faults"]["observations"][0][:, 2] == (age >= 2)).all()
