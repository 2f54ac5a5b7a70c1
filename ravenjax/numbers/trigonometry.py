"""Sine and cosine in float64, for numbers and arrays, with the same bits on every machine.

The C libraries of different machines differ in the last bit. These functions consist of sums and
products, each rounded as IEEE 754 requires. Angles are in rad, at most 1e5. Error: up to 0.6 ulp.

The angle is reduced by a multiple of pi/2, which is stored in three parts. The polynomials are
those of FreeBSD msun, `k_sin.c` and `k_cos.c`.
"""

from typing import TypeVar

import numpy as np

Real = TypeVar("Real", float, np.ndarray)

_PI_2_PARTS = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_ROUNDER = 1.5 * 2.0**52
"""After this is added to a small float64, its fraction is rounded away."""
_SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def sin(x: Real) -> Real:
    """Return the sine of an angle."""
    return _sine(x, 0)


def cos(x: Real) -> Real:
    """Return the cosine of an angle."""
    return _sine(x, 1)


def _sine(x: Real, quarters: int) -> Real:
    """Return the sine of x + quarters * pi/2. x is a multiple of pi/2 plus an angle of at most
    pi/4. The sine and the cosine of this angle are polynomials. The multiple determines which of
    them is the result, and its sign.
    """
    # Number of quarter turns: x times 2/pi, rounded.
    turns = (x * 0.6366197723675814 + _ROUNDER) - _ROUNDER
    high, middle = x - turns * _PI_2_PARTS[0], turns * _PI_2_PARTS[1]
    angle = high - middle
    # What rounding removed from the angle. It is added below as in k_sin.c and k_cos.c.
    tail = ((high - angle) - middle) - turns * _PI_2_PARTS[2]
    square = angle * angle
    half = 0.5 * square
    sine = angle + (angle * square * _polynomial(square, _SIN) + tail * (1.0 - half))
    rounded = 1.0 - half
    # The later terms of the cosine. Rounding removed (1 - rounded) - half from the first two.
    last = square * square * _polynomial(square, _COS) - angle * tail
    cosine = rounded + (((1.0 - rounded) - half) + last)
    # Quadrants 0 and 2 are the sine and its negative, 1 and 3 the cosine and its negative. The
    # choice is by multiplication, so that x may be an array. odd: 0 or 1.
    quadrant = (turns + quarters) % 4
    odd = quadrant % 2
    sign = 1.0 - (quadrant - odd)
    return sign * (sine * (1.0 - odd) + cosine * odd)


def _polynomial(x: Real, coefficients: tuple[float, ...]) -> Real:
    result = x * 0.0
    for coefficient in reversed(coefficients):
        result = result * x + coefficient
    return result
