"""Points in the unit cube, spread evenly: what SciPy's `qmc` draws, bit for bit, without its second
of import.

The scrambled Sobol' sequence has the direction numbers of S. Joe, F. Y. Kuo, "Constructing Sobol
sequences with better two-dimensional projections", SIAM J. Sci. Comput. 30 (2008) 2635, a linear
matrix scramble and a digital shift, as `scipy.stats.qmc.Sobol` has them. SciPy itself draws where
the table below ends.
"""

from __future__ import annotations

import warnings

import numpy as np

_BITS = 30  # of a coordinate
# a dimension each, from the second on: its primitive polynomial, then its first direction numbers
_DIRECTIONS = (
    (3, 1),
    (7, 1, 3),
    (11, 1, 3, 1),
    (13, 1, 1, 1),
    (19, 1, 1, 3, 3),
    (25, 1, 3, 5, 13),
    (37, 1, 1, 5, 5, 17),
    (41, 1, 1, 5, 5, 5),
    (47, 1, 1, 7, 11, 19),
    (55, 1, 1, 5, 1, 1),
    (59, 1, 1, 1, 3, 11),
    (61, 1, 3, 5, 5, 31),
    (67, 1, 3, 3, 9, 7, 49),
    (91, 1, 1, 1, 15, 21, 21),
    (97, 1, 3, 1, 13, 27, 49),
)


def latin_hypercube(rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    """[rows, dimensions] in [0, 1]: along each dimension one point in each of `rows` equal
    intervals.
    """
    own = rng.spawn(1)[0]
    within = own.uniform(size=(rows, dimensions))
    intervals = np.tile(np.arange(1, rows + 1), (dimensions, 1))
    for row in intervals:
        own.shuffle(row)
    return (intervals.T - within) / rows


def sobol(rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    """[rows, dimensions] in [0, 1): the first points of a scrambled Sobol' sequence."""
    if dimensions > len(_DIRECTIONS) + 1 or rows > 2**_BITS:
        return _by_scipy(rows, dimensions, rng)
    own = rng.spawn(1)[0]
    shift = own.integers(0, 2, size=(dimensions, _BITS), dtype=np.uint32) @ (
        1 << np.arange(_BITS, dtype=np.uint32)
    )
    lower = np.tril(own.integers(0, 2, size=(dimensions, _BITS, _BITS), dtype=np.uint32))
    directions = _scrambled(_directions(dimensions), lower)
    number = np.arange(rows, dtype=np.uint32)
    gray = number ^ (number >> 1)
    points = np.tile(shift.astype(np.uint32), (rows, 1))
    for bit in range(_BITS):
        points ^= np.where((gray >> bit & 1)[:, None] == 1, directions[:, bit], np.uint32(0))
    return points * (1.0 / 2**_BITS)


def _directions(dimensions: int) -> np.ndarray:
    """Direction numbers [dimensions, bits], the first bit the greatest."""
    numbers = np.ones((dimensions, _BITS), np.uint32)
    for row, (polynomial, *first) in zip(numbers[1:], _DIRECTIONS, strict=False):
        degree = len(first)
        row[:degree] = first
        for j in range(degree, _BITS):
            row[j] = row[j - degree]
            for k in range(1, degree + 1):
                if polynomial >> (degree - k) & 1:
                    row[j] ^= row[j - k] << np.uint32(k)
    return numbers << np.arange(_BITS - 1, -1, -1, dtype=np.uint32)


def _scrambled(directions: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """The numbers, as vectors of bits, times a lower triangular matrix of bits a dimension, its
    diagonal ones.
    """
    places = np.arange(_BITS - 1, -1, -1, dtype=np.uint32)
    bits = directions[:, :, None] >> places & 1  # the greatest first
    matrix = lower | np.eye(_BITS, dtype=np.uint32)
    product = np.einsum("dpk,djk->djp", matrix, bits) & 1
    return (product << places).sum(axis=2, dtype=np.uint32)


def _by_scipy(rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    from scipy.stats import qmc  # slow to import

    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # balance properties of counts that are no power of two
        return qmc.Sobol(dimensions, rng=rng).random(rows)
