"""Small linear algebra on single numbers, in which literal zeros and ones drop out.

Vectors are `Vec`s, matrices `Vec`s of row `Vec`s of any size. A Python `0`, `1` or `-1` among the
factors is taken as structure, not as data: `0 * x` is `0` and `0 + x` is `x`, so that products with
sparse constants trace to nothing.
"""

from __future__ import annotations

from functools import reduce

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec


def _is(x: Scalar, value: int) -> bool:
    """Whether x is the literal `value`; NumPy and JAX numbers are data and never are."""
    return type(x) in (int, float) and x == value


def mul(a: Scalar, b: Scalar) -> Scalar:
    """a b."""
    if _is(a, 0) or _is(b, 0):
        return 0.0
    for factor, other in ((a, b), (b, a)):
        if _is(factor, 1):
            return other
        if _is(factor, -1):
            return -other
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """a + b."""
    if _is(a, 0):
        return b
    return a if _is(b, 0) else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """a - b."""
    if _is(b, 0):
        return a
    return -b if _is(a, 0) else a - b


def scale(factor: Scalar, v: Vec) -> Vec:
    """factor v."""
    return v.map(lambda x: mul(factor, x))


def plus(a: Vec, b: Vec) -> Vec:
    """a + b of vectors."""
    return a.map(add, b)


def minus(a: Vec, b: Vec) -> Vec:
    """a - b of vectors."""
    return a.map(sub, b)


def dot(a: Vec, b: Vec) -> Scalar:
    """a . b, summed from the first component on."""
    return reduce(add, a.map(mul, b))


def cross(a: Vec, b: Vec) -> Vec:
    """a x b of 3-vectors."""
    return Vec(sub(mul(a[i], b[j]), mul(a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1)))


def norm(v: Vec) -> Scalar:
    """Euclidean length; its derivative at 0 is not defined."""
    return jnp.sqrt(dot(v, v))


def transpose(m: Vec) -> Vec:
    """Rows become columns."""
    return Vec(Vec(column) for column in zip(*m, strict=True))


def matvec(m: Vec, v: Vec) -> Vec:
    """m v."""
    return Vec(dot(row, v) for row in m)


def matmul(a: Vec, b: Vec) -> Vec:
    """a b of matrices."""
    columns = transpose(b)
    return Vec(Vec(dot(row, column) for column in columns) for row in a)


def matrix(*rows: tuple[Scalar, ...]) -> Vec:
    """A matrix from its rows."""
    return Vec(Vec(row) for row in rows)
