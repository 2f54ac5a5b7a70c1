"""Cartesian control: measured and desired tip pose, inverse kinematics with limits -> jpos_d.

raven2: r2_kinematics.cpp, rt_raven.cpp. Arms are solved in the order of the original's mechanisms.
If the inverse kinematics of an arm has no acceptable solution, this arm and the arms after it keep
their last desired joints jpos_d, and the robot continues. A target beyond a joint limit is clamped,
and the desired pose becomes that of the clamped joints.
"""

from functools import reduce
from operator import or_

import numpy as np

from ravenjax.numbers import cast_to_real, describe_fields, narrow_numbers, per_arm, widen_numbers
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, if_rarely, record, replace, to_int32, where
from ravenjax.robots.raven2.geometry import stored_pose
from ravenjax.robots.raven2.geometry.kinematics import COST_LIMIT, REJECTED
from ravenjax.robots.raven2.original.constants import joint_limits
from ravenjax.robots.raven2.original.literal import select_evaluation
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup
from ravenjax.stages import check


@record
class ArmState:
    """One arm's poses and joint targets."""

    pos: stored_pose.StoredPose  # pose measured in the last cycle
    pos_d: stored_pose.StoredPose
    jpos_d: Vec  # 7, rad and m; keeps its last value while inverse kinematics has no solution
    ik_reject: check.CheckHistory  # margin: pi minus the cost of the best solution
    # margin: distance to the nearer limit as a fraction of the joint's range
    joint_limit: check.CheckHistory


State = PerArm[ArmState]


@describe_fields
@record
class CartesianParams:
    """Software joint limits, the same for every arm, as float32 numbers."""

    lower: Vec  # 5, without the jaws
    upper: Vec  # 5, without the jaws


def params(setup: RavenSetup) -> CartesianParams:
    """Return the original's limits. The limits of the first arm's tool apply to every arm."""
    number = np.dtype(setup.precision.wide).type
    ranges, _ = joint_limits(setup)
    lower, upper = zip(*ranges, strict=True)
    return CartesianParams(Vec(map(number, lower)), Vec(map(number, upper)))


def init(setup: RavenSetup, jpos: PerArm[Vec]) -> State:
    """Return the state of a robot at rest at `jpos`, with this pose as the desired one."""
    to_stored = np.dtype(setup.precision.narrow).type

    def rest_arm(i: int, arm: ArmName) -> ArmState:
        joints = Vec(to_stored(float(j)) for j in jpos[i])
        pose = measure_pose(setup, arm, joints)
        return ArmState(pose, pose, joints, check.init(setup), check.init(setup))

    return per_arm(setup, rest_arm)


def measure_pose(setup: RavenSetup, arm: ArmName, jpos: Vec) -> stored_pose.StoredPose:
    """Return the pose of the tip at measured joints, as stored. `jpos` are stored joints, too."""
    pose = select_evaluation(setup).forward(arm, widen_numbers(setup, jpos), _yaw(setup, jpos))
    return stored_pose.store_pose(setup, pose, to_int32((jpos[5] + jpos[6]) * 1000.0))


def _yaw(setup: RavenSetup, jpos: Vec) -> Scalar:
    return widen_numbers(setup, jpos[6] - jpos[5]) * 0.5


def _closed_joints(setup: RavenSetup, jpos: Vec) -> Vec:
    # Returns the joints with closed jaws, which have the same yaw.
    yaw = _yaw(setup, jpos)
    return Vec((*widen_numbers(setup, Vec(jpos[:5])), -yaw, yaw))


def follow_measured(state: State, condition: Scalar) -> State:
    """Return the state with the measured poses as desired poses, if `condition` is true."""
    return tuple(replace(arm, pos_d=where(condition, arm.pos, arm.pos_d)) for arm in state)


def solve_inverse(
    setup: RavenSetup,
    params: CartesianParams,
    state: State,
    tick: Scalar,
    active: Scalar,
    jpos: PerArm[Vec],
) -> tuple[State, Scalar]:
    """Return the state with the joints of the desired poses, and whether a joint is at a limit.

    active: whether inverse kinematics runs, bool. jpos: measured joints, rad and m. If an arm has
    no solution, the arms after it are not solved either.
    """
    forward, inverse, *_ = select_evaluation(setup)
    solving = active
    at_limits = []
    arms = []
    for arm, old, measured in zip(setup.arms, state, jpos, strict=True):
        opening = widen_numbers(setup, old.pos_d.grasp_mrad) / 1000.0
        target = stored_pose.load_pose(setup, old.pos_d)
        ik = inverse(arm, target, opening, _closed_joints(setup, measured))
        accepted = ik.status != REJECTED
        rejected = solving & ~accepted
        solved = solving & accepted
        clamped, reaches_limit, margin = _clamp(setup, params, ik.jpos, ik.yaw)
        at_limit = solved & reaches_limit

        # Defaults bind the values of this arm, because the loop goes on before the call.
        def clamped_pose(
            old: ArmState = old, clamped: Vec = clamped, arm: ArmName = arm
        ) -> stored_pose.StoredPose:
            pose = forward(arm, clamped, clamped[5])
            return stored_pose.store_pose(setup, pose, old.pos_d.grasp_mrad)

        targets = narrow_numbers(setup, Vec((*clamped[:5], *ik.jpos[5:])))
        reject_margin = jnp.where(solving, cast_to_real(setup, COST_LIMIT - ik.cost), np.inf)
        limit_margin = jnp.where(solved, cast_to_real(setup, margin), np.inf)
        arms.append(
            ArmState(
                pos=old.pos,
                pos_d=if_rarely(at_limit, clamped_pose, old.pos_d),
                jpos_d=where(solved, targets, old.jpos_d),
                ik_reject=check.update_check(old.ik_reject, tick, rejected, reject_margin),
                joint_limit=check.update_check(old.joint_limit, tick, at_limit, limit_margin),
            )
        )
        at_limits.append(at_limit)
        solving = solved
    return tuple(arms), reduce(or_, at_limits)


def _clamp(
    setup: RavenSetup, params: CartesianParams, jpos: Vec, yaw: Scalar
) -> tuple[Vec, Scalar, Scalar]:
    """Return joints 1-5 and the jaws' yaw clamped to limits, whether any is at a limit, and a
    margin: the smallest distance of joints 1-5 to a limit, as a share of the joint's range.
    """
    values, at_limit, margins = [], [], []
    _, lowest_yaw = joint_limits(setup)
    for value, low, high in zip(jpos[:5], params.lower, params.upper, strict=True):
        below, above = value <= low, value >= high
        values.append(jnp.where(below, low, jnp.where(above, high, value)))
        at_limit += [below, above]
        margins.append(jnp.minimum(value - low, high - value) * (1.0 / (high - low)))
    if lowest_yaw is not None:
        at_limit.append(yaw <= lowest_yaw)
        yaw = jnp.where(yaw <= lowest_yaw, lowest_yaw, yaw)
    return Vec((*values, yaw)), reduce(or_, at_limit), reduce(jnp.minimum, margins)
