"""Adds up the packets' increments to the desired pose (raven2: local_io.cpp, mapping.cpp).

Increments are added to an accumulated pose at every run level. In pedal-down, the desired pose
becomes the accumulated pose whenever the update flag is set. If the desired pose is set by the
robot (pedal up, joint limit, initialisation), the accumulated pose restarts from there. From then
on, the console's pose differs from the robot's by a constant offset.
"""

import numpy as np

from ravenjax.numbers import INT32_MIN, Scalar, Vec, as_int, describe_fields, record, replace, where
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import cast_to_real, narrow_numbers, per_arm, widen_numbers
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry import mapping
from ravenjax.robots.raven2.geometry.stored_pose import StoredPose
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.original.literal import select_evaluation
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup
from ravenjax.stages import check

GRASP_RESET_MRAD = 785
"""If the jaw differs by more than 45 deg (785.4 mrad), it is reset; raven2: local_io.cpp."""

NO_PACKET_SEQUENCE = 111
"""last_seq before the first packet; raven2: local_io.cpp."""

TIMEOUT_TICKS = 5000
"""Cycles without an update after which the console has timed out; raven2: local_io.cpp."""


@describe_fields
@record
class TeleoperationParams:
    grasp_gain: Scalar  # raven2: local_io.cpp
    grasp_min_mrad: Scalar
    grasp_max_mrad: Scalar
    timeout_ticks: Scalar


@record
class Accumulator:
    """Pose of one arm that the console has commanded: the sum of all increments."""

    pose: StoredPose
    quaternion: Vec  # (x, y, z, w), orientation in the wide type, never re-normalised


@record
class TeleoperationState:
    arms: PerArm[Accumulator]
    updated: Scalar  # int32 flag: the accumulator has changed since the device last read it
    age_ticks: Scalar  # int32 cycles since the last update
    surgeon_mode: Scalar  # int32, 1 engaged
    last_seq: Scalar  # int32, sequence number of the last accepted packet
    timeout: check.CheckHistory  # margin: cycles left


def params(setup: RavenSetup) -> TeleoperationParams:
    """Return the original's values. Jaw: raven2 gain 1, -10..90 deg; fork gain 2, -30..90 deg."""
    gain, lowest_mrad, highest_mrad = map(np.int32, stored.jaw_commands(setup.software))
    return TeleoperationParams(gain, lowest_mrad, highest_mrad, np.int32(TIMEOUT_TICKS))


def init(setup: RavenSetup, poses: PerArm[StoredPose]) -> TeleoperationState:
    """Return the accumulators at `poses`, before the first packet."""
    return TeleoperationState(
        per_arm(setup, lambda i, _: Accumulator(poses[i], _quaternion(setup, poses[i]))),
        updated=np.int32(0),
        age_ticks=np.int32(-1),  # the first cycle starts the clock
        surgeon_mode=np.int32(0),
        last_seq=np.int32(NO_PACKET_SEQUENCE),
        timeout=check.init(setup),
    )


def _quaternion(setup: RavenSetup, pose: StoredPose) -> Vec:
    return select_evaluation(setup).quat_from_matrix(widen_numbers(setup, pose.rotation))


def accumulate_increments(
    setup: RavenSetup,
    params: TeleoperationParams,
    state: TeleoperationState,
    accepted: Scalar,
    packet: Packet,
) -> TeleoperationState:
    """Return the state after a packet. If it is `accepted` (bool), its increments are added to the
    accumulated poses. A packet of an absolute console sets these poses instead.
    """

    def add_packet(i: int, arm: ArmName) -> Accumulator:
        # Returns the accumulated pose of one arm after the packet.
        old, quaternion = state.arms[i], widen_numbers(setup, packet.quat[i])
        if setup.console == "absolute":
            rotation = narrow_numbers(setup, mapping.matrix_from_quat(quaternion))
            pose = StoredPose(packet.delta[i], rotation, packet.grasp[i])
            return Accumulator(pose, old.quaternion)
        increment = mapping.rotation_from_itp(arm, mapping.matrix_from_quat(quaternion))

        # In the original, a row of the rotation that is not finite makes this component of the
        # motion NaN, which is cast to INT32_MIN.
        def cast_motion(move: Scalar, row: Vec) -> Scalar:
            is_finite = (row[0] + row[1] + row[2]) * 0.0 == 0.0
            return jnp.where(is_finite, move, INT32_MIN)

        moves = mapping.position_from_itp(arm, packet.delta[i]).map(cast_motion, increment)
        rotation_quat = select_evaluation(setup).quat_from_matrix(increment)
        quaternion = mapping.quat_mul(rotation_quat, old.quaternion)
        opening = old.pose.grasp_mrad - params.grasp_gain * packet.grasp[i]
        # Comparisons in the original's order.
        opening = jnp.where(
            opening > params.grasp_max_mrad,
            params.grasp_max_mrad,
            jnp.where(opening < params.grasp_min_mrad, params.grasp_min_mrad, opening),
        )
        rotation = narrow_numbers(setup, mapping.matrix_from_quat(quaternion))
        return Accumulator(StoredPose(old.pose.position_um + moves, rotation, opening), quaternion)

    return replace(
        state,
        arms=where(accepted, per_arm(setup, add_packet), state.arms),
        updated=state.updated | as_int(accepted),
        surgeon_mode=jnp.where(accepted, packet.surgeon_mode, state.surgeon_mode),
        last_seq=jnp.where(accepted, packet.sequence, state.last_seq),
    )


def hand_over(
    setup: RavenSetup,
    params: TeleoperationParams,
    state: TeleoperationState,
    tick: Scalar,
    pedal_down: Scalar,
    desired: PerArm[StoredPose],
) -> tuple[TeleoperationState, PerArm[StoredPose]]:
    """Check whether the console has timed out. Return the new state, and the arms' desired poses.

    In pedal-down, desired poses become the accumulated poses, if a packet or `reset_origin` has
    updated these, or if the time-out has just tripped. Otherwise desired poses remain. Called once
    per cycle.
    """
    fresh = state.updated != 0
    age = jnp.where(fresh, 0, state.age_ticks + 1)
    engaged = state.surgeon_mode != 0
    timed_out = ~fresh & engaged & (age > params.timeout_ticks)
    update_desired = (fresh | timed_out) & pedal_down
    margin = jnp.where(engaged, cast_to_real(setup, params.timeout_ticks - age), np.inf)
    desired = per_arm(setup, lambda i, _: where(update_desired, state.arms[i].pose, desired[i]))
    # After a time-out the age restarts, and the console is not engaged until its next packet.
    state = replace(
        state,
        # The flag is cleared; the result is an int32 like the flag.
        updated=state.updated & 0,
        age_ticks=jnp.where(timed_out, 0, age),
        surgeon_mode=jnp.where(timed_out, 0, state.surgeon_mode),
        timeout=check.update_check(state.timeout, tick, timed_out, margin),
    )
    return state, desired


def reset_origin(
    setup: RavenSetup, state: TeleoperationState, reset: Scalar, desired: PerArm[StoredPose]
) -> TeleoperationState:
    """Return the state after this: if `reset`, accumulated poses become the desired poses, which
    counts as an update.
    """

    def restart(i: int, _: ArmName) -> Accumulator:
        # Returns one arm's accumulated pose: if `reset`, the desired pose. The accumulated opening
        # of the jaws remains, unless it differs much from the desired opening.
        old, new = state.arms[i], desired[i]
        reset_jaw = jnp.abs(old.pose.grasp_mrad - new.grasp_mrad) > GRASP_RESET_MRAD
        opening = jnp.where(reset_jaw, new.grasp_mrad, old.pose.grasp_mrad)
        pose = StoredPose(new.position_um, new.rotation, opening)
        return where(reset, Accumulator(pose, _quaternion(setup, new)), old)

    return replace(state, arms=per_arm(setup, restart), updated=state.updated | as_int(reset))
