"""Linear algebra on small vectors and matrices that leaves out literal zeros and ones.

Vectors are `Vec`s. Matrices are `Vec`s of row `Vec`s, of any size. A Python `0`, `1` or `-1` among
the factors is treated as part of the program, not as data: `0 * x` is `0` and `0 + x` is `x`. Such
products therefore add no code to the compiled tick.
"""

from functools import reduce

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec


def _is_literal(x: Scalar, value: int) -> bool:
    """Return whether x is the Python number `value`. NumPy and JAX numbers count as data."""
    return type(x) in (int, float) and x == value


def mul(a: Scalar, b: Scalar) -> Scalar:
    """Return a b."""
    if _is_literal(a, 0) or _is_literal(b, 0):
        return 0.0
    for factor, other in ((a, b), (b, a)):
        if _is_literal(factor, 1):
            return other
        if _is_literal(factor, -1):
            return -other
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """Return a + b."""
    if _is_literal(a, 0):
        return b
    return a if _is_literal(b, 0) else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """Return a - b."""
    if _is_literal(b, 0):
        return a
    return -b if _is_literal(a, 0) else a - b


def scale(factor: Scalar, v: Vec) -> Vec:
    """Return factor v."""
    return v.map(lambda x: mul(factor, x))


def plus(a: Vec, b: Vec) -> Vec:
    """Return the sum of two vectors."""
    return a.map(add, b)


def minus(a: Vec, b: Vec) -> Vec:
    """Return a - b of two vectors."""
    return a.map(sub, b)


def dot(a: Vec, b: Vec) -> Scalar:
    """Return the dot product, summed from the first component on."""
    return reduce(add, a.map(mul, b))


def cross(a: Vec, b: Vec) -> Vec:
    """Return the cross product of two 3-vectors."""
    return Vec(sub(mul(a[i], b[j]), mul(a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1)))


def norm(v: Vec) -> Scalar:
    """Return the Euclidean length of a vector; its derivative at 0 is not defined."""
    return jnp.sqrt(dot(v, v))


def transpose(m: Vec) -> Vec:
    """Return the transpose of a matrix."""
    return Vec(Vec(column) for column in zip(*m, strict=True))


def matvec(m: Vec, v: Vec) -> Vec:
    """Return the product of a matrix and a vector."""
    return Vec(dot(row, v) for row in m)


def matmul(a: Vec, b: Vec) -> Vec:
    """Return the product of two matrices."""
    columns = transpose(b)
    return Vec(Vec(dot(row, column) for column in columns) for row in a)


def matrix(*rows: tuple[Scalar, ...]) -> Vec:
    """Return the matrix that has these rows."""
    return Vec(Vec(row) for row in rows)


def solve_spd(matrix: tuple[Vec, ...], right: Vec) -> Vec:
    """Return x of matrix x = right, by the factorisation matrix = L^T D L.

    Only the lower triangle is read, and literal zeros cost nothing. Elimination begins with the
    last row. For the mass matrix of a kinematic tree with parents before children, literal zeros
    then remain zeros (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5). x has
    the unit of `right` divided by that of `matrix`. A matrix that is not positive definite gives
    infinities or NaN, not an error.
    """
    n = len(right)
    # Becomes L below its diagonal, where L has ones. Its diagonal becomes D.
    lower = [list(row) for row in matrix]
    x: list[Scalar] = list(right)
    inverse: list[Scalar] = [0.0] * n
    # Factorisation, which gives row k of L and D[k], and solution with L^T.
    for k in reversed(range(n)):
        inverse[k] = 1.0 / lower[k][k]
        unit = [mul(lower[k][j], inverse[k]) for j in range(k)]
        for i in range(k):
            for j in range(i + 1):
                lower[i][j] = sub(lower[i][j], mul(unit[i], lower[k][j]))
            x[i] = sub(x[i], mul(unit[i], x[k]))
        lower[k][:k] = unit
    # Solution with D and L.
    for k in range(n):
        x[k] = mul(x[k], inverse[k])
        for j in range(k):
            x[k] = sub(x[k], mul(lower[k][j], x[j]))
    return Vec(x)
