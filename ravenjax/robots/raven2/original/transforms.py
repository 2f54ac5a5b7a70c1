"""Transforms and quaternions with the operations of ROS tf in their order, so that results equal it
bit for bit.

Source: ros/geometry `tf/LinearMath/{Transform,Matrix3x3,Vector3}.h`. Products with a literal 0 or 1
are left out, which changes no bit but the sign of a zero. Products of quaternions and their
matrices are those of `mapping`, which has tf's order already.
"""

from __future__ import annotations

from typing import NamedTuple

from ravenjax.numbers.algebra import dot, matmul, matrix, matvec, mul, plus, sub, transpose
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec


class Transform(NamedTuple):
    """Of points in one frame to another frame."""

    rotation: Vec  # 3 rows of 3
    origin: Vec  # 3, m


def product(a: Transform, b: Transform) -> Transform:
    """a b."""
    return Transform(matmul(a.rotation, b.rotation), apply(a, b.origin))


def apply(transform: Transform, point: Vec) -> Vec:
    """The point (3, m) in the other frame."""
    return plus(matvec(transform.rotation, point), transform.origin)


def inverse(transform: Transform) -> Transform:
    """Of a rigid transform: by the transpose."""
    transposed = transpose(transform.rotation)
    return Transform(transposed, matvec(transposed, -transform.origin))


def inverse_matrix(m: Vec) -> Vec:
    """Inverse of a 3 x 3 matrix by cofactors, also of a rotation: the transpose would differ in
    the last bits.
    """

    def cofactor(r1: int, c1: int, r2: int, c2: int) -> Scalar:
        return sub(mul(m[r1][c1], m[r2][c2]), mul(m[r1][c2], m[r2][c1]))

    rows = (
        (cofactor(1, 1, 2, 2), cofactor(0, 2, 2, 1), cofactor(0, 1, 1, 2)),
        (cofactor(1, 2, 2, 0), cofactor(0, 0, 2, 2), cofactor(0, 2, 1, 0)),
        (cofactor(1, 0, 2, 1), cofactor(0, 1, 2, 0), cofactor(0, 0, 1, 1)),
    )
    scale = 1.0 / dot(m[0], Vec(row[0] for row in rows))
    return matrix(*(tuple(mul(x, scale) for x in row) for row in rows))


def quat_from_matrix(rotation: Vec) -> Vec:
    """Quaternion (x, y, z, w) of a rotation matrix, from its trace, or from its greatest diagonal
    element if that is not positive. The component in question is half a root, the others are
    divided by twice it."""
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = rotation
    trace = m00 + m11 + m22
    dx, dy, dz = m21 - m12, m02 - m20, m10 - m01
    sxy, sxz, syz = m10 + m01, m20 + m02, m21 + m12
    by_w = trace > 0.0
    use_z = jnp.where(m00 < m11, m11 < m22, m00 < m22)
    by_z, by_y = ~by_w & use_z, ~by_w & ~use_z & (m00 < m11)
    by_x = ~(by_w | by_z | by_y)

    def choose(w: Scalar, x: Scalar, y: Scalar, z: Scalar) -> Scalar:
        return jnp.where(by_w, w, jnp.where(by_z, z, jnp.where(by_y, y, x)))

    root = jnp.sqrt(choose(trace, m00 - m11 - m22, m11 - m22 - m00, m22 - m00 - m11) + 1.0)
    half, factor = root * 0.5, 0.5 / root
    others = (
        choose(dx, 0.0, sxy, sxz),
        choose(dy, sxy, 0.0, syz),
        choose(dz, sxz, syz, 0.0),
        choose(0.0, dx, dy, dz),
    )
    return Vec(
        jnp.where(own, half, other * factor)
        for own, other in zip((by_x, by_y, by_z, by_w), others, strict=True)
    )
