"""Operator: the hands' motion, looked up by tick, becomes the packets that the console sends. Traced; no state.

A packet carries whole numbers. The console truncates the *scaled position* and sends the difference of two truncated
ones, so that the robot's accumulator never drifts from the hand by more than a micrometre.
"""

from __future__ import annotations

from typing import Any, Protocol

import jax
import jax.numpy as jnp

from ravenjax.robot import kinematics
from ravenjax.robot.mapping import position_from_itp, position_to_itp, quat_from_matrix, quat_mul
from ravenjax.robot.motion import ARM_COLUMNS, NOMINAL_SCALE
from ravenjax.robot.packet import SIZE_BYTES, Packet
from ravenjax.types import Scalar, Setup, Vec, as_int, per_arm, real, record, replace, to_int32


@record
class Params:
    """What a campaign may vary of the console."""

    scale: Scalar  # 1, tip motion per hand motion; SEED uses 0.05 .. 0.2
    start_position: tuple[Vec, ...]  # um, tip in frame 0 where the motion starts; console "absolute" only
    start_quat: tuple[Vec, ...]  # x, y, z, w, tip in frame 0 where the motion starts; console "absolute" only
    start_grasp: tuple[Scalar, ...]  # mrad, jaw opening where the motion starts; console "absolute" only


def params(setup: Setup, start_jpos: tuple[tuple[float, ...], ...], scale: float = NOMINAL_SCALE) -> Params:
    """Params of a motion that starts in `start_jpos` (`Motion.start_jpos`: per arm, 7 joints in rad and m)."""
    with jax.enable_x64(True):
        poses = per_arm(setup, lambda i, arm: kinematics.forward(arm, Vec(jnp.float64(q) for q in start_jpos[i])))
        quats = [quat_from_matrix(pose.rotation) for pose in poses]
    return Params(
        scale=scale,
        start_position=tuple(Vec(float(x) * 1e6 for x in pose.position) for pose in poses),
        start_quat=tuple(Vec(float(x) for x in quat) for quat in quats),
        start_grasp=tuple(float(int((jpos[5] + jpos[6]) * 1000.0)) for jpos in start_jpos),
    )


@record
class Row:
    """The hands and the pedal at one millisecond; as `ravenjax.robot.motion.Motion`."""

    position: tuple[Vec, ...]  # um, ITP frame, before scaling
    quat: tuple[Vec, ...]  # x, y, z, w
    grasp: tuple[Scalar, ...]  # mrad, positive closes
    surgeon_mode: Scalar  # int32, 1 pedal down


def lookup(table: tuple[Any, ...], k: Scalar) -> Row:
    """Row `k` of a motion, rows before the first and after the last being those.

    table: the columns of `Motion.table()`, each a 1-D array. The only indexing in the whole tick.
    """
    k = jnp.minimum(jnp.maximum(as_int(k), 0), table[0].shape[0] - 1)
    values = [column.at[k].get(mode="clip", wrap_negative_indices=False) for column in table]
    width = len(ARM_COLUMNS)
    arms = [values[i : i + width] for i in range(0, len(values) - 1, width)]
    return Row(
        position=tuple(Vec(arm[0:3]) for arm in arms),
        quat=tuple(Vec(arm[3:7]) for arm in arms),
        grasp=tuple(arm[7] for arm in arms),
        surgeon_mode=as_int(values[-1]),
    )


class Doing(Protocol):
    """What hands and foot do beyond what was planned."""

    @property
    def released(self) -> Scalar:
        """bool, the foot is off the pedal"""
        ...

    @property
    def correction(self) -> tuple[Vec, ...]:
        """m, frame 0, by which each tip is moved"""
        ...


def moved(setup: Setup, params: Params, row: Row, doing: Doing) -> Row:
    """The row of an operator who does more than was planned."""

    def hand(i: int, arm: str) -> Vec:
        return row.position[i] + position_to_itp(arm, doing.correction[i]) * (1e6 / params.scale)

    released = jnp.where(doing.released, 0, row.surgeon_mode)
    return replace(row, position=per_arm(setup, hand), surgeon_mode=released)


def packet(setup: Setup, params: Params, row: Row, row_before: Row, sequence: Scalar) -> Packet:
    """The packet that the console sends for `row`, `row_before` being that of the packet before.

    While the pedal is up a console of increments sends no motion: that is how the surgeon repositions the hands.
    """
    pedal = row.surgeon_mode > 0
    row, row_before, params = real(setup, (row, row_before, params))
    form = _absolute if setup.console == "absolute" else _increment
    motion = per_arm(setup, lambda i, arm: form(i, arm, params, row, row_before, pedal))
    return Packet(
        received=jnp.int32(1),
        size=jnp.int32(SIZE_BYTES[setup.console]),
        sequence=as_int(sequence),
        delta=tuple(delta for delta, _, _ in motion),
        quat=tuple(quat for _, quat, _ in motion),
        grasp=tuple(grasp for _, _, grasp in motion),
        surgeon_mode=as_int(pedal),
    )


def _increment(i: int, arm: str, params: Params, row: Row, before: Row, pedal: Scalar) -> tuple[Vec, Vec, Scalar]:
    """Increments since the row before, in the ITP frame (raven2 `local_io.cpp` accumulates them)."""
    delta = (row.position[i] * params.scale).map(to_int32) - (before.position[i] * params.scale).map(to_int32)
    x, y, z, w = before.quat[i]
    turn = quat_mul(row.quat[i], Vec((-x, -y, -z, w)))
    length = jnp.sqrt(sum(c * c for c in turn))
    still = (0.0, 0.0, 0.0, 1.0)
    return (
        delta.map(lambda d: jnp.where(pedal, d, 0)),
        turn.map(lambda c, rest: jnp.where(pedal, c / length, rest), still),
        jnp.where(pedal, to_int32(row.grasp[i]) - to_int32(before.grasp[i]), 0),
    )


def _absolute(i: int, arm: str, params: Params, row: Row, before: Row, pedal: Scalar) -> tuple[Vec, Vec, Scalar]:
    """Desired pose in frame 0 and jaw opening (raven2_sim `Real_Packet_Generator.py`)."""
    position = params.start_position[i] + position_from_itp(arm, row.position[i] * params.scale)
    x, y, z, w = row.quat[i]
    turn = Vec((*position_from_itp(arm, Vec((x, y, z))), w))
    return position.map(to_int32), quat_mul(turn, params.start_quat[i]), to_int32(params.start_grasp[i] - row.grasp[i])
