"""Inverse kinematics of one arm: of eight solutions, the nearest to the measured joints is taken,
or none.

Which solution is taken, and when there is none, follows raven2 `src/raven/r2_kinematics.cpp`
(inv_kin, check_solutions). The angles come from the same equations with the work shared. The wrist
can be on either side of the jaw axis (side 0, 1). The insertion axis can point to or from it (depth
0, 1). The elbow can bend either way (bend 0, 1). Solution i = 4 side + 2 depth + bend.

- Wrist and yaw depend on side and depth alone, because the insertion axis z3 is the direction to
  the wrist.
- The two bends mirror each other in the plane of shoulder axis z1 and z3. Let m = z1 x z3 and e = m
  x z3, which span what is perpendicular to z3. The axis y3 has parts (alpha, beta) along e and m in
  one bend, and (-alpha, beta) in the other. A direction with parts (E, F) is seen at theta4 =
  atan2(F beta +- E alpha, E beta -+ F alpha); common factors cancel.
"""

from __future__ import annotations

from ravenjax.numbers.algebra import dot
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, rarely, record, where
from ravenjax.robots.raven2.geometry.joints import Pose, Theta, joint_from_theta, theta_from_joint
from ravenjax.robots.raven2.geometry.links import D4, GEOMETRY, GM1, GM2, GM3, LW, PI, Geometry

# rad^2 (insertion counted 100 rad/m): a nearest solution that is farther away is rejected
COST_LIMIT = PI
NO_SOLUTION_COST = 32765.0  # rad^2, where the search for the least cost starts
# how far outside [-1, 1] the cosine of theta2 is still taken as +-1
CLAMP = 1e-5
# cosine or sine of theta5 below which the other one's equations are used
SINGULAR = 1e-5
# rad, distance of theta4 from the measured one beyond which it is shifted by a turn
ROLLOVER = 300.0 * PI / 180.0
INSERTION_WEIGHT = 100.0  # rad/m, weight of d3 in the cost

OK, REJECTED, AT_REMOTE_CENTRE = 0, -1, -2


@record
class IK:
    """The result of the inverse kinematics of one arm."""

    jpos: Vec  # 7, rad and m, without joint limits; meaningless if rejected
    # rad, theta6 of the solution, from which the jaws in jpos follow
    yaw: Scalar
    cost: Scalar  # rad^2, squared distance of the solution from the measured joints
    # int32: 0 taken, -1 rejected (hold the last jpos_d), -2 taken with the wrist at the remote
    # centre
    status: Scalar


@record
class _Wrist:
    """Quantities that the solutions of one side share."""

    insertion: Scalar  # m, from the remote centre to the wrist
    direction: Vec  # 3, that way
    to_jaw: Vec  # 3, vector from the wrist to the jaw axis, in units of Lw
    ends: Vec  # 2, cos and sin of theta6, up to rounding


@record
class _Reach:
    """One side and depth: two solutions that differ in theta1, theta4 and the sign of theta2."""

    axis: Vec  # 2, x and y of the insertion axis, toward the wrist
    bend: Vec  # 2, cos and sin of theta2 of bend 0; theta2 is negated for bend 1
    # 2, parts along e and m of the direction to which theta4 turns
    roll: Vec
    d3: Scalar  # m
    theta5: Scalar  # rad
    theta6: Scalar  # rad
    valid: Scalar  # truth value


def _normalised(arm: str, pose: Pose) -> tuple[Vec, Vec]:
    """Return position and columns of the rotation in frame 0 without the turn alpha0, as if both
    arms were alike.
    """
    (x, y, z), columns = pose.position, tuple(zip(*pose.rotation, strict=True))
    if GEOMETRY[arm].flip > 0:
        return Vec((x, y, z)), Vec(Vec(column) for column in columns)
    return Vec((x, -y, -z)), Vec(Vec((a, -b, -c)) for a, b, c in columns)


def _wrists(arm: str, pose: Pose) -> tuple[tuple[_Wrist, _Wrist], tuple[Vec, Vec, Vec]]:
    """Return both sides, and the axes of frame 6."""
    position, (x6, y6, z6) = _normalised(arm, pose)
    along_x, along_y = -dot(x6, position), -dot(y6, position)
    norm = jnp.sqrt(along_x * along_x + along_y * along_y)
    # from the jaw axis toward the remote centre, in frame 6
    u = Vec((along_x / norm, along_y / norm))
    w = x6 * u[0] + y6 * u[1]
    offset = w * LW

    def wrist(side: int) -> _Wrist:
        place = position + offset if side else position - offset
        insertion = jnp.sqrt(dot(place, place))
        ends = Vec((-u[0], u[1])) if side else Vec((u[0], -u[1]))
        return _Wrist(insertion, place * (1.0 / insertion), -w if side else w, ends)

    return (wrist(0), wrist(1)), (x6, y6, z6)


def _reach(geometry: Geometry, wrist: _Wrist, axes: tuple[Vec, Vec, Vec], depth: Scalar) -> _Reach:
    """Return both bends for the insertion axis pointing from the wrist (depth 0) or to it (1).

    depth: a number or truth value.
    """
    x6, y6, z6 = axes
    if isinstance(depth, int):
        toward, distance = (
            (wrist.direction, wrist.insertion) if depth else (-wrist.direction, -wrist.insertion)
        )
    else:
        toward, distance = where(
            depth, (wrist.direction, wrist.insertion), (-wrist.direction, -wrist.insertion)
        )
    cosine = toward[2] * (-1.0 / (GM1 * GM3)) + GM2 * geometry.cos23 / (GM1 * GM3)
    c2 = jnp.minimum(jnp.maximum(cosine, -1.0), 1.0)
    s2 = jnp.sqrt((1.0 - c2) * (1.0 + c2))

    # If the cosine was clamped, the axis that theta1 and theta2 give misses the wrist by up to some
    # micrometres.
    clamped = c2 != cosine
    x, y, _ = toward
    height = GM2 * geometry.cos23 - c2 * (GM1 * GM3)
    shrink = jnp.sqrt((1.0 - height * height) / (x * x + y * y))
    z3 = where(clamped, Vec((x * shrink, y * shrink, height)), toward)
    # from the origin of frame 4, in units of Lw
    jaw = wrist.to_jaw + (toward - z3) * (distance * (1.0 / LW))

    c5, s5 = -dot(z3, z6), dot(z3, jaw)
    by_jaw = jnp.abs(c5) > SINGULAR
    vx, vy, vz = where(by_jaw, jaw, z6)
    along_z3, factor = jnp.where(by_jaw, s5, -c5), jnp.where(by_jaw, c5, s5)

    by_axis = jnp.abs(s5) > SINGULAR
    c6 = jnp.where(by_axis, dot(z3, x6) * s5, wrist.ends[0])
    s6 = jnp.where(by_axis, -dot(z3, y6) * s5, wrist.ends[1])
    return _Reach(
        axis=Vec((x, y)),
        bend=Vec((c2, s2)),
        roll=Vec(((z3[2] * along_z3 - vz) * factor, (z3[0] * vy - z3[1] * vx) * factor)),
        d3=distance - D4,
        theta5=jnp.atan2(s5, c5),
        theta6=jnp.atan2(s6, c6),
        valid=jnp.abs(cosine) < 1.0 + CLAMP,
    )


def _bends(geometry: Geometry, reach: _Reach) -> tuple[Vec, Vec]:
    """Return theta1, theta2 and theta4 (rad) of both bends."""
    (x, y), (c2, s2), (part_e, part_m) = reach.axis, reach.bend, reach.roll
    b1, b2 = s2 * GM3, c2 * (GM2 * GM3) + GM1 * geometry.cos23
    alpha, beta = (
        s2 * (geometry.side * GM1),
        c2 * (-geometry.side * GM1 * geometry.cos23) - geometry.side * GM2 * GM3,
    )
    fa, ea, fb, eb = part_m * alpha, part_e * alpha, part_m * beta, part_e * beta
    theta2 = jnp.atan2(s2, c2)
    return (
        Vec((jnp.atan2(b2 * x + b1 * y, b1 * x - b2 * y), theta2, jnp.atan2(fb + ea, eb - fa))),
        Vec((jnp.atan2(b2 * x - b1 * y, -(b1 * x + b2 * y)), -theta2, jnp.atan2(fb - ea, eb + fa))),
    )


def inverse_candidates(arm: str, pose: Pose) -> tuple[tuple[Theta, Scalar], ...]:
    """Return all eight solutions in the original's order, each with its validity.

    The rules about the remote centre are not applied.
    """
    geometry = GEOMETRY[arm]
    wrists, axes = _wrists(arm, pose)
    reaches = [_reach(geometry, wrist, axes, depth) for wrist in wrists for depth in (0, 1)]
    return tuple(
        (Theta(theta1, theta2, reach.d3, theta4, reach.theta5, reach.theta6), reach.valid)
        for reach in reaches
        for theta1, theta2, theta4 in _bends(geometry, reach)
    )


@record
class _Choice:
    theta: Theta
    cost: Scalar  # rad^2


def _square(x: Scalar) -> Scalar:
    return x * x


def _depth_cost(measured: Theta, d3: Scalar) -> Scalar:
    return _square((measured.d3 - d3) * INSERTION_WEIGHT)


def _common_cost(measured: Theta, reach: _Reach) -> Scalar:
    """Return the part of the cost that both bends share, rad^2."""
    return (
        _depth_cost(measured, reach.d3)
        + _square(measured.theta5 - reach.theta5)
        + _square(measured.theta6 - reach.theta6)
    )


def _nearer_bend(geometry: Geometry, measured: Theta, reach: _Reach) -> _Choice:
    def turned(theta4: Scalar) -> Scalar:
        gap = measured.theta4 - theta4
        return jnp.where(
            gap > ROLLOVER, theta4 + 2 * PI, jnp.where(gap < -ROLLOVER, theta4 - 2 * PI, theta4)
        )

    def bend_cost(theta1: Scalar, theta2: Scalar, theta4: Scalar) -> Scalar:
        return (
            _square(measured.theta1 - theta1)
            + _square(measured.theta2 - theta2)
            + _square(measured.theta4 - theta4)
        )

    bends = tuple(
        (theta1, theta2, turned(theta4)) for theta1, theta2, theta4 in _bends(geometry, reach)
    )
    first, second = (bend_cost(*bend) for bend in bends)
    theta1, theta2, theta4 = where(second < first, bends[1], bends[0])
    cost = jnp.minimum(first, second) + _common_cost(measured, reach)
    counts = reach.valid & (cost < NO_SOLUTION_COST)  # never true of NaN
    theta = Theta(theta1, theta2, reach.d3, theta4, reach.theta5, reach.theta6)
    return _Choice(theta, jnp.where(counts, cost, NO_SOLUTION_COST))


def _nearest(first: _Choice, second: _Choice) -> _Choice:
    return where(second.cost < first.cost, second, first)


def _nearest_of_all(
    geometry: Geometry, measured: Theta, wrists: tuple[_Wrist, _Wrist], axes: tuple[Vec, Vec, Vec]
) -> _Choice:
    def of_side(wrist: _Wrist) -> _Choice:
        reaches = (_reach(geometry, wrist, axes, depth) for depth in (0, 1))
        return _nearest(*(_nearer_bend(geometry, measured, reach) for reach in reaches))

    return _nearest(of_side(wrists[0]), of_side(wrists[1]))


def _likely(
    geometry: Geometry, measured: Theta, wrists: tuple[_Wrist, _Wrist], axes: tuple[Vec, Vec, Vec]
) -> tuple[_Choice, Scalar]:
    """Return the likely nearest solution, and a lower bound of the cost of other sides and depths,
    rad^2.

    The bound may be NaN. The function looks at the depth of each side that is nearer to the
    measured d3, and takes the side whose wrist and yaw are nearer.
    """

    def nearer_depth(wrist: _Wrist) -> tuple[_Reach, Scalar]:
        shallow, deep = (
            _depth_cost(measured, distance - D4) for distance in (-wrist.insertion, wrist.insertion)
        )
        return _reach(geometry, wrist, axes, deep < shallow), jnp.maximum(shallow, deep)

    (zero, farther_zero), (one, farther_one) = (nearer_depth(wrist) for wrist in wrists)
    cost_zero, cost_one = (
        jnp.where(reach.valid, _common_cost(measured, reach), NO_SOLUTION_COST)
        for reach in (zero, one)
    )
    other = jnp.maximum(cost_zero, cost_one)
    likely = _nearer_bend(geometry, measured, where(cost_one < cost_zero, one, zero))
    return likely, jnp.minimum(other, jnp.minimum(farther_zero, farther_one))


def _leftover(measured: Theta, insertions: tuple[Scalar, Scalar]) -> _Choice:
    """Return what the original selects if a wrist is within Lw of the remote centre.

    The original stops after the insertions of the sides before, with all angles still zero, and
    takes the other side as valid. On side 0 d3 is known by then; on side 1 it is also zero.
    """
    shallow, deep = -D4 - insertions[0], -D4 + insertions[0]
    nearer = jnp.where(jnp.abs(measured.d3 - deep) < jnp.abs(measured.d3 - shallow), deep, shallow)
    d3 = jnp.where(insertions[0] <= LW, 0.0, nearer)
    angles = (measured.theta1, measured.theta2, measured.theta4, measured.theta5, measured.theta6)
    cost = sum((_square(angle) for angle in angles[1:]), _square(angles[0]))
    zero = jnp.zeros_like(d3)
    theta = Theta(zero, zero, d3, zero, zero, zero)
    return _Choice(theta, cost + _square((measured.d3 - d3) * INSERTION_WEIGHT))


def inverse(arm: str, pose: Pose, grasp_rad: Scalar, jpos_ref: Vec) -> IK:
    """Return the joints that bring the jaw axis to `pose`, nearest to the measured `jpos_ref` (7).

    grasp_rad: opening of the jaws, rad. A roll more than 300 deg from the measured one is shifted
    by a turn; otherwise the distance is used unchanged. Never raises: see `IK.status`. A pose with
    NaN is rejected.
    """
    measured = theta_from_joint(arm, jpos_ref)
    geometry = GEOMETRY[arm]
    wrists, axes = _wrists(arm, pose)
    insertions = (wrists[0].insertion, wrists[1].insertion)

    # The solution of least cost is nearly always found without computing the others, because a
    # lower bound of their costs is known.
    usual, others = _likely(geometry, measured, wrists, axes)
    nearest = rarely(
        ~(usual.cost < others), lambda: _nearest_of_all(geometry, measured, wrists, axes), usual
    )
    singular = (insertions[0] <= LW) | (insertions[1] <= LW)
    choice = where(singular, _leftover(measured, insertions), nearest)
    reachable = choice.cost <= COST_LIMIT
    status = jnp.where(reachable, jnp.where(singular, AT_REMOTE_CENTRE, OK), REJECTED)
    return IK(
        joint_from_theta(arm, choice.theta, grasp_rad),
        choice.theta.theta6,
        choice.cost,
        as_int(status),
    )
