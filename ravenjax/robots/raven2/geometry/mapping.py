"""Converts motions between the axes of the console's packets and frame 0 of an arm; quaternions.

Quaternions are (x, y, z, w). Sources: raven2 `src/raven/mapping.cpp` (axes; the variant
ORIENTATION_V is not compiled) and `local_io.cpp` (quaternions), with the conversions of ROS tf.
"""

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, jnp
from ravenjax.numbers.algebra import matmul, matrix, matvec, norm, transpose

_AXES = resources.read_tables(__file__, "mapping.toml")
ITP_AXES = {arm: matrix(*rows) for arm, rows in _AXES.items()}
"""Rotation from the axes of an ITP packet to frame 0 of the arm."""


def position_from_itp(arm: str, position: Vec) -> Vec:
    """Return a displacement (3, any unit) along the axes of an ITP packet in frame 0."""
    return matvec(ITP_AXES[arm], position)


def position_to_itp(arm: str, position: Vec) -> Vec:
    """Return a displacement (3, any unit) in frame 0 along the axes of an ITP packet."""
    return matvec(transpose(ITP_AXES[arm]), position)


def rotation_from_itp(arm: str, rotation: Vec) -> Vec:
    """Return a rotation matrix (3 rows) of an ITP packet in frame 0."""
    axes = ITP_AXES[arm]
    return matmul(matmul(axes, rotation), transpose(axes))


def quat_from_itp(arm: str, quat: Vec) -> Vec:
    """Return the quaternion of an ITP packet in frame 0, normalised; NaN if its length is zero. The
    original computes it from matrices, and its quaternion may have the opposite sign.
    """
    inverse_norm = 1.0 / norm(quat)
    return Vec((*matvec(ITP_AXES[arm], Vec(quat[:3])), quat[3])) * inverse_norm


def quat_mul(a: Vec, b: Vec) -> Vec:
    """Return the quaternion product a b: rotation b followed by rotation a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return Vec(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz,
        )
    )


def matrix_from_quat(quat: Vec) -> Vec:
    """Return the rotation matrix (3 rows) of a quaternion of any length; NaN for length zero."""
    x, y, z, w = quat
    s = 2.0 / (x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    wx, wy, wz = w * xs, w * ys, w * zs
    xx, xy, xz = x * xs, x * ys, x * zs
    yy, yz, zz = y * ys, y * zs, z * zs
    return matrix(
        (1.0 - (yy + zz), xy - wz, xz + wy),
        (xy + wz, 1.0 - (xx + zz), yz - wx),
        (xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def quat_from_matrix(rotation: Vec) -> Vec:
    """Return the unit quaternion of a rotation matrix (3 rows). It is computed from the trace if
    the trace is positive, otherwise from the largest diagonal element.
    """
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = rotation
    trace = m00 + m11 + m22
    dx, dy, dz = m21 - m12, m02 - m20, m10 - m01
    sxy, sxz, syz = m01 + m10, m02 + m20, m12 + m21
    # times_x is the quaternion times 4 x, times_y the quaternion times 4 y, and so on
    times_x = 1.0 + m00 - m11 - m22, sxy, sxz, dx
    times_y = sxy, 1.0 + m11 - m00 - m22, syz, dy
    times_z = sxz, syz, 1.0 + m22 - m00 - m11, dz
    times_w = dx, dy, dz, 1.0 + trace
    y_exceeds_x, z_exceeds_y, z_exceeds_x = m00 < m11, m11 < m22, m00 < m22

    def choose(w: Scalar, x: Scalar, y: Scalar, z: Scalar):
        # Returns the argument that belongs to a component (w, x, y or z) that is not near 0.
        use_z = jnp.where(y_exceeds_x, z_exceeds_y, z_exceeds_x)
        return jnp.where(trace > 0.0, w, jnp.where(use_z, z, jnp.where(y_exceeds_x, y, x)))

    # The chosen multiple has the length 4 c, and its own entry, 4 c^2, gives c
    factor = 0.5 / jnp.sqrt(choose(times_w[3], times_x[0], times_y[1], times_z[2]))
    multiples = zip(times_w, times_x, times_y, times_z, strict=True)
    return Vec(choose(*entries) for entries in multiples) * factor
