"""Polynomials against float64 functions over the ranges and at the edges that their accuracy is
stated for.
"""

import numpy as np
import pytest
from compiled_program import HARD_FLOATS, pairs

from ravenjax.ir import polynomials, semantics

EXACT = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "exp": np.exp,
    "log": np.log,
}
RNG = np.random.default_rng(5)


def in_numpy(name, *operands):
    """Function `name` of float32 arrays, operation by operation."""
    arithmetic = polynomials.Arithmetic(
        lambda operation, dtype, *values: semantics.evaluate_operation(operation, dtype, values),
        lambda dtype, value: np.asarray(value, dtype)[()],
    )
    return polynomials.FUNCTIONS[name](arithmetic, *(np.asarray(x, np.float32) for x in operands))


def uniform(low, high, size=200_000):
    return RNG.uniform(low, high, size).astype(np.float32)


def errors(name, *columns):
    """Largest absolute error, and largest error in units of the last place of the exact value."""
    got = in_numpy(name, *columns).astype(np.float64)
    exact = EXACT[name](*(c.astype(np.float64) for c in columns))
    return (
        np.abs(got - exact).max(),
        (np.abs(got - exact) / np.spacing(np.abs(exact).astype(np.float32))).max(),
    )


@pytest.mark.parametrize("name", ["sin", "cos"])
@pytest.mark.parametrize("reach", [1.6, 7.0, 1e3, 1e6])
def test_sine_and_cosine(name, reach):
    assert errors(name, uniform(-reach, reach))[0] < 2e-7


def test_sine_is_relatively_exact_near_zero():
    assert errors("sin", uniform(-0.5, 0.5))[1] < 2.0
    assert errors("sin", (10.0 ** uniform(-37, -1)).astype(np.float32))[1] < 2.0


def test_sine_and_cosine_stay_bounded_beyond_their_range():
    huge = (10.0 ** uniform(6, 38)).astype(np.float32)
    for name in ("sin", "cos"):
        assert np.abs(in_numpy(name, huge)).max() <= 1.0


@pytest.mark.parametrize(
    ("name", "columns", "absolute", "ulp"),
    [
        ("tan", (uniform(-1.2, 1.2),), 2e-6, 8.0),
        ("asin", (uniform(-1, 1),), 2e-7, 3.0),
        ("acos", (uniform(-1, 1),), 5e-7, 3.0),
        ("atan", (uniform(-20, 20),), 2e-7, 3.0),
        ("atan2", (uniform(-1, 1), uniform(-1, 1)), 3e-7, 3.0),
        ("atan2", (np.exp(uniform(-80, 80)), np.exp(uniform(-80, 80))), 3e-7, 3.0),
        ("exp", (uniform(-87, 88.7),), np.inf, 2.0),
        ("exp", (uniform(-103, -87),), 2e-45, 2.0),
        ("log", (uniform(0.5, 2.0),), 1e-7, 2.0),
        ("log", (np.exp(uniform(-87, 88)),), 1e-5, 2.0),
        ("log", (uniform(1e-44, 1e-38),), 1e-5, 2.0),
    ],
)
def test_accuracy(name, columns, absolute, ulp):
    got = errors(name, *columns)
    assert got[0] <= absolute
    assert got[1] <= ulp


@pytest.mark.parametrize("name", [name for name in EXACT if name != "atan2"])
def test_zeros_infinities_nan_and_subnormals(name):
    with np.errstate(all="ignore"):
        beyond = (
            (np.abs(HARD_FLOATS) > 1e6) & np.isfinite(HARD_FLOATS) & (name in ("sin", "cos", "tan"))
        )
        x = HARD_FLOATS[~beyond]
        agree(in_numpy(name, x), EXACT[name](x))


def test_every_quadrant_zero_and_infinity():
    with np.errstate(all="ignore"):
        y, x = pairs(HARD_FLOATS)
        agree(in_numpy("atan2", y, x), np.arctan2(y, x))


def agree(got, exact):
    """Signs of zeros and NaN exact, numbers within their accuracy."""
    assert np.array_equal(np.isnan(got), np.isnan(exact))
    there = ~np.isnan(exact)
    small = np.abs(exact[there]) < 1e6
    np.testing.assert_allclose(got[there][small], exact[there][small], rtol=1e-6, atol=2.5e-7)
    np.testing.assert_array_equal(np.signbit(got[there]), np.signbit(exact[there]))
    infinite = np.isinf(exact)
    np.testing.assert_array_equal(got[infinite], exact[infinite])
