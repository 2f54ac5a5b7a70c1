"""Computes kinematics, gravity and quaternions with the original software's operations.

If the wrist is straight, the original's roll is a quotient of two numbers that are mostly rounding
error. Code that is to give the original's DAC counts must therefore round where the original
rounds. `geometry` computes the same quantities equally exactly and with far fewer operations.
`select_evaluation` selects one of the two. The operations of the original help only if results are
also rounded as in the original (precision `ORIGINAL`).

Sources: raven2 `src/raven/r2_kinematics.cpp`, `include/raven/r2_kinematics.h`,
`src/raven/grav_comp.cpp` (compiled without fused operations); transforms and quaternions are those
of ROS tf (ros/geometry `tf/LinearMath/{Transform,Matrix3x3,Vector3}.h`). All are in double
precision. Products with a constant 0 or 1 are left out, which changes no bit but the sign of a
zero. `mapping` computes products and matrices of quaternions in the order of operations of tf.
"""

import math
from collections.abc import Callable
from functools import partial, reduce
from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, algebra, as_int, jnp, where
from ravenjax.numbers.algebra import add, dot, matrix, matvec, mul, norm, scale, sub, transpose
from ravenjax.robots.raven2.geometry import gravity, joints, kinematics, mapping
from ravenjax.robots.raven2.geometry.joints import D4, GEOMETRY, GM1, GM2, GM3, GM4, LW, PI, Pose
from ravenjax.robots.raven2.geometry.transmission import GP42
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.setup import RavenSetup


class Transform(NamedTuple):
    """A rigid transform of points from one frame to another."""

    rotation: Vec  # 3 rows of 3
    origin: Vec  # 3, m


def multiply_literally(a: Transform, b: Transform) -> Transform:
    """Return the product a b, with products and sums in the order of the original."""
    return Transform(algebra.matmul(a.rotation, b.rotation), transform_point(a, b.origin))


def transform_point(transform: Transform, point: Vec) -> Vec:
    """Return the point (3, m) in the other frame."""
    return algebra.plus(matvec(transform.rotation, point), transform.origin)


def inverse_transform(transform: Transform) -> Transform:
    """Return the inverse of a rigid transform, by the transpose."""
    transposed = transpose(transform.rotation)
    return Transform(transposed, matvec(transposed, -transform.origin))


def inverse_matrix(m: Vec) -> Vec:
    """Return the inverse of a 3 x 3 matrix by cofactors.

    The original also inverts rotations by cofactors. The transpose would differ in the last bits.
    """

    def cofactor(r1: int, c1: int, r2: int, c2: int):
        return sub(mul(m[r1][c1], m[r2][c2]), mul(m[r1][c2], m[r2][c1]))

    rows = (
        (cofactor(1, 1, 2, 2), cofactor(0, 2, 2, 1), cofactor(0, 1, 1, 2)),
        (cofactor(1, 2, 2, 0), cofactor(0, 0, 2, 2), cofactor(0, 2, 1, 0)),
        (cofactor(1, 0, 2, 1), cofactor(0, 1, 2, 0), cofactor(0, 0, 1, 1)),
    )
    factor = 1.0 / dot(m[0], Vec(row[0] for row in rows))  # 1 / determinant
    return matrix(*(tuple(mul(x, factor) for x in row) for row in rows))


def quat_from_matrix(rotation: Vec) -> Vec:
    """Return the quaternion (x, y, z, w) of a rotation matrix.

    One component is half of a root: w if the trace is positive, otherwise the component of the
    greatest diagonal element. The other components are divided by twice this component.
    """
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = rotation
    # Differences and sums of pairs of elements across the diagonal give the other components.
    trace = m00 + m11 + m22
    dx, dy, dz = m21 - m12, m02 - m20, m10 - m01
    sxy, sxz, syz = m10 + m01, m20 + m02, m21 + m12
    by_w = trace > 0.0
    use_z = jnp.where(m00 < m11, m11 < m22, m00 < m22)
    by_z, by_y = ~by_w & use_z, ~by_w & ~use_z & (m00 < m11)
    by_x = ~(by_w | by_z | by_y)

    def choose(w: Scalar, x: Scalar, y: Scalar, z: Scalar):
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
        jnp.where(greatest, half, other * factor)
        for greatest, other in zip((by_x, by_y, by_z, by_w), others, strict=True)
    )


_DEG = PI / 180.0
_ONE_OVER = 1.0 / (GM1 * GM3)


class _Arm(NamedTuple):
    """Constants that differ between the arms."""

    zeros: Vec  # 6, rad: theta = joint + zero
    alpha0: float  # rad
    alpha2: float  # rad


_GOLD_ZEROS = Vec((205.0 * _DEG, 180.0 * _DEG, 0.0, 0.0, -90.0 * _DEG, 0.0))
_GREEN_ZEROS = Vec((25.0 * _DEG, 0.0, 0.0, 0.0, -90.0 * _DEG, 0.0))
_ARMS = {
    "gold": _Arm(_GOLD_ZEROS, 0.0, PI - joints.LINK23),
    "green": _Arm(_GREEN_ZEROS, PI, joints.LINK23),
}

_TURNS = 3
"""Largest number of turns that are subtracted one by one. More turns are subtracted at once."""


def _wrap(value: Scalar, turns: int) -> Scalar:
    # Subtracts or adds up to `turns` whole turns, one by one, until the angle is within -pi..pi.
    for _ in range(turns):
        value = jnp.where(value > PI, value - 2 * PI, value)
    for _ in range(turns):
        value = jnp.where(value < -PI, value + 2 * PI, value)
    return value


def _dh_variables(arm: str, jpos: Vec) -> Vec:
    """Return the DH variables theta1, theta2, d3, theta4, theta5, theta6; angles within -pi..pi.
    jpos: joints 1-5 and the jaws' yaw. As in the original, d3 is wrapped like an angle.
    """

    def wrap(x: Scalar):
        # The original subtracts any number of turns one by one.
        has_many_turns = jnp.abs(x) > (2 * _TURNS + 1) * PI
        x = jnp.where(has_many_turns, x - 2 * PI * jnp.round(x * (0.5 / PI)), x)
        return _wrap(x, _TURNS)

    return jpos.map(add, _ARMS[arm].zeros).map(wrap)


def _dh_row_of(alpha: float, ct: Scalar, st: Scalar, d: Scalar = 0.0, a: float = 0.0) -> Transform:
    """Return one row of the modified DH table, from cosine and sine of theta."""
    ca, sa = math.cos(alpha), math.sin(alpha)
    rows = (ct, -st, 0.0), (mul(st, ca), mul(ct, ca), -sa), (mul(st, sa), mul(ct, sa), ca)
    return Transform(matrix(*rows), Vec((a, mul(-sa, d), mul(ca, d))))


def _dh_row(alpha: float, theta: Scalar, d: Scalar = 0.0, a: float = 0.0) -> Transform:
    # Returns the row of `_dh_row_of` from theta in place of its cosine and sine.
    return _dh_row_of(alpha, jnp.cos(theta), jnp.sin(theta), d, a)


def _links123(arm: str, theta1: Scalar, theta2: Scalar, d3: Scalar):
    # Returns the transforms of shoulder, elbow and insertion.
    theta3 = GEOMETRY[arm].side * PI / 2
    return (
        _dh_row(_ARMS[arm].alpha0, theta1),
        _dh_row(joints.LINK12, theta2),
        _dh_row_of(_ARMS[arm].alpha2, math.cos(theta3), math.sin(theta3), d3),
    )


def _links45(theta4: Scalar, theta5: Scalar):
    return _dh_row(0.0, theta4, D4), _dh_row(PI / 2, theta5)


def _chain(*links: Transform) -> Transform:
    """Return the product of links, from the last to the first, as in the original's recursion."""
    return reduce(lambda rest, link: multiply_literally(link, rest), reversed(links))


def forward_pose(arm: str, jpos: Vec, yaw_rad: Scalar = None) -> Pose:
    """Return the pose of `kinematics.forward_pose`, with the original's operations."""
    theta6 = joints.jaw_yaw(jpos) if yaw_rad is None else yaw_rad
    th = _dh_variables(arm, Vec((*jpos[:5], theta6)))
    tip = _chain(*_links123(arm, *th[:3]), *_links45(*th[3:5]), _dh_row(PI / 2, th[5], a=LW))
    return Pose(tip.origin, tip.rotation)


def inverse_joints(arm: str, pose: Pose, grasp_rad: Scalar, jpos_ref: Vec) -> kinematics.IK:
    """Return the joints of `kinematics.inverse_joints`, with the original's operations."""
    measured = _dh_variables(arm, Vec((*jpos_ref[:5], joints.jaw_yaw(jpos_ref))))
    solutions, at_remote_centre = _solutions(arm, Transform(pose.rotation, pose.position))
    lowest_cost = kinematics.NO_SOLUTION_COST
    best = Vec.full(6, 0.0)
    for theta, valid in solutions:
        # theta4 (index 3), the roll, may differ by a turn from the solution.
        turned = jnp.where(measured[3] > theta[3], theta[3] + 2 * PI, theta[3] - 2 * PI)
        is_far = jnp.abs(measured[3] - theta[3]) > kinematics.ROLLOVER
        theta = theta.replace(3, jnp.where(is_far, turned, theta[3]))
        differences = measured - theta  # index 2 is d3, in m
        differences = differences.replace(2, differences[2] * kinematics.INSERTION_WEIGHT)
        cost = dot(differences, differences)
        is_nearer = valid & (cost < lowest_cost)  # never true for NaN
        lowest_cost = jnp.where(is_nearer, cost, lowest_cost)
        best = where(is_nearer, theta, best)
    angles = best - _ARMS[arm].zeros
    # The roll was shifted toward its measured value, so it is not wrapped.
    angles = angles.map(lambda angle: _wrap(angle, turns=1)).replace(3, angles[3])
    is_rejected = lowest_cost > kinematics.COST_LIMIT
    status = jnp.where(at_remote_centre, kinematics.AT_REMOTE_CENTRE, kinematics.OK)
    status = jnp.where(is_rejected, kinematics.REJECTED, status)
    jpos = Vec((*angles[:5], *joints.jaw_angles(angles[5], grasp_rad)))
    return kinematics.IK(jpos, angles[5], lowest_cost, as_int(status))


def _solutions(arm: str, tip: Transform):
    """Return the eight solutions (6 DH variables, validity), and whether the original stopped. The
    original software stops at the first side whose wrist is at the remote centre, before it
    computes any angle. All angles are then zero. After a stop at side 0, d3 is zero for both sides,
    side 0 is invalid and side 1 valid. After a stop at side 1, side 1 is invalid, and its d3 is
    zero. Side 0 is valid, with its values of d3.
    """
    x, y, _ = inverse_transform(tip).origin
    to_remote_centre = Vec((x, y, 0.0))
    wrists = []
    for side in (-1.0, 1.0):
        # As in the original, the second side normalises the vector again.
        to_remote_centre = scale(1.0 / norm(to_remote_centre), to_remote_centre)
        wrists.append(transform_point(tip, scale(side * LW, to_remote_centre)))
    insertions = [norm(wrist) for wrist in wrists]
    at_centre = [insertion <= LW for insertion in insertions]
    stopped = at_centre[0] | at_centre[1]
    solutions = []
    for side, (wrist, insertion) in enumerate(zip(wrists, insertions, strict=True)):
        # The original software stopped before it computed d3 of this side.
        has_no_d3 = at_centre[0] if side == 0 else stopped
        valid_if_stopped = ~at_centre[0] if side == 0 else at_centre[0]
        for d3 in (-D4 - insertion, -D4 + insertion):
            cosine = _cosine2(arm, wrist[2], d3 + D4)
            theta2 = jnp.acos(cosine)
            valid = jnp.where(stopped, valid_if_stopped, ~((cosine > 1.0) | (cosine < -1.0)))
            last_d3 = jnp.where(has_no_d3, 0.0, d3)
            for sign in (1.0, -1.0):
                th = _angles(arm, tip, wrist, d3, mul(sign, theta2))
                angles = th.map(lambda angle: jnp.where(stopped, 0.0, angle))
                solutions.append((angles.replace(2, last_d3), valid))
    return solutions, stopped


def _cosine2(arm: str, height: Scalar, d: Scalar) -> Scalar:
    # Returns the cosine of theta2 from the wrist's z and the insertion d (m), clamped by a little.
    cosine = mul(-GEOMETRY[arm].side, _ONE_OVER * (height / d + GM2 * GM4))
    cosine = jnp.where((cosine > 1.0) & (cosine < 1.0 + kinematics.MAX_COSINE_EXCESS), 1.0, cosine)
    return jnp.where((cosine < -1.0) & (cosine > -1.0 - kinematics.MAX_COSINE_EXCESS), -1.0, cosine)


def _angles(arm: str, tip: Transform, wrist: Vec, d3: Scalar, theta2: Scalar) -> Vec:
    # Returns the DH variables from the wrist's position, d3 and theta2. t36 has the origin (LW c5
    # c4, LW c5 s4, D4 + LW s5), column z (s5 c4, s5 s4, -c5) and row z (s5 c6, -s5 s6, -c5). The
    # column gives theta4 if c5 is near 0. x6 = (c6, 0, s6) in frame 5 gives theta6 if s5 is near 0.
    cos2, sin2 = jnp.cos(theta2), jnp.sin(theta2)
    theta1 = _theta1(arm, wrist, d3 + D4, cos2, sin2)
    t03 = _chain(*_links123(arm, theta1, theta2, d3))
    t36 = multiply_literally(inverse_transform(t03), tip)
    (_, _, r02), (_, _, r12), (r20, r21, r22) = t36.rotation
    c5, s5 = -r22, (t36.origin[2] - D4) / LW
    use_tip = jnp.abs(c5) > kinematics.SINGULAR_BOUND
    c4 = jnp.where(use_tip, t36.origin[0] / (LW * c5), r02 / s5)
    s4 = jnp.where(use_tip, t36.origin[1] / (LW * c5), r12 / s5)
    theta4, theta5 = jnp.atan2(s4, c4), jnp.atan2(s5, c5)
    t05 = multiply_literally(t03, _chain(*_links45(theta4, theta5)))
    cosine6, _, sine6 = matvec(transpose(t05.rotation), transpose(tip.rotation)[0])
    use_axis = jnp.abs(s5) > kinematics.SINGULAR_BOUND
    c6, s6 = jnp.where(use_axis, r20 / s5, cosine6), jnp.where(use_axis, -r21 / s5, sine6)
    return Vec((theta1, theta2, d3, theta4, theta5, jnp.atan2(s6, c6)))


def _theta1(arm: str, wrist: Vec, d: Scalar, cos2: Scalar, sin2: Scalar) -> Scalar:
    # Returns theta1 from the wrist's x and y, the insertion d (m), and cosine and sine of theta2,
    # by b (cos theta1, sin theta1) d = (x, y).
    side = GEOMETRY[arm].side
    b1, b2 = sin2 * GM3, cos2 * GM2 * GM3 - side * GM1 * GM4
    b = matrix((b1, b2, 0.0), (mul(-side, b2), mul(side, b1), 0.0), (0.0, 0.0, 1.0))
    cosine, sine, _ = scale(1.0 / d, matvec(inverse_matrix(b), Vec((wrist[0], wrist[1], 0.0))))
    return jnp.atan2(sine, cosine)


def gravity_torque(arm: str, jpos: Vec) -> Vec:
    """Return tau_g: torques (3, N m at the capstan) that balance gravity.

    The result is `gravity.gravity_torque` with the float32 gravity that the original stores. The
    operations are those of raven2 `src/raven/grav_comp.cpp`, in their order. Rotations are inverted
    by cofactors. Transmission ratios are float32 numbers, as in `defines.h`.
    """
    theta1, theta2, d3, *_ = _dh_variables(arm, Vec((*jpos[:5], joints.jaw_yaw(jpos))))
    t01, t12, t23 = _links123(arm, theta1, theta2, d3)

    # Centres of mass; that of link 1 in frame 1, those of links 2 and 3 in frame 2
    (com1, com2), (_, m2, m3) = gravity.CENTRES[arm], gravity.MASSES
    # The original puts the mass of link 3 at the origin of its frame
    com3 = t23.origin
    in_frame1 = com1, transform_point(t12, com2), transform_point(t12, com3)
    # Gravity in frames 1, 2 and 3
    g1 = matvec(inverse_matrix(t01.rotation), Vec((-gravity.GRAVITY_AS_STORED, 0.0, 0.0)))
    g2 = matvec(inverse_matrix(t12.rotation), g1)
    g3 = matvec(inverse_matrix(t23.rotation), g2)
    loads = zip(in_frame1, gravity.MASSES, strict=True)
    shoulder = reduce(add, (_about_z(com, scale(m, g1)) for com, m in loads))
    elbow = add(_about_z(com2, scale(m2, g2)), _about_z(com3, scale(m3, g2)))
    # Nm and N at the joints: ratio / GP42 times the torques at the capstan
    efforts = Vec((shoulder, elbow, m3 * g3[2]))
    return efforts.map(lambda effort, ratio: -effort / ratio * GP42, stored.TR[:3])


def _about_z(centre: Vec, weight: Vec) -> Scalar:
    # Returns the torque of a weight (N) at a centre of mass (m) about the z axis.
    return sub(mul(centre[0], weight[1]), mul(centre[1], weight[0]))


class Evaluation(NamedTuple):
    """One implementation of the functions in `kinematics`, `gravity` and `mapping`."""

    forward: Callable[[str, Vec, Scalar], Pose]
    inverse: Callable[[str, Pose, Scalar, Vec], kinematics.IK]
    gravity_torque: Callable[[str, Vec], Vec]
    quat_from_matrix: Callable[[Vec], Vec]


SHARING = Evaluation(
    kinematics.forward_pose,
    kinematics.inverse_joints,
    partial(gravity.gravity_torque, gravity=gravity.GRAVITY_AS_STORED),
    mapping.quat_from_matrix,
)
LITERAL = Evaluation(forward_pose, inverse_joints, gravity_torque, quat_from_matrix)


def select_evaluation(setup: RavenSetup) -> Evaluation:
    """Return LITERAL if numbers have the widths of the original's, else SHARING."""
    precision = setup.precision
    return LITERAL if (precision.narrow, precision.wide) == ("float32", "float64") else SHARING
