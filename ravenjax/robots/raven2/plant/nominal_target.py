"""What the nominal model is asked to do: the operator's clean input accumulated into a pose, solved
for joints.

The model hears the operator before any fault does: increments add up as in the robot, its own
inverse kinematics runs with its own joints as reference, targets are clamped to the software's
joint limits and re-anchored where they clamp. While the pedal is up the model holds, and the target
is where it stands, as the robot's is.
"""

from __future__ import annotations

import math
from typing import Annotated

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, to_int32, where
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import joints, kinematics, limits, mapping
from ravenjax.robots.raven2.setup import RavenSetup

UM_PER_M = 1e6


@record
class TargetParams:
    """Where targets are clamped: the software's joint limits, the same for every arm."""

    lower: Annotated[
        Vec, limits.position("lower soft limit of the nominal model's target")
    ]  # 5: no jaws
    upper: Annotated[
        Vec, limits.position("upper soft limit of the nominal model's target")
    ]  # 5: no jaws


def params(setup: RavenSetup) -> TargetParams:
    """Limits with the first arm's tool, as the software has them."""
    allowed = limits.soft_limits(setup.tools[0], setup.software)
    return TargetParams(Vec(allowed.lower[:5]), Vec(allowed.upper[:5]))


@record
class Clean:
    """The operator's command of this tick for one arm, as the console makes it, before anything
    can corrupt it.
    """

    # 3, um, int32: ITP-frame increment, or position in frame 0 where Setup.console is "absolute"
    delta_um: Vec
    quat: Vec  # x, y, z, w: ITP-frame increment, or orientation in frame 0
    grasp_mrad: Scalar  # mrad, int32: increment (positive closes), or opening
    engaged: Scalar  # 1: pedal down, int32 or bool


@record
class TargetState:
    position_um: Vec  # 3, um, int32, target in frame 0
    quat: Vec  # x, y, z, w, unit, target orientation in frame 0
    grasp_mrad: Scalar  # mrad, int32, target opening
    jpos_d: Vec  # rad; insertion m: target joints


def init(setup: RavenSetup, arm: ArmName, jpos: Vec) -> TargetState:
    """The target is where the joints are."""
    pose = kinematics.forward(arm, jpos)
    return TargetState(
        position_um=pose.position.map(lambda p: to_int32(p * UM_PER_M)),
        quat=mapping.quat_from_matrix(pose.rotation),
        grasp_mrad=to_int32(joints.grasp(jpos) * 1000.0),
        jpos_d=jpos,
    )


def step(
    setup: RavenSetup,
    arm: ArmName,
    params: TargetParams,
    state: TargetState,
    clean: Clean,
    jpos: Vec,
) -> TargetState:
    """One tick: the target after the operator's command, for a model that stands at `jpos` (rad,
    m).
    """
    engaged = clean.engaged != 0
    position_um, quat, grasp_mrad = _moved(setup, arm, state, clean)
    pose = kinematics.Pose(
        position=position_um.map(lambda p: p.astype(setup.precision.real) / UM_PER_M),
        rotation=mapping.matrix_from_quat(quat),
    )
    grasp_rad = grasp_mrad.astype(setup.precision.real) / 1000.0
    solved = kinematics.inverse(arm, pose, grasp_rad, jpos)
    allowed, clamped = _clamp(setup, params, solved.jpos, solved.yaw)
    reachable = solved.status != -1

    jpos_d = where(engaged & reachable, allowed, where(engaged, state.jpos_d, jpos))
    anchor = kinematics.forward(arm, jpos_d)
    fresh = TargetState(position_um=position_um, quat=quat, grasp_mrad=grasp_mrad, jpos_d=jpos_d)
    restarted = TargetState(
        position_um=anchor.position.map(lambda p: to_int32(p * UM_PER_M)),
        quat=mapping.quat_from_matrix(anchor.rotation),
        grasp_mrad=where(engaged, grasp_mrad, state.grasp_mrad),
        jpos_d=jpos_d,
    )
    return where(~engaged | (reachable & clamped), restarted, fresh)


def _moved(
    setup: RavenSetup, arm: ArmName, state: TargetState, clean: Clean
) -> tuple[Vec, Vec, Scalar]:
    if setup.console == "absolute":
        return clean.delta_um, clean.quat, clean.grasp_mrad
    gain, lowest_deg = (
        (1, -10.0) if setup.software == "raven2" else (2, -30.0)
    )  # local_io.cpp of either
    lowest, highest = int(math.radians(lowest_deg) * 1000.0), int(math.radians(90.0) * 1000.0)
    position_um = state.position_um + mapping.position_from_itp(arm, clean.delta_um)
    quat = mapping.quat_mul(mapping.quat_from_itp(arm, clean.quat), state.quat)
    square = quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3]
    grasp = jnp.minimum(jnp.maximum(state.grasp_mrad - gain * clean.grasp_mrad, lowest), highest)
    # One Newton step of 1/sqrt: a quaternion of single precision stays on the unit sphere for ever.
    return position_um, quat * (1.5 - 0.5 * square), as_int(grasp)


def _clamp(setup: RavenSetup, params: TargetParams, jpos: Vec, yaw: Scalar) -> tuple[Vec, Scalar]:
    """Joints within the limits, and whether any was at or beyond one. Jaws keep the unclamped
    yaw.
    """
    angles, reached = list(jpos), False
    for i, (low, high) in enumerate(zip(params.lower, params.upper, strict=True)):
        reached = reached | (jpos[i] <= low) | (jpos[i] >= high)
        angles[i] = jnp.minimum(jnp.maximum(jpos[i], low), high)
    lowest_yaw = limits.soft_limits(setup.tools[0], setup.software).lower[5]
    if lowest_yaw is not None:
        reached = reached | (yaw <= lowest_yaw)
    return Vec(angles), reached
