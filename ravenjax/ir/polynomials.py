"""Computes sine, arc tangent and similar functions in float32, with the same bits on every engine.

The functions use only sums, products, choices and bit operations. Their argument `Arithmetic`
defines these operations, either for NumPy arrays or to build a straight-line program. The
coefficients are in polynomials.toml. The largest errors, compared with the exact value, in units in
the last place (ulp) of a float32 near the result:

    sin, cos      2e-7 absolute (sin near 0: 2 ulp) if |x| <= 1e6; for larger |x| any value in -1..1
    tan           sin / cos
    atan, atan2   3 ulp; every quadrant, zero and infinity as C has them
    asin, acos    4 ulp, 5e-7 absolute; NaN outside [-1, 1]
    exp           2 ulp, subnormal results included
    log           2 ulp

sin, cos and tan of infinities are NaN. All functions of NaN are NaN.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ravenjax import resources

Number = Any

_COEFFICIENTS = resources.read_tables(__file__, "polynomials.toml")
_SMALLEST = float(np.finfo(np.float32).smallest_subnormal)
_TINY = float(np.finfo(np.float32).tiny)
_SIGN_BIT = -(2**31)


@dataclasses.dataclass(frozen=True)
class Arithmetic:
    """Operations on float32 numbers, with `emit` and `constant` of `builder.Builder`."""

    emit: Callable[..., Number]
    constant: Callable[[str, Any], Number]

    def __getattr__(self, name: str) -> Callable[..., Number]:
        """Return operation `name` of floats; a Python number among its operands is a constant."""
        return lambda *operands: self.emit(name, "float32", *map(self.number, operands))

    def number(self, value: Number) -> Number:
        """Return the constant for a Python float, and other numbers unchanged."""
        return self.constant("float32", value) if type(value) is float else value

    def less(self, a: Number, b: Number) -> Number:
        """Return whether a < b."""
        return self.emit("lt", "bool", self.number(a), self.number(b))

    def bits(self, x: Number) -> Number:
        """Return the bit pattern, an int32."""
        return self.emit("bitcast", "int32", x)

    def from_bits(self, pattern: Number) -> Number:
        """Return the float of a bit pattern."""
        return self.emit("bitcast", "float32", pattern)

    def integer(self, name: str, a: Number, b: int) -> Number:
        """Return operation `name` of an int32 and a constant int32."""
        return self.emit(name, "int32", a, self.constant("int32", b))

    def polynomial(self, name: str, x: Number) -> Number:
        """Evaluate a polynomial of polynomials.toml by Horner's rule."""
        *coefficients, last = _COEFFICIENTS[name]
        result = self.number(last)
        for coefficient in reversed(coefficients):
            result = self.fma(result, x, coefficient)
        return result


_MAGIC = 1.5 * 2.0**23
"""A sum of this number and a small float32 is an integer: the float32 is rounded to an integer."""
# The float32 below pi. Both parts of pi are then positive, so that a zero keeps its sign.
_PI_HIGH = 3.141592502593994
_PI_LOW = 1.509957990978376e-7


def _half_turns(m: Arithmetic, x: Number):
    """Return r = x - k pi, r^2, and a sign bit that is set if k is odd; k is x / pi, rounded."""
    # This sum is rounded to the integer k + _MAGIC. Its last bit is set if k is odd.
    shifted = m.fma(x, 1.0 / math.pi, _MAGIC)
    turns = m.sub(shifted, _MAGIC)
    rest = m.fma(turns, -_PI_LOW, m.fma(turns, -_PI_HIGH, x))
    # The limits have an effect only if |x| > 1e6.
    rest = m.max(-1.7, m.min(1.7, rest))
    # The last bit of `shifted` moves to the place of the sign bit.
    return rest, m.mul(rest, rest), m.integer("shl", m.bits(shifted), 31)


def _flip_sign(m: Arithmetic, x: Number, sign: Number) -> Number:
    # Returns x, or -x if `sign` has the sign bit of a float32 set.
    return m.from_bits(m.emit("xor", "int32", m.bits(x), sign))


def sin(m: Arithmetic, x: Number) -> Number:
    """Return the sine of an angle in rad."""
    rest, square, sign = _half_turns(m, x)
    return _flip_sign(m, m.mul(rest, m.polynomial("sin", square)), sign)


def cos(m: Arithmetic, x: Number) -> Number:
    """Return the cosine of an angle in rad."""
    _, square, sign = _half_turns(m, x)
    return _flip_sign(m, m.polynomial("cos", square), sign)


def tan(m: Arithmetic, x: Number) -> Number:
    """Return the tangent of an angle in rad."""
    return m.div(sin(m, x), cos(m, x))


def atan2(m: Arithmetic, y: Number, x: Number) -> Number:
    """Return the angle of the point (x, y), rad in [-pi, pi]."""
    # First the angle in [0, pi/4] of the point (larger, smaller): the sizes of x and y, sorted.
    x_size, y_size = m.abs(x), m.abs(y)
    is_steep = m.less(x_size, y_size)
    smaller, larger = m.select(is_steep, x_size, y_size), m.select(is_steep, y_size, x_size)
    larger = m.max(_SMALLEST, larger)  # 0 divided by 0 gives 0
    are_equal = m.emit("eq", "bool", smaller, larger)
    ratio = m.select(are_equal, 1.0, m.div(smaller, larger))  # infinity divided by infinity gives 1
    square = m.mul(ratio, ratio)
    angle = m.fma(m.mul(ratio, square), m.polynomial("atan", square), ratio)
    # Then mirrored into the octant and quadrant of (x, |y|). The angle has the sign of y.
    angle = m.select(is_steep, m.sub(math.pi / 2, angle), angle)
    is_negative = m.emit("lt", "bool", m.bits(x), m.constant("int32", 0))  # also for x = -0
    angle = m.select(is_negative, m.sub(math.pi, angle), angle)
    sign = m.integer("and", m.bits(y), _SIGN_BIT)
    return m.from_bits(m.emit("or", "int32", sign, m.bits(angle)))


def atan(m: Arithmetic, x: Number) -> Number:
    """Return the arc tangent, rad."""
    return atan2(m, x, m.number(1.0))


def _leg(m: Arithmetic, x: Number) -> Number:
    """Return sqrt(1 - x x), the second leg of a right triangle; NaN outside [-1, 1]."""
    return m.sqrt(m.mul(m.sub(1.0, x), m.add(1.0, x)))


def asin(m: Arithmetic, x: Number) -> Number:
    """Return the arc sine, rad in [-pi/2, pi/2]."""
    return atan2(m, x, _leg(m, x))


def acos(m: Arithmetic, x: Number) -> Number:
    """Return the arc cosine, rad in [0, pi]."""
    return atan2(m, _leg(m, x), x)


_LN2_HIGH = 0.693359375
_LN2_LOW = -2.1219444e-4


def _power_of_two(m: Arithmetic, exponent: Number) -> Number:
    """Return 2 to an integer power in [-126, 127]."""
    # A float32 has the exponent plus 127 in the bits from 23 on.
    return m.from_bits(m.integer("shl", m.integer("add", exponent, 127), 23))


def exp(m: Arithmetic, x: Number) -> Number:
    """Return e to the power of x."""
    # e^x = 2^whole e^rest
    x = m.max(-105.0, m.min(89.0, x))  # outside these limits the result is 0 or infinity
    whole = m.round(m.mul(x, 1.0 / math.log(2.0)))
    rest = m.fma(whole, -_LN2_LOW, m.fma(whole, -_LN2_HIGH, x))
    value = m.polynomial("exp", rest)
    power = m.emit("truncate", "int32", whole)
    # Two factors (sar halves the power), because 2^-150 and 2^128 are not float32 numbers.
    half = m.integer("sar", power, 1)
    other_half = m.emit("sub", "int32", power, half)
    return m.mul(m.mul(value, _power_of_two(m, half)), _power_of_two(m, other_half))


def log(m: Arithmetic, x: Number) -> Number:
    """Return the natural logarithm; -infinity at 0, NaN below."""
    # x = 2^power mantissa, and log(mantissa) is a polynomial of rest = mantissa - 1. A subnormal x
    # is multiplied by 2^23 first, so that its mantissa has all bits.
    subnormal = m.less(x, _TINY)
    pattern = m.bits(m.select(subnormal, m.mul(x, 2.0**23), x))
    # The constant has the bits of sqrt(1/2): the mantissa then lies in [sqrt(1/2), sqrt(2)].
    exponent = m.integer("sar", m.integer("sub", pattern, 0x3F3504F3), 23)
    mantissa = m.emit("sub", "int32", pattern, m.integer("shl", exponent, 23))
    power = m.add(m.emit("convert", "float32", exponent), m.select(subnormal, -23.0, 0.0))
    rest = m.sub(m.from_bits(mantissa), 1.0)
    square = m.mul(rest, rest)
    tail = m.polynomial("log", rest)
    tail = m.fma(power, _LN2_LOW, m.mul(m.mul(rest, square), tail))
    value = m.fma(power, _LN2_HIGH, m.add(rest, m.fma(square, -0.5, tail)))
    value = m.select(m.less(x, math.inf), value, x)  # infinity and NaN
    value = m.select(m.less(x, 0.0), math.nan, value)
    return m.select(m.emit("eq", "bool", x, m.number(0.0)), -math.inf, value)


FUNCTIONS: dict[str, Callable[..., Number]] = {
    function.__name__: function for function in (sin, cos, tan, atan, atan2, asin, acos, exp, log)
}
"""Functions by the name of JAX's primitive."""
