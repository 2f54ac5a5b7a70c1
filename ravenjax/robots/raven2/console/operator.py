"""Makes the console's packets from a table of the hands' planned motion, one row per tick.

Hands may deviate from the plan: by a tremor, by a correction, or under the cue's force. These
displacements are added up in one offset per hand, which is the only state. The robot and the
nominal model both follow the hands.

A packet carries whole numbers. The console truncates the *scaled position* and sends the difference
of two truncated positions. Therefore the sum of the increments in the robot never differs from the
position of the hand by more than 1 um.
"""

from operator import add
from typing import Any, NamedTuple

import numpy as np

from ravenjax.numbers import cast_to_real, describe_fields, for_each_arm, jnp, per_arm, run_eagerly
from ravenjax.numbers.vec import Scalar, Vec, as_int, clamp, record, replace, to_int32, where
from ravenjax.parts import part
from ravenjax.robots.raven2.console.motion import ARM_COLUMNS, NOMINAL_SCALE
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, Packet
from ravenjax.robots.raven2.geometry import kinematics, mapping
from ravenjax.robots.raven2.setup import PerArm, RavenSetup


@describe_fields
@record
class OperatorParams:
    """Console parameters that a campaign may vary."""

    scale: Scalar  # teleoperation scale; the study SEED uses 0.05 .. 0.2
    start_position: PerArm[Vec]
    start_quat: PerArm[Vec]  # x, y, z, w
    start_grasp: PerArm[Scalar]
    own: Any = None  # parameters of a user's file that replaces the operator, in a field `hands`


def params(setup: RavenSetup, start_jpos: tuple[tuple[float, ...], ...]) -> OperatorParams:
    """Return the console's parameters for a motion that starts at the joints `start_jpos`.
    start_jpos: `Motion.start_jpos`, per arm 7 joints in rad and m.
    """
    with run_eagerly():
        jpos = [Vec(map(np.float64, joints)) for joints in start_jpos]
        poses = per_arm(setup, lambda i, arm: kinematics.forward_pose(arm, jpos[i]))
        quats = [mapping.quat_from_matrix(pose.rotation) for pose in poses]
    return OperatorParams(
        scale=NOMINAL_SCALE,
        start_position=tuple(Vec(float(x) * 1e6 for x in pose.position) for pose in poses),
        start_quat=tuple(quat.map(float) for quat in quats),
        # Jaw opening, truncated to whole mrad
        start_grasp=tuple(float(int((joints[5] + joints[6]) * 1000.0)) for joints in start_jpos),
        own=None if setup.hands is None else part.part_parameters((setup.hands,)),
    )


@record
class MotionRow:
    """One row of a `console.motion.Motion`: hands and pedal in one millisecond."""

    position: PerArm[Vec]  # um, ITP frame, before scaling
    quat: PerArm[Vec]  # x, y, z, w
    grasp: PerArm[Scalar]  # mrad, positive closes
    surgeon_mode: Scalar  # int32, 1 pedal down


def look_up_row(table: tuple[Any, ...], row: Scalar) -> MotionRow:
    """Return a row of a motion. row: its index, clamped to the first and last row. table: the
    columns of `Motion.table()`, each a 1-D array.
    """
    row = clamp(as_int(row), 0, table[0].shape[0] - 1)
    values = [column.at[row].get(mode="clip", wrap_negative_indices=False) for column in table]
    width = len(ARM_COLUMNS)
    # The last column is the pedal
    arms = [values[i : i + width] for i in range(0, len(values) - 1, width)]
    return MotionRow(
        position=tuple(Vec(arm[0:3]) for arm in arms),
        quat=tuple(Vec(arm[3:7]) for arm in arms),
        grasp=tuple(arm[7] for arm in arms),
        surgeon_mode=as_int(values[-1]),
    )


@record
class HandOffsets:
    """Displacement of the hands from their plan by tremor, correction or force."""

    offset: PerArm[Vec]  # um before scaling, axes of an ITP packet
    offset_before: PerArm[Vec]  # offset in the last packet


NO_OFFSETS = HandOffsets((), ())
"""Hands that cannot leave the plan: no code for offsets is generated."""


class Deviation(NamedTuple):
    """Deviations from the plan in a packet, in addition to `HandOffsets`; None: no deviation."""

    lag: Scalar | None = None  # int32, rows by which the hands are behind the plan
    lag_before: Scalar | None = None  # lag in the packet before
    grasp: PerArm[Scalar] | None = None  # mrad, jaw command in addition to the plan
    grasp_before: PerArm[Scalar] | None = None  # grasp in the packet before
    lifted: Scalar | None = None  # bool, the foot is off the pedal


NO_DEVIATION = Deviation()
"""An operator who follows the plan."""


def hands_on_plan(setup: RavenSetup) -> HandOffsets:
    """Return hands that are on the plan and may leave it."""
    still = for_each_arm(setup, Vec.full(3, cast_to_real(setup, 0.0)))
    return HandOffsets(still, still)


def add_hand_motion(hands: HandOffsets, motion: PerArm[Vec]) -> HandOffsets:
    """Return the hands after a motion that is added to the plan, um before scaling, ITP axes."""
    return replace(hands, offset=_add_each(hands.offset, motion))


def _add_each(values: tuple[Any, ...], more: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(map(add, values, more))


def add_tip_motion(
    setup: RavenSetup, params: OperatorParams, hands: HandOffsets, tips: PerArm[Vec]
) -> HandOffsets:
    """Return the hands after an added motion that moves each tip by `tips`, m in frame 0."""
    um_per_m = 1e6 / params.scale  # um of the hand per m of the tip
    motion = per_arm(setup, lambda i, arm: mapping.position_to_itp(arm, tips[i]) * um_per_m)
    return add_hand_motion(hands, motion)


def tip_offset(setup: RavenSetup, params: OperatorParams, hands: HandOffsets) -> PerArm[Vec]:
    """Return the tip offsets that the hands' offsets cause, m in frame 0."""
    m_per_um = params.scale * 1e-6  # m of the tip per um of the hand
    return per_arm(setup, lambda i, arm: mapping.position_from_itp(arm, hands.offset[i]) * m_per_um)


def mark_sent(hands: HandOffsets, fresh: Scalar) -> HandOffsets:
    """Return the hands after a tick. fresh: whether a packet with their offset was sent, bool."""
    return replace(hands, offset_before=where(fresh, hands.offset, hands.offset_before))


@record
class PacketTiming:
    """A packet, and the rows of the motion from which the packet is computed."""

    index: Scalar  # int32, index of the packet
    row: Scalar  # int32, row of the motion at the time of the packet
    before: Scalar  # int32, row of the packet before; increments are differences from that row


def row_timing(index: Scalar) -> PacketTiming:
    """Return the timing of a packet if a packet is sent in every row of the motion."""
    return PacketTiming(index, index, index - 1)


def make_packet(
    setup: RavenSetup,
    params: OperatorParams,
    motion: tuple[Any, ...],
    timing: PacketTiming,
    hands: HandOffsets = NO_OFFSETS,
    deviation: Deviation = NO_DEVIATION,
) -> Packet:
    """Return the packet that the console sends at `timing`.
    motion: columns as for `look_up_row`. While the pedal is up, a console that sends increments
    sends no motion, so that the operator can reposition the hands.
    """

    def row_at(index: Scalar, lag: Scalar | None, offset: PerArm[Vec]):
        # Returns the row of the plan, `lag` rows earlier, with the hands displaced by `offset`.
        row = look_up_row(motion, index if lag is None else index - lag)
        return replace(row, position=_add_each(row.position, offset)) if offset else row

    row = row_at(timing.row, deviation.lag, hands.offset)
    row_before = row_at(timing.before, deviation.lag_before, hands.offset_before)
    if deviation.grasp is not None and deviation.grasp_before is not None:
        row = replace(row, grasp=_add_each(row.grasp, deviation.grasp))
        row_before = replace(row_before, grasp=_add_each(row_before.grasp, deviation.grasp_before))
    if deviation.lifted is not None:
        row = replace(row, surgeon_mode=jnp.where(deviation.lifted, 0, row.surgeon_mode))
    sequence, pedal = timing.index + 1, row.surgeon_mode > 0
    row, row_before, params = cast_to_real(setup, (row, row_before, replace(params, own=None)))

    def increment(i: int, _: str):
        """Return the increments since the row before, in the ITP frame (raven2 `local_io.cpp`)."""
        position = (row.position[i] * params.scale).map(to_int32)
        delta = position - (row_before.position[i] * params.scale).map(to_int32)
        x, y, z, w = row_before.quat[i]
        turn = mapping.quat_mul(row.quat[i], Vec((-x, -y, -z, w)))
        length = jnp.sqrt(sum(c * c for c in turn))
        no_rotation = (0.0, 0.0, 0.0, 1.0)
        return (
            delta.map(lambda d: jnp.where(pedal, d, 0)),
            turn.map(lambda c, still: jnp.where(pedal, c / length, still), no_rotation),
            jnp.where(pedal, to_int32(row.grasp[i]) - to_int32(row_before.grasp[i]), 0),
        )

    def absolute(i: int, arm: str):
        """Return pose and jaw opening in frame 0 (raven2_sim `Real_Packet_Generator.py`)."""
        motion = mapping.position_from_itp(arm, row.position[i] * params.scale)
        position = params.start_position[i] + motion
        x, y, z, w = row.quat[i]
        turn = Vec((*mapping.position_from_itp(arm, Vec((x, y, z))), w))
        position = position.map(to_int32)
        quat = mapping.quat_mul(turn, params.start_quat[i])
        return position, quat, to_int32(params.start_grasp[i] - row.grasp[i])

    commands = per_arm(setup, absolute if setup.console == "absolute" else increment)
    delta, quat, grasp = zip(*commands, strict=True)
    return Packet(
        received=jnp.int32(1),
        size=jnp.int32(SIZE_BYTES[setup.console]),
        sequence=as_int(sequence),
        delta=delta,
        quat=quat,
        grasp=grasp,
        surgeon_mode=as_int(pedal),
    )
