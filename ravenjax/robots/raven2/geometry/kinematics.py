"""Kinematics of one arm: forward, geometric Jacobian, tip velocity, and inverse.

All results are in frame 0 of the arm, m and rad, in the floating-point type of the input. Source:
raven2 `src/raven/r2_kinematics.cpp`. The Jacobian is the geometric one of the same chain, because
the original's own (`r2_jacobian.cpp`) has placeholder lengths.

Of the eight solutions of the inverse, the one nearest to the measured joints is chosen, or none.
The choice follows inv_kin and check_solutions of the original. The equations are the same, but
solutions share intermediate results. The wrist can be on either side of the jaw axis (side 0, 1).
The insertion axis can point from the wrist or toward it (depth 0, 1). The elbow can bend either way
(bend 0, 1). The index of a solution is 4 side + 2 depth + bend.

Frame i has the axes xi, yi, zi (`joints` defines the frames). The shoulder turns about z1, and the
insertion moves along z3. The wrist is on z3, so wrist angle and yaw depend only on side and depth.

The two bends mirror each other in the plane of z1 and z3. Let m = z1 x z3 and e = m x z3. Along e
and m, y3 has the components (alpha, beta) in one bend and (-alpha, beta) in the other. The
direction from frame 4 to the jaw axis has the components (E, F) in both. theta4, the angle about z3
from x3 to this direction, is atan2(F beta + E alpha, E beta - F alpha) in the first bend.
"""

from functools import partial
from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, as_int, clamp, if_rarely, jnp, record, replace, where
from ravenjax.numbers.algebra import cross, dot, transpose
from ravenjax.robots.raven2.geometry import joints
from ravenjax.robots.raven2.geometry.joints import D4, GEOMETRY, GM1, GM2, GM3, LW, PI, Pose, Theta

# rad^2 (insertion counted 100 rad/m): a nearest solution that is farther away is rejected
COST_LIMIT = PI
NO_SOLUTION_COST = 32765.0  # rad^2, where the search for the least cost starts
# largest amount by which a cosine of theta2 beyond 1 or -1 is clamped; beyond it, no solution
MAX_COSINE_EXCESS = 1e-5
# cosine (or sine) of theta5 below which the equations with the sine (or cosine) are used
SINGULAR_BOUND = 1e-5
# rad, difference of theta4 from its measured value above which theta4 is shifted by a turn
ROLLOVER = 300.0 * PI / 180.0
INSERTION_WEIGHT = 100.0  # rad/m, factor of d3 in the cost

OK, REJECTED, AT_REMOTE_CENTRE = 0, -1, -2


class ChainAxes(NamedTuple):
    """Axes of the Denavit-Hartenberg frames, in frame 0; z1 is (0, 0, flip), z4 is z3."""

    z2: Vec
    z3: Vec
    x4: Vec
    y4: Vec
    x5: Vec
    y5: Vec
    c5: Scalar  # cos(theta5)
    tip: Vec  # m, origin of frame 6


def chain_axes(arm: str, jpos: Vec) -> ChainAxes:
    """Return axes of frames 2 to 5 and the tip (m), in frame 0, at `jpos` (7, rad and m)."""
    geometry = GEOMETRY[arm]
    cos23, side, flip = geometry.cos23, geometry.side, geometry.flip
    theta1 = jpos[0] + geometry.zero1
    c1, s1 = jnp.cos(theta1), jnp.sin(theta1)
    c2, s2 = jnp.cos(jpos[1]), jnp.sin(jpos[1])
    if geometry.zero2:  # half a turn
        c2, s2 = -c2, -s2
    c4, s4 = jnp.cos(jpos[3]), jnp.sin(jpos[3])
    c5, s5 = jnp.sin(jpos[4]), -jnp.cos(jpos[4])  # theta5 = wrist - 90 deg

    # Axes of frame 3 are columns of Rx(75 deg) Rz(theta2) Rx(alpha2) Rz(+-90 deg), in frame 1.
    # GM1, GM2: sine and cosine of 75 deg. GM3, cos23: sine and cosine of alpha2. side: the sign of
    # the 90 deg. flip: -1 if frame 0 is turned by 180 deg about x
    def from_frame1(x: Scalar, y: Scalar, z: Scalar):
        # Returns a vector of frame 1 in frame 0.
        x0, y0 = c1 * x - s1 * y, s1 * x + c1 * y
        return Vec((x0, y0, z)) if flip > 0 else Vec((x0, -y0, -z))

    def times_side(x: Scalar):
        return x if side > 0 else -x

    z2 = Vec((GM1 * s1, -GM1 * c1, GM2)) if flip > 0 else Vec((GM1 * s1, GM1 * c1, -GM2))
    z3 = from_frame1(GM3 * s2, -GM2 * GM3 * c2 - GM1 * cos23, -GM1 * GM3 * c2 + GM2 * cos23)
    x3_in_1 = (-cos23 * s2, GM2 * cos23 * c2 - GM1 * GM3, GM1 * cos23 * c2 + GM2 * GM3)
    x3 = from_frame1(*map(times_side, x3_in_1))
    y3 = from_frame1(*map(times_side, (-c2, -GM2 * s2, -GM1 * s2)))
    x4, y4 = x3 * c4 + y3 * s4, y3 * c4 - x3 * s4
    x5, y5 = x4 * c5 + z3 * s5, z3 * c5 - x4 * s5
    return ChainAxes(z2, z3, x4, y4, x5, y5, c5, z3 * (jpos[2] + D4) + x5 * LW)


def forward_pose(arm: str, jpos: Vec, yaw_rad: Scalar = None) -> Pose:
    """Return the pose of the jaw axis at `jpos` (7, rad and m). The pose depends on the jaws only
    through their yaw, (grasp2 - grasp1) / 2.
    yaw_rad: the yaw, if it is not to be computed from `jpos`; the original rounds it.
    """
    chain = chain_axes(arm, jpos)
    theta6 = joints.jaw_yaw(jpos) if yaw_rad is None else yaw_rad
    c6, s6 = jnp.cos(theta6), jnp.sin(theta6)
    x6 = chain.x5 * c6 - chain.y4 * s6
    y6 = -(chain.x5 * s6 + chain.y4 * c6)
    return Pose(chain.tip, transpose(Vec((x6, y6, -chain.y5))))


def tip_jacobian(arm: str, jpos: Vec) -> Vec:
    """Return the geometric Jacobian of frame 6. Rows: vx, vy, vz (m/s), wx, wy, wz (rad/s).
    Columns: theta1, theta2, d3, theta4, theta5, theta6.
    """
    chain = chain_axes(arm, jpos)
    z1, z5, still = Vec((0.0, 0.0, GEOMETRY[arm].flip)), -chain.y4, Vec.full(3, 0.0)
    # Linear and angular velocity of the tip per unit speed of each joint
    columns = (
        (*cross(z1, chain.tip), *z1),
        (*cross(chain.z2, chain.tip), *chain.z2),
        (*chain.z3, *still),
        (*(chain.y4 * (LW * chain.c5)), *chain.z3),
        (*(chain.y5 * LW), *z5),
        (*still, *-chain.y5),
    )
    return transpose(Vec(columns))


def tip_velocity(arm: str, jpos: Vec, jvel: Vec) -> Vec:
    """Return the velocity of the tip, the origin of frame 6 on the jaw axis, m/s, at joint
    velocities `jvel` (7, rad/s and m/s). The speeds of the jaws have no effect.
    """
    chain = chain_axes(arm, jpos)
    # Angular velocity of link 2: the shoulder turns about z1 = (0, 0, +-1), the elbow about z2
    shoulder = jvel[0] if GEOMETRY[arm].flip > 0 else -jvel[0]
    angular = chain.z2 * jvel[1]
    angular = angular.replace(2, angular[2] + shoulder)
    # The tip is LW from the wrist. Tool roll moves it along y4, with the lever LW c5.
    wrist_part = chain.y4 * (chain.c5 * jvel[3]) + chain.y5 * jvel[4]
    return cross(angular, chain.tip) + chain.z3 * jvel[2] + wrist_part * LW


@record
class IK:
    """The result of the inverse kinematics of one arm."""

    jpos: Vec  # 7, rad and m, without joint limits; meaningless if rejected
    yaw: Scalar  # rad, theta6 of the solution, from which the jaws in jpos follow
    cost: Scalar  # rad^2, squared distance of the solution from the measured joints
    status: Scalar  # int32: OK, REJECTED or AT_REMOTE_CENTRE


@record
class _Wrist:
    """Quantities that all solutions of one side of the wrist have in common."""

    insertion: Scalar  # m, distance from the remote centre to the wrist
    direction: Vec  # 3, unit vector from the remote centre to the wrist
    to_jaw: Vec  # 3, vector from the wrist to the jaw axis, in units of Lw
    yaw: Vec  # 2, cos and sin of theta6 if the insertion axis is the direction to the wrist


@record
class _BendPair:
    """The two solutions of a side and a depth: they differ in theta1, theta4 and sign of theta2."""

    axis: Vec  # 2, x and y of the insertion axis
    theta2: Vec  # 2, cos and sin of theta2 in bend 0; theta2 is negated in bend 1
    roll: Vec  # 2, components (E, F) along e and m of the direction that gives theta4
    d3: Scalar  # m
    theta5: Scalar  # rad
    theta6: Scalar  # rad
    valid: Scalar  # bool, theta2 exists


_Wrists = tuple[_Wrist, _Wrist]
_Axes = tuple[Vec, Vec, Vec]


def _find_wrists(arm: str, pose: Pose) -> tuple[_Wrists, _Axes]:
    # Returns both wrist positions from which the instrument reaches the pose, and the pose's axes.
    columns = pose.position, *zip(*pose.rotation, strict=True)
    if GEOMETRY[arm].flip > 0:
        position, x6, y6, z6 = map(Vec, columns)
    else:  # without the rotation alpha0 of frame 0
        position, x6, y6, z6 = (Vec((a, -b, -c)) for a, b, c in columns)
    along_x, along_y = -dot(x6, position), -dot(y6, position)
    norm = jnp.sqrt(along_x * along_x + along_y * along_y)
    # Unit vector from the jaw axis toward the remote centre, in frame 6 and in frame 0
    x_in_6, y_in_6 = along_x / norm, along_y / norm
    to_centre = x6 * x_in_6 + y6 * y_in_6
    offset = to_centre * LW

    def wrist(side: int):
        # Side 1: the wrist is between the jaw axis and the remote centre. Side 0: the jaw axis is
        # between them, so the direction from the wrist to the jaw axis is opposite
        wrist_position = position + offset if side else position - offset
        insertion = jnp.sqrt(dot(wrist_position, wrist_position))
        cos_sin6 = Vec((-x_in_6, y_in_6)) if side else Vec((x_in_6, -y_in_6))
        direction = wrist_position * (1.0 / insertion)
        return _Wrist(insertion, direction, -to_centre if side else to_centre, yaw=cos_sin6)

    return (wrist(0), wrist(1)), (x6, y6, z6)


def _solve_depth(arm: str, wrist: _Wrist, axes: _Axes, depth: Scalar) -> _BendPair:
    # Returns both solutions of a side and a depth. axes: x, y and z axis of the pose. depth: False
    # if the insertion axis z3 points from the wrist to the remote centre. The shoulder's axis z1 is
    # (0, 0, 1). GM1, GM2: sine and cosine of the angle from z1 to z2; GM3, cos23: from z2 to z3.
    (x6, y6, z6), cos23 = axes, GEOMETRY[arm].cos23
    ahead, behind = (wrist.direction, wrist.insertion), (-wrist.direction, -wrist.insertion)
    insertion_axis, distance = where(depth, ahead, behind)
    # The z component of the insertion axis is GM2 cos23 - cosine GM1 GM3
    cosine = insertion_axis[2] * (-1.0 / (GM1 * GM3)) + GM2 * cos23 / (GM1 * GM3)
    c2 = clamp(cosine, -1.0, 1.0)
    s2 = jnp.sqrt((1.0 - c2) * (1.0 + c2))

    # With a clamped cosine, the insertion axis of theta1 and theta2 misses the wrist by some um
    clamped = c2 != cosine
    x, y, _ = insertion_axis
    height = GM2 * cos23 - c2 * (GM1 * GM3)
    shrink = jnp.sqrt((1.0 - height * height) / (x * x + y * y))
    z3 = where(clamped, Vec((x * shrink, y * shrink, height)), insertion_axis)
    # From the origin of frame 4 to the jaw axis, in units of Lw
    to_jaw = wrist.to_jaw + (insertion_axis - z3) * (distance * (1.0 / LW))

    # theta4 is the angle to x4, the x axis of frame 4. From v = factor x4 + along_z3 z3, where v is
    # to_jaw = c5 x4 + s5 z3, or if this is almost parallel to z3, z6 = s5 x4 - c5 z3
    c5, s5 = -dot(z3, z6), dot(z3, to_jaw)
    uses_jaw = jnp.abs(c5) > SINGULAR_BOUND
    vx, vy, vz = where(uses_jaw, to_jaw, z6)
    along_z3, factor = jnp.where(uses_jaw, s5, -c5), jnp.where(uses_jaw, c5, s5)

    # If z3 is almost parallel to z6, the pose's axes do not determine theta6
    uses_axes = jnp.abs(s5) > SINGULAR_BOUND
    c6 = jnp.where(uses_axes, dot(z3, x6) * s5, wrist.yaw[0])
    s6 = jnp.where(uses_axes, -dot(z3, y6) * s5, wrist.yaw[1])
    return _BendPair(
        axis=Vec((x, y)),
        theta2=Vec((c2, s2)),
        # Of factor (v - along_z3 z3) = factor^2 x4, the components along m x z3 and m = z1 x z3
        roll=Vec(((z3[2] * along_z3 - vz) * factor, (z3[0] * vy - z3[1] * vx) * factor)),
        d3=distance - D4,
        theta5=jnp.atan2(s5, c5),
        theta6=jnp.atan2(s6, c6),
        valid=jnp.abs(cosine) < 1.0 + MAX_COSINE_EXCESS,
    )


def _split_bends(arm: str, pair: _BendPair) -> tuple[Theta, Theta]:
    """Return the DH variables of both bends of the elbow. z1 is the shoulder's axis, z3 that of the
    insertion, m = z1 x z3, and e = m x z3.
    """
    side, cos23 = GEOMETRY[arm].side, GEOMETRY[arm].cos23
    (x, y), (c2, s2), (roll_e, roll_m) = pair.axis, pair.theta2, pair.roll
    # The angle from a vector (p, q) to (u, v) is atan2(p v - q u, p u + q v). theta1 is the angle
    # from (b1, -b2), x and y of the insertion axis z3 in frame 1, to (x, y), those in frame 0.
    # theta4 is the angle from x3 to x4. Along e and m, x3 is (beta, -alpha), and `roll` is a
    # positive multiple of x4. Bend 1 has -theta2 in place of theta2, therefore -s2, -b1 and -alpha
    b1, b2 = s2 * GM3, c2 * (GM2 * GM3) + GM1 * cos23
    alpha, beta = s2 * (side * GM1), c2 * (-side * GM1 * cos23) - side * GM2 * GM3
    fa, ea, fb, eb = roll_m * alpha, roll_e * alpha, roll_m * beta, roll_e * beta
    theta2 = jnp.atan2(s2, c2)
    bends = (
        (jnp.atan2(b2 * x + b1 * y, b1 * x - b2 * y), theta2, jnp.atan2(fb + ea, eb - fa)),
        (jnp.atan2(b2 * x - b1 * y, -(b1 * x + b2 * y)), -theta2, jnp.atan2(fb - ea, eb + fa)),
    )
    first, second = (
        Theta(theta1, theta2, pair.d3, theta4, pair.theta5, pair.theta6)
        for theta1, theta2, theta4 in bends
    )
    return first, second


def inverse_candidates(arm: str, pose: Pose) -> tuple[tuple[Theta, Scalar], ...]:
    """Return the eight solutions as (variables, whether they exist), in the order of side, depth
    and bend. The truth value is wrong if a wrist is at the remote centre.
    """
    wrists, axes = _find_wrists(arm, pose)
    pairs = [_solve_depth(arm, wrist, axes, depth) for wrist in wrists for depth in (False, True)]
    return tuple((theta, pair.valid) for pair in pairs for theta in _split_bends(arm, pair))


@record
class _Choice:
    """A solution that may be the nearest to the measured joints."""

    theta: Theta
    cost: Scalar  # rad^2, squared distance from the measured joints


def _square(x: Scalar) -> Scalar:
    return x * x


def _depth_cost(measured: Theta, d3: Scalar) -> Scalar:
    return _square((measured.d3 - d3) * INSERTION_WEIGHT)


def _common_cost(measured: Theta, pair: _BendPair) -> Scalar:
    # Returns the part of the cost that both bends have in common.
    return (
        _depth_cost(measured, pair.d3)
        + _square(measured.theta5 - pair.theta5)
        + _square(measured.theta6 - pair.theta6)
    )


def _nearer_bend(arm: str, measured: Theta, pair: _BendPair) -> _Choice:
    # Returns the bend of the elbow that is nearer to the measured joints.
    def shift_roll(theta4: Scalar):
        # Returns theta4, shifted by a turn if that brings it near its measured value.
        gap = measured.theta4 - theta4
        is_above, shifted_up = gap > ROLLOVER, theta4 + 2 * PI
        shifted_down = jnp.where(gap < -ROLLOVER, theta4 - 2 * PI, theta4)
        return jnp.where(is_above, shifted_up, shifted_down)

    def bend_cost(theta: Theta):
        # Returns the part of the cost that differs between the bends.
        return (
            _square(measured.theta1 - theta.theta1)
            + _square(measured.theta2 - theta.theta2)
            + _square(measured.theta4 - theta.theta4)
        )

    both = _split_bends(arm, pair)
    bends = tuple(replace(theta, theta4=shift_roll(theta.theta4)) for theta in both)
    cost0, cost1 = map(bend_cost, bends)
    theta = where(cost1 < cost0, bends[1], bends[0])
    cost = jnp.minimum(cost0, cost1) + _common_cost(measured, pair)
    is_solution = pair.valid & (cost < NO_SOLUTION_COST)  # false if the cost is NaN
    return _Choice(theta, jnp.where(is_solution, cost, NO_SOLUTION_COST))


def _nearer(first: _Choice, second: _Choice) -> _Choice:
    return where(second.cost < first.cost, second, first)


def _nearest_of_all(arm: str, measured: Theta, wrists: _Wrists, axes: _Axes) -> _Choice:
    # Returns the nearest of all eight solutions.
    def nearest_of_side(wrist: _Wrist):
        pairs = (_solve_depth(arm, wrist, axes, depth) for depth in (False, True))
        return _nearer(*(_nearer_bend(arm, measured, pair) for pair in pairs))

    return _nearer(*map(nearest_of_side, wrists))


def _likely_choice(
    arm: str, measured: Theta, wrists: _Wrists, axes: _Axes
) -> tuple[_Choice, Scalar]:
    # Returns the solution that is probably nearest, and a lower bound of the cost of all others,
    # which may be NaN. A cost is a sum of squares, so some of the squares are a lower bound. For
    # each side, only the depth with the smaller square of d3 is solved. The larger square bounds
    # the cost of the other depth. Then the side with the smaller `_common_cost` is taken, and the
    # larger one bounds the cost of the other side. At last the nearer bend is taken.
    def nearer_depth(wrist: _Wrist):
        shallow, deep = (
            _depth_cost(measured, distance - D4) for distance in (-wrist.insertion, wrist.insertion)
        )
        pair = _solve_depth(arm, wrist, axes, deep < shallow)
        return pair, jnp.maximum(shallow, deep)

    pairs, other_depth_costs = zip(*map(nearer_depth, wrists), strict=True)
    cost0, cost1 = (
        jnp.where(pair.valid, _common_cost(measured, pair), NO_SOLUTION_COST) for pair in pairs
    )
    other_side_cost = jnp.maximum(cost0, cost1)
    likely = _nearer_bend(arm, measured, where(cost1 < cost0, pairs[1], pairs[0]))
    return likely, jnp.minimum(other_side_cost, jnp.minimum(*other_depth_costs))


def _centre_choice(measured: Theta, insertion: Scalar) -> _Choice:
    # Returns the solution that the original software selects if a wrist is within LW of the remote
    # centre. It looks at the wrist of side 0, then at that of side 1, and stops at the first that
    # is so near. All angles are then zero. After a stop at side 0, d3 is zero. After a stop at side
    # 1, d3 is that of side 0. insertion: m, from the remote centre to the wrist of side 0.
    shallow, deep = -D4 - insertion, -D4 + insertion
    nearer = jnp.where(jnp.abs(measured.d3 - deep) < jnp.abs(measured.d3 - shallow), deep, shallow)
    d3 = jnp.where(insertion <= LW, 0.0, nearer)
    angles = (measured.theta1, measured.theta2, measured.theta4, measured.theta5, measured.theta6)
    # `sum` starts with the first square in place of 0, which would be another operation
    cost = sum((_square(angle) for angle in angles[1:]), _square(angles[0]))
    zero = jnp.zeros_like(d3)
    return _Choice(Theta(zero, zero, d3, zero, zero, zero), cost + _depth_cost(measured, d3))


def inverse_joints(arm: str, pose: Pose, grasp_rad: Scalar, jpos_ref: Vec) -> IK:
    """Return the joints that reach `pose`, nearest to the measured joints `jpos_ref` (7).
    grasp_rad: opening of the jaws, rad. As in the original, a roll is shifted by a turn only if it
    differs by more than 300 deg from the measured roll. A pose with NaN is rejected (`IK.status`).
    """
    measured = joints.theta_from_joint(arm, jpos_ref)
    wrists, axes = _find_wrists(arm, pose)

    # No other solution has a cost below `bound`. All are computed only if the likely one's cost is
    # not below `bound`, which is rare. `~(a < b)` is also true if a number is NaN
    likely, bound = _likely_choice(arm, measured, wrists, axes)
    compute_all = partial(_nearest_of_all, arm, measured, wrists, axes)
    nearest = if_rarely(~(likely.cost < bound), compute_all, likely)
    singular = (wrists[0].insertion <= LW) | (wrists[1].insertion <= LW)
    choice = where(singular, _centre_choice(measured, wrists[0].insertion), nearest)
    reachable = choice.cost <= COST_LIMIT
    status = jnp.where(reachable, jnp.where(singular, AT_REMOTE_CENTRE, OK), REJECTED)
    jpos = joints.joint_from_theta(arm, choice.theta, grasp_rad)
    return IK(jpos, choice.theta.theta6, choice.cost, as_int(status))
