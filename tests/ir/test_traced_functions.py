"""Numbers that write their program themselves write the one that JAX's trace is lowered to, or
are refused.
"""

from __future__ import annotations

import itertools
import operator
import warnings

import jax
import numpy as np
import pytest

from ravenjax.ir import traced_number
from ravenjax.ir.builder import Builder, contract
from ravenjax.ir.lowering import lower
from ravenjax.ir.program import Program
from ravenjax.ir.traced_functions import TracedLax, TracedNumpy
from ravenjax.ir.traced_number import DTYPES, TracedNumber, TracedTable, Untraceable
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import instead, jnp, lax
from ravenjax.numbers.vec import rarely

TYPES = ("bool", "int32", "uint32", "float32")
TABLE = 9
PLAIN = (
    *(True, 0, 3, -7, 2.5, -0.0, float("inf"), float("nan")),
    *(
        2.9999999999,
        16777217.0,
        1e-50,
        16777217,
        np.float64(2.9999999999),
    ),  # other numbers where they are narrow
    *(
        np.float32(1.5),
        np.int32(-4),
        np.uint32(5),
        np.bool_(True),
        np.float64(0.1),
        np.int64(6),
        np.asarray(2.0),
    ),
)
ALONE = {
    **{
        f"jnp.{name}": lambda x, name=name: getattr(jnp, name)(x)
        for name in (
            "sin",
            "cos",
            "tan",
            "atan",
            "asin",
            "acos",
            "exp",
            "log",
            "sqrt",
            "abs",
            "floor",
            "round",
            "sign",
            "asarray",
            "zeros_like",
            "bool_",
            "int32",
            "uint32",
            "float32",
        )
    },
    **{
        f"to {dtype}": lambda x, dtype=dtype: lax.convert_element_type(x, dtype)
        for dtype in (*TYPES, "float64")
    },
    **{f"as {dtype}": lambda x, dtype=dtype: jnp.asarray(x, dtype) for dtype in TYPES},
    **{
        f"bits {dtype}": lambda x, dtype=dtype: lax.bitcast_convert_type(x, dtype)
        for dtype in TYPES[1:]
    },
    "neg": operator.neg,
    "not": operator.invert,
    "abs": abs,
    "astype": lambda x: x.astype("float32"),
    "own type": lambda x: lax.convert_element_type(x, x.dtype),
}
PAIRS = {
    **{
        name: getattr(operator, name)
        for name in (
            "add",
            "sub",
            "mul",
            "truediv",
            "and_",
            "or_",
            "xor",
            "lshift",
            "rshift",
            "eq",
            "ne",
            "lt",
            "le",
            "gt",
            "ge",
        )
    },
    **{
        name: lambda x, y, name=name: getattr(jnp, name)(x, y)
        for name in ("maximum", "minimum", "atan2")
    },
    **{
        f"lax.{name}": lambda x, y, name=name: getattr(lax, name)(x, y)
        for name in ("div", "rem", "shift_left")
    },
}


def by_jax(function, inputs) -> tuple[Program, list[tuple[str, bool]]]:
    """The program through JAX, and type and weakness of each result."""
    with jax.enable_x64(False), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Explicitly requested dtype"
        )  # of numbers that are taken as narrow
        shapes = tree.mapped(_shape, inputs)
        jaxpr, results = jax.make_jaxpr(function, return_shape=True)(*shapes)
    types = [
        (str(one.dtype), one.weak_type and one.dtype != bool) for one in jax.tree.leaves(results)
    ]
    return contract(lower(jaxpr)), types  # a weak truth value is promoted as any


def directly(function, inputs) -> tuple[Program, list[tuple[str, bool]]]:
    """The same without JAX."""
    builder = Builder()
    numbers = tree.mapped(lambda one: _number(builder, one), inputs)
    with instead(TracedNumpy(builder), TracedLax(builder)):
        results = tree.leaves(function(*numbers))
        outputs = [traced_number.operand(builder, one).index for one in results]
    kinds = [traced_number.plain_kind(one) for one in results]
    weak = (traced_number.WEAK_INT, traced_number.WEAK_FLOAT)
    return contract(builder.program(outputs)), [(DTYPES[kind], kind in weak) for kind in kinds]


def _shape(one: str):
    return jax.ShapeDtypeStruct(*(((TABLE,), "float32") if one == "table" else ((), one)))


def _number(builder: Builder, one: str):
    if one == "table":
        return TracedTable(builder, "float32", TABLE)
    return TracedNumber(builder, builder.input(one), traced_number.kind_of(one))


def alike(function, *inputs: str) -> bool:
    """Whether it is written directly; if so, as through JAX."""
    try:
        program, types = directly(function, inputs)
    except Untraceable:
        return False
    wanted, wanted_types = by_jax(function, inputs)
    assert types == wanted_types
    assert program == wanted
    return True


@pytest.mark.parametrize("name", ALONE)
def test_functions_of_one_number(name):
    assert sum(alike(ALONE[name], dtype) for dtype in TYPES)


@pytest.mark.parametrize("name", ALONE)
def test_functions_of_a_plain_number(name):
    def function(x, value):
        number = jnp.asarray(value) if name in ("astype", "own type") else value
        return ALONE[name](number), x

    if name in ("neg", "not", "abs"):
        pytest.skip("Python's own")
    assert sum(alike(lambda x, value=value: function(x, value), "float32") for value in PLAIN)


@pytest.mark.parametrize("name", PAIRS)
def test_functions_of_two_numbers(name):
    assert sum(alike(PAIRS[name], *pair) for pair in itertools.product(TYPES, repeat=2))


@pytest.mark.parametrize("name", PAIRS)
def test_functions_of_a_number_and_a_plain_one(name):
    known = [
        alike(function, dtype)
        for dtype in TYPES
        for value in PLAIN
        for function in (lambda x, v=value: PAIRS[name](x, v), lambda x, v=value: PAIRS[name](v, x))
    ]
    assert any(known)


@pytest.mark.parametrize("dtype", TYPES)
def test_choices(dtype):
    for other in TYPES:
        assert alike(lambda c, x, y: jnp.where(c, x, y), "bool", dtype, other)
    for value in PLAIN:
        assert alike(lambda c, x, v=value: jnp.where(c, x, v), "bool", dtype)
        assert alike(lambda c, x, v=value: (jnp.where(c, v, x), jnp.where(c, v, 1)), "bool", dtype)


def test_rare_branches():
    def function(c, x, y):
        return rarely(c, lambda: (x * 2.0 + y, y, {"k": jnp.sin(x)}), (x, x, {"k": y}))

    assert alike(function, "bool", "float32", "float32")
    assert alike(
        lambda c, x: rarely(x > 1.0, lambda: (x + x, c), (jnp.float32(3.0), c)), "bool", "float32"
    )


def test_tables():
    def read(table, k):
        return table.at[k].get(mode="clip", wrap_negative_indices=False) * float(table.shape[0])

    assert alike(read, "table", "int32")


def test_large_whole_numbers():
    assert alike(lambda x: (x >> jnp.uint32(7)) * jnp.uint32(0xFFFFFFFF), "uint32")


STRANGE = {
    "a branch of Python": lambda x, k: 1.0 if x > 0 else 2.0,
    "a Python float": lambda x, k: float(x),
    "a Python number": lambda x, k: [1, 2][k],
    "NumPy": lambda x, k: np.asarray(x),
    "NumPy's function": lambda x, k: np.float32(2.0) + jnp.cosh(x),
    "modulo": lambda x, k: x % 2.0,
    "whole division": lambda x, k: k // 2,
    "a power": lambda x, k: x**0.5,
    "lax": lambda x, k: lax.erf(x),
    "an attribute": lambda x, k: x.reshape(()),
    "narrow numbers": lambda x, k: lax.convert_element_type(x, "int16"),
    "a large number": lambda x, k: k + 2**40,
    "an array": lambda x, k: x + np.ones(3),
    "text": lambda x, k: jnp.where(x > 0, x, "none"),
    "a choice by a number": lambda x, k: jnp.where(k, x, 0.0),
    "unlike types": lambda x, k: lax.div(x, k),
    "unlike branches": lambda x, k: lax.cond(x > 0, lambda: x, lambda: k),
    "an axis": lambda x, k: x[0],
    "a type of None": lambda x, k: lax.convert_element_type(k, None),
    "a weak branch": lambda x, k: lax.cond(x > 0, lambda: jnp.int32(2), lambda: 1) + jnp.uint32(2),
    "branches of other names": lambda x, k: lax.cond(x > 0, lambda: {"a": x}, lambda: {"b": x}),
    "branches of other kinds": lambda x, k: lax.cond(x > 0, lambda: [x], lambda: (x,)),
}


@pytest.mark.parametrize("what", STRANGE)
def test_what_is_not_known_is_refused(what):
    with pytest.raises(Untraceable):
        directly(STRANGE[what], ("float32", "int32"))


@pytest.mark.parametrize(
    "place", [lambda x, y: x + y, lambda x, y: jnp.where(x > 0, x, y), lambda x, y: jnp.abs(y)]
)
def test_a_number_of_another_program_is_refused(place):
    kept = []
    directly(lambda x: kept.append(x * 3.0) or x, ("float32",))
    with pytest.raises(Untraceable, match="kept from another function"):
        directly(lambda x: place(x, kept[0]), ("float32",))


TYPE_TESTS = {
    "its own": lambda x: x.dtype == jnp.float32,
    "turned": lambda x: jnp.float32 == x.dtype,
    "NumPy's": lambda x: jnp.float32 == np.float32,
    "NumPy's class": lambda x: x.dtype.type == jnp.float32,
    "another": lambda x: x.dtype != jnp.int32 and np.int32 != jnp.float32,
    "in a set": lambda x: x.dtype.type in {jnp.float32, jnp.int32},
    "below another": lambda x: np.issubdtype(x.dtype, jnp.float32),
}


@pytest.mark.parametrize("what", TYPE_TESTS)
def test_types_equal_what_those_of_jax_equal(what):
    for dtype in TYPES:
        assert alike(lambda x: x if TYPE_TESTS[what](x) else jnp.zeros_like(x), dtype)


def test_jax_returns_when_direct_tracing_ends():
    directly(lambda x: jnp.sin(x), ("float32",))
    assert isinstance(jnp.sin(1.0), jax.Array)
    with pytest.raises(Untraceable):
        directly(STRANGE["modulo"], ("float32", "int32"))
    assert isinstance(jnp.sin(1.0), jax.Array)


class Draw:
    """A program of random operations on all that there is so far, the same each time that it
    runs.
    """

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.steps: list[tuple[str, tuple[int, ...]]] = []

    def grow(self, numbers: list) -> list:
        """Add random operations, but for those that are refused."""
        while len(self.steps) < 60:
            name = str(self.random.choice([*PAIRS, *ALONE, *["where"] * 6]))
            count = 3 if name == "where" else 2 if name in PAIRS else 1
            places = tuple(self.random.integers(0, len(numbers), count).tolist())
            try:
                numbers.append(self.apply(name, [numbers[place] for place in places]))
            except (
                Untraceable,
                TypeError,
                AttributeError,
                OverflowError,
            ):  # of a number, or of plain ones
                continue
            self.steps.append((name, places))
        return numbers

    def replay(self, *inputs):
        numbers = [*inputs, *PLAIN]
        for name, places in self.steps:
            numbers.append(self.apply(name, [numbers[place] for place in places]))
        return numbers[len(inputs) + len(PLAIN) :]

    @staticmethod
    def apply(name: str, operands: list):
        if all(
            not hasattr(x, "astype") or isinstance(x, np.generic | np.ndarray) for x in operands
        ):
            operands = [
                jnp.asarray(x) for x in operands
            ]  # Python's and NumPy's own results are no matter here
        function = jnp.where if name == "where" else PAIRS.get(name) or ALONE[name]
        return function(*operands)


@pytest.mark.parametrize("seed", range(12))
def test_random_programs(seed):
    draw = Draw(seed)
    directly(lambda *inputs: draw.grow([*inputs, *PLAIN])[-1], TYPES)
    assert len(draw.steps) == 60 and alike(draw.replay, *TYPES)
