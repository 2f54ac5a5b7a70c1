"""Solves a small symmetric positive definite linear system, unrolled."""

from __future__ import annotations

from ravenjax.numbers.algebra import mul, sub
from ravenjax.numbers.vec import Scalar, Vec


def solve_spd(matrix: tuple[Vec, ...], right: Vec) -> Vec:
    """Return x of matrix x = right, by the factorisation matrix = L^T D L.

    Only the lower triangle is read, and nothing is computed with literal zeros. Elimination runs
    from the last row to the first: for the mass matrix of a tree, parents before children, no
    structural zero fills in (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5). x
    has the unit of `right` divided by that of `matrix`. A matrix that is not positive definite
    gives infinities or NaN, not an error.
    """
    n = len(right)
    lower = [list(row) for row in matrix]
    x: list[Scalar] = list(right)
    inverse: list[Scalar] = [0.0] * n
    for k in reversed(range(n)):
        inverse[k] = 1.0 / lower[k][k]
        unit = [mul(lower[k][j], inverse[k]) for j in range(k)]
        for i in range(k):
            for j in range(i + 1):
                lower[i][j] = sub(lower[i][j], mul(unit[i], lower[k][j]))
            x[i] = sub(x[i], mul(unit[i], x[k]))
        lower[k][:k] = unit
    for k in range(n):
        x[k] = mul(x[k], inverse[k])
        for j in range(k):
            x[k] = sub(x[k], mul(lower[k][j], x[j]))
    return Vec(x)
