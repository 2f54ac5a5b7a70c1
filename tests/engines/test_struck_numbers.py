"""Every fault at every channel, alone and in pairs, through each printer of code and through XLA's
own compiler.

What is compiled is a site alone: its numbers go in, faults strike, they come out. So every site,
effect and channel can be tried; numbers go in that are hard for a printer.
"""

from __future__ import annotations

import importlib.util
import itertools
import random

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import compiled, same_bits
from cuda_as_cpp import Library
from evaluated_program import in_python

from ravenjax.engines.gpu import cuda
from ravenjax.faults import fault, injection
from ravenjax.ir import lowering, semantics
from ravenjax.numbers.setup import Injection, SiteUse
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.effects import EFFECT_CODES, EFFECTS, NETWORK_EFFECTS
from ravenjax.vocabulary.sites import Channel

if importlib.util.find_spec("wasmtime"):
    from wasm_program import wasm_results
else:
    wasm_results = None

OWN = tuple(name for name in EFFECTS if name not in NETWORK_EFFECTS)
HARD = {
    np.float32: [
        0.0,
        -0.0,
        1.0,
        -1.5,
        3e38,
        1e-30,
        np.inf,
        -np.inf,
        np.nan,
        32768.0,
        -2147483648.0,
    ],
    np.int32: [0, 1, -1, 3, 255, 32767, -32768, 65507, 2**23, 2**31 - 1, -(2**31)],
    np.bool_: [False, True, True, False, False, True, False, True, True, False, True],
}
VALUES = np.array(
    [0.0, 1.0, -1.0, 3.0, 31.0, 0.5, -32768.0, 65535.0, 2147483520.0, -3e38, 1e-30], np.float32
)
LANES = len(VALUES)
STORED = ("float", "bool", "int16", "int16 saturated", "int32")


class Use:
    """A site of the robot as a signal of its own: one number a channel; which of its effects a
    campaign has.
    """

    def __init__(
        self,
        channels: tuple[Channel, ...],
        kinds: tuple[str, ...],
        effects: tuple[str, ...],
        slots: int,
    ):
        self.dtypes = [
            {"float": np.float32, "bool": np.bool_}.get(channel.kind, np.int32)
            for channel in channels
        ]
        self.kinds, self.effects, self.slots = kinds, effects, slots
        names = tuple(("", channel.name) for channel in channels)
        self.setup = RavenSetup(
            injection=Injection(slots, (SiteUse("site", names, effects),), ("time",))
        )
        self.paths = {("site", "", c.name): ((i,), kinds[i]) for i, c in enumerate(channels)}

    def columns(self, draw: random.Random) -> list[np.ndarray]:
        """Hard numbers, [lanes] each: of the channels, then of each slot its fault and what it
        remembers.
        """
        out = [np.array(draw.sample(HARD[dtype], LANES), dtype) for dtype in self.dtypes]
        for _ in range(self.slots):
            code = [draw.randint(0, len(self.dtypes)) for _ in range(LANES)]
            effect = [EFFECT_CODES[draw.choice(self.effects)] for _ in range(LANES)]
            out += [
                np.array(code, "i4"),
                np.array(effect, "i4"),
                np.array(draw.sample(list(VALUES), LANES), "f4"),
            ]
            out += [np.array(draw.choices([1, 2, 7], k=LANES), "i4"), np.arange(LANES, dtype="u4")]
            out += [
                np.array(draw.choices([True, True, False], k=LANES)),
                np.array(draw.choices([0, 1, 5], k=LANES), "i4"),
            ]
            out += [np.array(draw.sample(HARD[np.float32], LANES), "f4") for _ in range(2)]
        return out

    @property
    def changes(self) -> set[int]:
        """Which of the numbers that `struck` returns tell whether a slot has changed anything,
        and when first.
        """
        own = 4  # of each slot
        return {len(self.dtypes) + own * slot + k for slot in range(self.slots) for k in (2, 3)}

    def struck(self, *numbers):
        """The channels after the faults, and what the slots remember."""
        count = len(self.dtypes)
        signal, rest = tuple(numbers[:count]), numbers[count:]
        faults, slots = [], []
        for k in range(self.slots):
            code, effect, value, period, key, active, age, latched, before = rest[9 * k : 9 * k + 9]
            never = jnp.int32(-1)
            faults.append(fault.FaultSlot(code, effect, value, *(jnp.int32(0),) * 4, period, key))
            slots.append(fault.SlotState(active, age, latched, before, never, jnp.int32(0), never))
        clock = fault.TriggerClocks(jnp.int32(7), jnp.int32(8), jnp.int32(-1))
        given = fault.Faults(tuple(faults)), fault.FaultState(tuple(slots))
        inject = injection.Injector(self.setup, self.paths, *given, clock)
        signal, state = inject("site", signal), inject.state
        return jax.tree.leaves(
            (signal, [(s.latched, s.before, s.first_tick, s.changed_ticks) for s in state.slots])
        )


def uses():
    """Every site with its channels as they are stored, one channel or all of them."""
    for site in ROBOT.sites.values():
        stored = STORED[2:] if site.beyond else (None,)
        for word, channels in itertools.product(
            stored, ({site.channels[:1], site.channels, site.channels[-1:]})
        ):
            yield (
                channels,
                tuple(word or ("int32" if c.kind == "int24" else c.kind) for c in channels),
            )


def check(use: Use, draw: random.Random, folder=None, xla: bool = False) -> None:
    """One program as it is printed for the CPU, for WebAssembly and in Python, beside what it
    means; given a folder for files, in the C++ of the GPU's code, too; and as XLA compiles it,
    which takes a second."""
    columns = use.columns(draw)
    shapes = [jax.ShapeDtypeStruct((), column.dtype) for column in columns]
    jaxpr = jax.make_jaxpr(use.struck)(*shapes)
    program = lowering.lower(jaxpr)
    with np.errstate(all="ignore"):
        meant = [np.broadcast_to(np.asarray(x), LANES) for x in semantics.run(program, columns)]
    for width in (1, 8):
        for got, expected in zip(compiled(program, width, tuple(columns)), meant, strict=True):
            same_bits(got, expected)
    if folder is not None:
        for got, expected in zip(as_cpp(program, columns, folder), meant, strict=True):
            same_bits(got, expected)
    by_xla = jax.jit(jax.vmap(use.struck))(*columns) if xla else meant
    function = in_python(use.struck, *shapes)
    by_wasm = wasm_results(program, 4, tuple(columns)) if wasm_results else meant
    by_python = zip(*(function(row) for row in zip(*columns, strict=True)), strict=True)
    exact = not {"periodic", "drift", "random"} & set(
        use.effects
    )  # XLA fuses; sines and their like are its own
    for number, (expected, *others) in enumerate(
        zip(meant, by_xla, by_wasm, by_python, strict=True)
    ):
        if not exact and number in use.changes:  # whether a number changed hangs on its last bit
            continue
        for other in others:
            alike(np.asarray(other, expected.dtype), expected, exact)


def alike(got: np.ndarray, expected: np.ndarray, exact: bool) -> None:
    """Equal numbers, or nearly; whole ones may then be off by one where a fraction was cut."""
    if exact or expected.dtype == bool:
        np.testing.assert_array_equal(got, expected)
    elif expected.dtype.kind == "f":
        np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)
    else:
        apart = np.abs(got.astype(np.int64) - expected)
        assert (
            np.minimum(apart, 2**16 - apart % 2**16) <= 1 + 1e-6 * np.abs(expected.astype(float))
        ).all()


def as_cpp(program, columns, folder) -> list[np.ndarray]:
    """Its results by the CUDA C that is printed of it, compiled as C++."""
    printer = cuda.CudaPrinter()
    sources = {
        i: f"in[{op.detail} * n + lane]"
        for i, op in enumerate(program.operations)
        if op.name == "input"
    }
    results = [(i, f"out[{k} * n + lane]") for k, i in enumerate(program.outputs)]
    printer.run(program, program.needed(), sources, results)
    body = "\n".join(printer.lines)
    text = (
        f'{cuda.PRELUDE}\nextern "C" __global__ void f(const unsigned* in, unsigned* out, int n)'
        " {\n"
    )
    text += f"  for (int lane = 0; lane < n; ++lane) {{\n{body}\n  }}\n}}\n"
    words = np.stack(
        [c.astype(np.uint32) if c.dtype == bool else c.view(np.uint32) for c in columns]
    )
    out = np.zeros((len(program.outputs), LANES), np.uint32)
    Library(text, folder).launch("f", 1, 1, words, out, LANES)
    types = [np.dtype(program.operations[i].dtype) for i in program.outputs]
    return [row != 0 if t.kind == "b" else row.view(t) for row, t in zip(out, types, strict=True)]


EVERY = list(uses())


@pytest.mark.parametrize("effect", OWN)
def test_an_effect_at_each_kind_of_number(effect, tmp_path):
    draw = random.Random(effect)
    for kind in STORED:
        name = kind.partition(" ")[0]
        check(
            Use((Channel("x", (), name, "1"),), (kind,), (effect,), 1),
            draw,
            tmp_path if kind == "bool" else None,
        )


def test_pairs_of_effects_at_some_sites(tmp_path):
    draw = random.Random(3)
    for place, (channels, kinds) in enumerate(draw.sample(EVERY, 4)):
        check(
            Use(channels, kinds, tuple(draw.sample(OWN, 2)), 2),
            draw,
            tmp_path if place == 0 else None,
        )


@pytest.mark.slow
@pytest.mark.parametrize("effect", OWN)
def test_an_effect_at_every_site(effect):
    draw = random.Random(effect)
    for channels, kinds in EVERY:
        check(Use(channels, kinds, (effect,), 1), draw)


@pytest.mark.slow
@pytest.mark.parametrize("site", range(len(EVERY)))
def test_pairs_of_effects_at_every_site(site, tmp_path):
    draw = random.Random(site)
    for effects in draw.sample(list(itertools.combinations(OWN, 2)), 6):
        check(Use(*EVERY[site], effects, 2), draw)
    compilers = site % 3 == 0  # they take seconds
    check(Use(*EVERY[site], OWN, 2), draw, tmp_path if compilers else None, xla=compilers)
