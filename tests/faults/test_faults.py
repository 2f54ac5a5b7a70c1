"""Injection against a naive model of each effect, on a signal that has nothing to do with the
Raven.
"""

import math
import struct

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import HARD_FLOATS, compiled, lowered, same_bits
from empty_faults import no_fault
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.faults import fault, injection
from ravenjax.ir import semantics
from ravenjax.numbers.setup import Injection, SiteUse
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary import effects

TICKS = 40


@record
class Signal:
    """A made-up robot's signal: two floats, a 16-bit and a 32-bit integer, a flag."""

    level: Vec
    command: Scalar
    count: Scalar
    flag: Scalar


PATHS = {
    ("pump", "", "left"): (("level", 0), "float"),
    ("pump", "", "right"): (("level", 1), "float"),
    ("pump", "", "command"): (("command",), "int16"),
    ("pump", "", "count"): (("count",), "int32"),
    ("pump", "", "flag"): (("flag",), "bool"),
}
EFFECTS = tuple(name for name in effects.EFFECTS if name not in effects.NETWORK_EFFECTS)
SETUP = RavenSetup(
    injection=Injection(
        slots=2,
        sites=(SiteUse("pump", tuple((arm, channel) for _, arm, channel in PATHS), EFFECTS),),
        triggers=tuple(effects.TRIGGERS),
    )
)


def clean(tick: int) -> tuple[float, float, int, int, bool]:
    """The signal without faults."""
    return (math.sin(0.3 * tick), 2.0 + 0.5 * tick, 100 * tick - 700, 570_000 + tick, tick % 3 == 0)


def make(code, effect, value, trigger, start, duration, every, period=7):
    return fault.FaultSlot(
        *(jnp.int32(code), jnp.int32(effects.EFFECT_CODES[effect]), jnp.float32(value)),
        *(jnp.int32(effects.TRIGGER_CODES[trigger]), jnp.int32(start), jnp.int32(duration)),
        *(jnp.int32(every), jnp.int32(period), jnp.uint32(12345)),
    )


def _tick(faults, state, signal, clock):
    state = fault.open_windows(SETUP, faults, state, clock)
    inject = injection.Injector(SETUP, PATHS, faults, state, clock)
    signal = inject("pump", signal)
    return inject.state, signal


_TICK = jax.jit(_tick)


def run(*faults, pedal=lambda tick: -1):
    """Each tick's faulty signal as numbers, and the final state of the slots."""
    slots = (*faults, *(no_fault() for _ in range(2 - len(faults))))
    state, rows = fault.init(SETUP), []
    for tick in range(TICKS):
        left, right, command, count, flag = clean(tick)
        signal = Signal(
            Vec((jnp.float32(left), jnp.float32(right))),
            jnp.int32(command),
            jnp.int32(count),
            jnp.bool_(flag),
        )
        clock = fault.TriggerClocks(jnp.int32(tick), jnp.int32(tick + 1), jnp.int32(pedal(tick)))
        state, out = _TICK(fault.Faults(slots), state, signal, clock)
        rows.append([np.asarray(x)[()] for x in jax.tree.leaves(out)])
    return rows, state.slots[0]


def naive(effect, x, value, n, latch, before, period, whole) -> float:
    """The effect as its definition says, in tick `n` of the fault."""
    f32 = np.float32
    if effect == "bit_flip":
        bit = int(value) & 31
        if whole:
            return float(np.int32(np.uint32(int(x) & 0xFFFFFFFF) ^ np.uint32(1 << bit)))
        (pattern,) = struct.unpack("<I", struct.pack("<f", x))
        return struct.unpack("<f", struct.pack("<I", pattern ^ (1 << bit)))[0]
    return {
        "overwrite": lambda: f32(value),
        "offset": lambda: f32(x) + f32(value),
        "latch_offset": lambda: latch,
        "scale": lambda: f32(x) * f32(value),
        "drift": lambda: f32(x) + f32(value) * f32(n + 1),
        "stuck": lambda: before,
        "periodic": lambda: f32(x) + f32(value) * math.sin(2 * math.pi * (n % period) / period),
        "toggle": lambda: value if n % 2 == 0 else 0.0,
    }[effect]()


def stored(y: float, kind: str) -> float:
    if kind == "float":
        return y
    if kind == "bool":
        return float(y != 0.0)
    whole = math.trunc(y) if -(2**31) <= y < 2**31 else -(2**31)
    return float((whole + 32768) % 65536 - 32768) if kind == "int16" else float(whole)


@pytest.mark.parametrize("effect", [name for name in EFFECTS if name != "random"])
@pytest.mark.parametrize(
    ("code", "value"), [(1, 3.0), (2, -0.25), (3, 5.0), (3, 40000.0), (4, 2.0), (5, 1.0)]
)
@pytest.mark.parametrize("every", [0, 13])
def test_an_effect_does_what_its_definition_says(effect, code, value, every):
    kind = list(PATHS.values())[code - 1][1]
    if effect == "bit_flip" and (kind == "bool" or value < 0 or value > 31):
        pytest.skip("a bit index")
    rows, slot = run(make(code, effect, value, "time", 5, 6, every))
    before = latch = 0.0
    opened = False
    changed = 0
    for tick, row in enumerate(rows):
        expected = list(clean(tick))
        x = float(np.float32(expected[code - 1]))
        since = tick - 5
        n = since % every if every else since
        is_open = since >= 0 and n < 6
        if is_open:
            if not opened:
                latch = float(np.float32(x) + np.float32(value))
            y = naive(effect, x, value, n, latch, before, 7, kind in ("int16", "int32"))
            expected[code - 1] = stored(float(y), kind)
            changed += expected[code - 1] != x
        else:
            before = x
        opened = is_open
        np.testing.assert_allclose(
            np.array(row, float), np.array(expected, float), rtol=3e-7, atol=1e-6
        )
    assert int(slot.changed_ticks) == changed


def test_pedal_windows_follow_each_pedal_down_and_close_with_it():
    def pedal(tick):
        return -1 if tick < 10 or 20 <= tick < 25 else (tick - 10 if tick < 20 else tick - 25)

    rows, slot = run(make(1, "overwrite", 9.0, "pedal", 2, 30, 0), pedal=pedal)
    hit = [tick for tick, row in enumerate(rows) if row[0] == 9.0]
    assert hit == [*range(12, 20), *range(27, TICKS)]
    assert int(slot.first_tick) == 12


def test_two_slots_on_one_channel_act_in_order():
    rows, _ = run(make(4, "offset", 5.0, "time", 3, 4, 0), make(4, "scale", 2.0, "time", 4, 1, 0))
    expected = [clean(t)[3] + (5 if 3 <= t < 7 else 0) for t in range(TICKS)]
    expected[4] *= 2
    assert [int(row[3]) for row in rows] == expected


def struck_from_5(slot, level, ticks):
    """The slot after so many ticks of a signal that stands still."""
    faults, state = fault.Faults((slot, no_fault())), fault.init(SETUP)
    levels = Vec((jnp.float32(level), jnp.float32(0.0)))
    still = Signal(levels, jnp.int32(0), jnp.int32(0), jnp.bool_(False))
    for tick in range(ticks):
        clock = fault.TriggerClocks(jnp.int32(tick), jnp.int32(-1), jnp.int32(tick))
        state, _ = _TICK(faults, state, still, clock)
    return state.slots[0]


@pytest.mark.parametrize("bit", [0, 5, 31])
def test_any_bit_of_a_float_that_flips_is_a_change(bit):
    """Of 0 they make numbers that XLA takes for 0."""
    slot = struck_from_5(make(1, "bit_flip", float(bit), "time", 5, 6, 0), 0.0, TICKS)
    assert (int(slot.first_tick), int(slot.changed_ticks)) == (5, 6)


def test_a_number_that_is_none_is_no_change_before_its_fault():
    slot = struck_from_5(make(1, "offset", 1.0, "time", 5, 6, 0), math.nan, 5)
    assert int(slot.changed_ticks) == 0


HARD = {
    "float": HARD_FLOATS,
    "bool": np.array([False, True]),
    "int": np.array([0, 1, -1, 255, 32767, -32768, 65507, 2**23, 2**31 - 1, -(2**31)], np.int32),
}
VALUES = [0.0, 1.0, -1.0, 3.0, 31.0, 0.5, -32768.0, 65535.0, 2147483520.0, -3e38, 1e-30]
INEXACT = ("periodic", "drift", "random")
"""Effects of which XLA fuses the operations, or computes sines of its own."""


@pytest.mark.parametrize("kind", ["float", "bool", "int16", "int16 saturated", "int32"])
def test_hard_numbers_are_struck_alike_by_printed_code_and_by_xla(kind):
    setup = RavenSetup(injection=Injection(1, (SiteUse("site", (("", "x"),), EFFECTS),), ("time",)))

    def struck(x, effect, value, age, latched, before):
        never, none = jnp.int32(-1), jnp.int32(0)
        slot = fault.FaultSlot(
            jnp.int32(1), effect, value, *(none,) * 4, jnp.int32(7), jnp.uint32(5)
        )
        state = fault.SlotState(jnp.bool_(True), age, latched, before, never, none, never)
        inject = injection.Injector(
            setup,
            {("site", "", "x"): ((), kind)},
            *(fault.Faults((slot,)), fault.FaultState((state,))),
            fault.TriggerClocks(jnp.int32(7), jnp.int32(8), never),
        )
        return inject("site", x), inject.state.slots[0].latched

    rng, lanes = np.random.default_rng(3), 2000
    names = rng.choice(EFFECTS, lanes)
    numbers = HARD["int" if kind.startswith("int") else kind]
    columns = (
        rng.choice(numbers, lanes),
        np.array([effects.EFFECT_CODES[name] for name in names], np.int32),
        rng.choice(np.float32(VALUES), lanes),
        rng.choice(np.int32([0, 1, 5]), lanes),
        *(rng.choice(HARD_FLOATS, lanes) for _ in range(2)),
    )
    program = lowered(struck, *columns)
    meant = [np.broadcast_to(np.asarray(x), lanes) for x in semantics.run_program(program, columns)]
    for width in (1, 16):
        for got, expected in zip(compiled(program, width, columns), meant, strict=True):
            same_bits(got, expected)
    exact = ~np.isin(names, INEXACT)
    # XLA takes numbers below the normal ones for 0.
    for column in (columns[0], *columns[4:]):
        exact &= ~((np.abs(column.astype(float)) < 1.2e-38) & (column != 0))
    by_xla = np.asarray(jax.jit(jax.vmap(struck))(*columns)[0])
    flips = (names == "bit_flip") & (kind == "float")
    exact &= ~flips
    np.testing.assert_array_equal(by_xla[exact], meant[0][exact])


@settings(max_examples=40, deadline=None)
@given(
    start=st.integers(-5, 45),
    duration=st.integers(0, 20),
    every=st.integers(0, 20),
    value=st.floats(-1e6, 1e6, width=32, allow_subnormal=False),
)
def test_a_window_is_open_exactly_when_it_says(start, duration, every, value):
    rows, _ = run(make(1, "offset", value, "time", start, duration, every))
    for tick, row in enumerate(rows):
        since = tick - start
        is_open = since >= 0 and (since % every if every else since) < duration
        x = np.float32(clean(tick)[0])
        assert row[0] == (x + np.float32(value) if is_open else x)
