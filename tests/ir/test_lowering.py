"""Lowered jaxprs against JAX itself; what simplifies changes no bit; what is unknown is refused."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import HARD_FLOATS, HARD_INTEGERS, lowered, pairs, same_bits
from jax import lax

from ravenjax.ir import builder, lowering, semantics
from ravenjax.ir.builder import Builder, contract_to_fma
from ravenjax.ir.lowering import UnknownPrimitive
from ravenjax.ir.program import Program
from ravenjax.numbers import counter_random
from ravenjax.numbers.vec import to_int32, wrap16

NORMAL = HARD_FLOATS[
    ~((np.abs(HARD_FLOATS) < 1.2e-38) & (HARD_FLOATS != 0))
]  # XLA flushes subnormals
A, B = pairs(NORMAL)
I, J = pairs(HARD_INTEGERS)


@pytest.mark.slow
@pytest.mark.parametrize(
    "function",
    [
        lambda x: (x + 1.5) / (3.0 - x),
        lambda x: x * -0.0,
        lambda x: jnp.abs(-x) / -4.0,
        lambda x: jnp.negative(-x) - jnp.negative(x),
        lambda x: -x * 3.0,
        lambda x: jnp.sqrt(x),
        lambda x: x**3,
        lambda x: x**-2,
        lambda x: x**0 + jnp.square(x),
        *(jnp.floor, jnp.ceil, jnp.round, jnp.sign, jnp.isfinite),
        lambda x: jnp.clip(x, -1.0, 2.0),
        lambda x: jnp.where(x < 0, x, 2.0) == 2.0,
        lambda x: jnp.where(-x < 3.0, 1, 0) + 1,
        to_int32,
        lambda x: lax.convert_element_type(x, jnp.int32),
        lambda x: lax.convert_element_type(x, jnp.uint32),
        lambda x: lax.bitcast_convert_type(x, jnp.int32) ^ 1,
        lambda x: lax.convert_element_type(x > 0, jnp.float32) != 0.0,
        lambda x: jax.jit(lambda y: y * 2.0)(x),
        lambda x: jax.grad(lambda y: jnp.maximum(y, 0.5) * y)(x),
    ],
)
def test_functions_of_a_float(function):
    same_as_jax(function, NORMAL)


@pytest.mark.parametrize(
    "function",
    [
        lambda a, b: a + b,
        lambda a, b: a * b,
        lambda a, b: a / b,
        lambda a, b: a - -b,
        lambda a, b: (a < b) & (b <= a) | (a != b),
        lambda a, b: (a >= b) ^ (-a < -b),
        lambda a, b: jnp.where(~(a > b), a, b),
        lambda a, b: jnp.where(a > b, a > 0, b > 0),
        lambda a, b: jnp.where(a == b, True, b > 0),
    ],
)
def test_functions_of_two_floats(function):
    same_as_jax(function, A, B)


@pytest.mark.parametrize(
    "function",
    [
        lambda i, j: (i + j) * (i - j),
        *(lax.div, lax.rem),
        *(lax.shift_left, lax.shift_right_arithmetic, lax.shift_right_logical),
        lambda i, j: (i & j) ^ (i | 12) & ~j,
        lambda i, j: jnp.maximum(i, j) - jnp.minimum(i, 5) + jnp.clip(i, -3, j),
        lambda i, j: jnp.abs(i) + jnp.sign(j) + wrap16(i + j),
        lambda i, j: ((i + 3) + 4) - 7 + 0 * j,
        lambda i, j: lax.convert_element_type(i, jnp.float32) * 2.0**-24,
        lambda i, j: counter_random.random_uniform(lax.convert_element_type(i, jnp.uint32), j, 3),
        lambda i, j: jnp.where(i < j, i, j) == i,
    ],
)
def test_functions_of_integers(function):
    same_as_jax(function, I, J)


def same_as_jax(function, *columns):
    (got,) = semantics.run_program(lowered(function, *columns), columns)
    expected = np.asarray(jax.jit(jax.vmap(function))(*columns))
    same_bits(flushed(np.broadcast_to(np.asarray(got), expected.shape)), flushed(expected))


def flushed(x):
    """Subnormals as XLA has them."""
    tiny = (x.dtype.kind == "f") and np.abs(x) < np.finfo(np.float32).tiny
    return np.where(tiny, np.copysign(0.0, x), x).astype(x.dtype)


def test_simplifying_changes_no_bit(monkeypatch):
    """Random expressions of neg, zeros, ones, powers of two and choices, simplified and not."""
    programs = [random_program(seed) for seed in range(60)]
    monkeypatch.setattr(builder, "_simplify", lambda *_: None)
    shorter = 0
    for seed, program in enumerate(programs):
        plain = random_program(seed)
        shorter += len(plain.needed()) - len(program.needed())
        both = (semantics.run_program(x, [A, B]) for x in (program, plain))
        for pair in zip(*both, strict=True):
            same_bits(*(np.broadcast_to(x, A.shape).astype(x.dtype) for x in pair))
    assert shorter > 100


def random_program(seed: int) -> Program:
    rng, builder = np.random.default_rng(seed), Builder()
    floats = [builder.input("float32"), builder.input("float32")]
    floats += [builder.constant("float32", v) for v in (0.0, -0.0, 1.0, -1.0, 2.0, 0.25, 3.0)]
    truths = [builder.constant("bool", True), builder.constant("bool", False)]
    for _ in range(40):
        kinds = ["neg", "abs", "add", "sub", "mul", "div", "select", "chosen"]
        kind = rng.choice([*kinds, "lt", "le", "eq", "and", "or", "not"])
        if kind in ("lt", "le", "eq"):
            truths.append(builder.emit(kind, "bool", *rng.choice(floats, 2)))
        elif kind in ("and", "or", "not"):
            truths.append(builder.emit(kind, "bool", *rng.choice(truths, 1 + (kind != "not"))))
        elif kind == "chosen":
            truths.append(builder.emit("select", "bool", *rng.choice(truths, 3)))
        elif kind == "select":
            floats.append(builder.emit(kind, "float32", rng.choice(truths), *rng.choice(floats, 2)))
        else:
            operands = rng.choice(floats, 1 if kind in ("neg", "abs") else 2)
            floats.append(builder.emit(kind, "float32", *operands))
    return builder.program([*floats[-6:], *truths[-4:]])


def test_sums_of_products_are_contracted():
    program = contract_to_fma(lowered(lambda x, y: (x * y + 1.0) - y * y, A, B))
    names = [program.operations[i].name for i in program.needed()]
    assert [names.count(name) for name in ("fma", "mul", "add", "sub")] == [2, 0, 0, 0]
    (got,) = semantics.run_program(program, [A, B])
    with np.errstate(all="ignore"):
        same_bits(
            got, semantics.fma(-B, B, semantics.fma(A, B, np.float32(1.0))).astype(np.float32)
        )


def test_what_else_is_computed_changes_no_bit():
    alone = contract_to_fma(lowered(lambda x, y: x * y + 1.0, A, B))
    along = contract_to_fma(lowered(lambda x, y: (x * y + 1.0, x * y), A, B))
    same_bits(semantics.run_program(alone, [A, B])[0], semantics.run_program(along, [A, B])[0])


def test_tables_are_read_inside_only():
    table = np.arange(5, dtype=np.float32)

    def function(i, t):
        return t.at[i].get(mode="clip", wrap_negative_indices=False)

    closed = jax.make_jaxpr(function)(np.int32(0), table)
    (got,) = semantics.run_program(
        lowering.lower_jaxpr(closed), [np.array([-3, 0, 4, 9], np.int32)], [table]
    )
    np.testing.assert_array_equal(got, [0, 0, 4, 4])


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x: lax.erf_inv(x), "erf_inv"),
        (lambda x: lax.cumsum(jnp.stack([x, x])), "expected a single number"),
        (lambda x: lax.while_loop(lambda c: c < 3, lambda c: c + 1, x), "while"),
        (lambda x: lax.convert_element_type(x, jnp.int8), "int8"),
        (lambda x: lax.round(x), "round"),
    ],
)
def test_what_is_no_scalar_operation_is_refused_by_name(function, message):
    with pytest.raises(UnknownPrimitive, match=message):
        lowered(function, NORMAL)


def test_fma_rounds_once():
    rng = np.random.default_rng(2)
    a, b, c = (rng.standard_normal((3, 2000)) * 10.0 ** rng.integers(-3, 3, (3, 2000))).astype(
        np.float32
    )
    for x, y, z, got in zip(a, b, c, semantics.fma(a, b, c), strict=True):
        exact = Fraction(float(x)) * Fraction(float(y)) + Fraction(float(z))
        error = abs(Fraction(float(got)) - exact)
        for end in (np.float32(np.inf), np.float32(-np.inf)):
            neighbour = np.nextafter(got, end)
            assert error <= abs(Fraction(float(neighbour)) - exact)


@pytest.mark.parametrize(
    "function", [jnp.tanh, lambda x: jnp.fmod(x, 2.0), lambda x: lax.convert_element_type(x, int)]
)
def test_what_only_the_library_has_is_refused_to_other_targets(function):
    with jax.enable_x64(True):
        closed = jax.make_jaxpr(function)(jax.ShapeDtypeStruct((), np.float64))
    with pytest.raises(UnknownPrimitive, match="supported"):
        lowering.lower_jaxpr(closed)
    (got,) = semantics.run_program(
        lowering.lower_jaxpr(closed, functions="library"), [np.float64(2.75)]
    )
    assert got == pytest.approx(float(function(2.75)), abs=1e-6)


def test_constant_tables_are_choices():
    (got,) = semantics.run_program(
        lowered(lambda i: jnp.array([1.0, 2.0, 4.0])[i], HARD_INTEGERS[:1]),
        [np.array([0, 1, 2], np.int32)],
    )
    np.testing.assert_array_equal(got, [1.0, 2.0, 4.0])
