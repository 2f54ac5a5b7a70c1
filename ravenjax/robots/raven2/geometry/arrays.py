"""Computes kinematics, transmission and gravity for arrays of poses, in float64, with NumPy.

Joints are on the last axis, in the order shoulder, elbow (rad), insertion (m), tool_roll, wrist,
grasp1, grasp2 (rad). Any leading axes are allowed, and arguments broadcast against each other.
Poses are those of the jaw axis in frame 0 of the arm. Results are NumPy arrays. Numbers in
arguments must be finite and real, and rotations orthonormal and right-handed. Other numbers, a
wrong shape or an unknown name raise UserError, a ValueError. Results may contain NaN.
"""

# Callers may pass anything.
# pyright: reportUnnecessaryIsInstance=false

import contextlib
from collections.abc import Generator

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.numbers import Vec, run_eagerly
from ravenjax.robots.raven2.arms import ARMS, JOINTS
from ravenjax.robots.raven2.geometry import gravity, kinematics, transmission
from ravenjax.robots.raven2.geometry.joints import Pose

Array = np.ndarray

MAX_ROTATION_ERROR = 1e-3
"""Largest entry of R^T R - 1 for a rotation R. Rounding to single precision causes far less."""


def forward_kinematics(jpos: ArrayLike, arm: str) -> tuple[Array, Array]:
    """Return position [..., 3] (m) and rotation [..., 3, 3] of the jaw axis at `jpos` [..., 7].

    The yaw of the jaws is (grasp2 - grasp1) / 2.
    """
    (joints,) = _check_arguments(arm, jpos=(jpos, (7,)))
    with _array_arithmetic():
        pose = kinematics.forward_pose(arm, _to_vec(joints))
    return _stack(pose.position), _stack_rows(pose.rotation)


def jaw_rotation(arm: str, jpos: Array) -> Array:
    """Return the rotation [..., 3, 3] of the jaws at `jpos` [..., 7]; NaN if a joint is NaN."""
    with _array_arithmetic():
        return _stack_rows(kinematics.forward_pose(arm, _to_vec(np.asarray(jpos, float))).rotation)


def inverse_kinematics(
    position: ArrayLike, rotation: ArrayLike, grasp: ArrayLike, jpos_ref: ArrayLike, arm: str
) -> tuple[Array, Array]:
    """Return the joints jpos_d [..., 7] that reach the pose, and the status [...].

    position: [..., 3], m; rotation: [..., 3, 3], columns are the axes of the jaws' frame; grasp:
    [...], rad, jaw opening; jpos_ref: [..., 7], measured joints. Of all solutions, jpos_d is the
    nearest to `jpos_ref`. Joint limits are ignored.

    Status 0: valid. Status -1: the control software would reject the pose and keep its last jpos_d;
    the returned jpos_d is NaN. Status -2: the wrist is at the remote centre, a singularity; the
    angles are those that the control software would use.
    """
    positions, rotations, openings, reference = _check_arguments(
        arm,
        position=(position, (3,)),
        rotation=(rotation, (3, 3)),
        grasp=(grasp, ()),
        jpos_ref=(jpos_ref, (7,)),
    )
    # Without the broadcast axes, an error names the index in the caller's array
    _require_rotations(_check_numbers("rotation", rotation, (3, 3)))
    pose = Pose(_to_vec(positions), Vec(_to_vec(rotations[..., k, :]) for k in range(3)))
    with _array_arithmetic():
        solution = kinematics.inverse_joints(arm, pose, openings[()], _to_vec(reference))
    jpos_d, status = _stack(solution.jpos), np.asarray(solution.status)
    jpos_d[status == kinematics.REJECTED] = np.nan
    return jpos_d, status


def motor_from_joint(jpos: ArrayLike, arm: str, tool: str = "r_grasper") -> Array:
    """Return the motor angles [..., 7] (rad) at `jpos` [..., 7] (rad, m), with cable coupling."""
    (joints,) = _check_arguments(arm, jpos=(jpos, (7,)))
    return _stack(transmission.motor_from_joint(arm, tool, _to_vec(joints)))


def joint_from_motor(mpos: ArrayLike, arm: str, tool: str = "r_grasper") -> Array:
    """Return the joints [..., 7] (rad, m) at motors `mpos` [..., 7] (rad), with cable coupling."""
    (motors,) = _check_arguments(arm, mpos=(mpos, (7,)))
    return _stack(transmission.joint_from_motor(arm, tool, _to_vec(motors)))


def gravity_torque(jpos: ArrayLike, arm: str) -> Array:
    """Return the capstan torques [..., 3] (Nm) that compensate gravity at `jpos` [..., 7]."""
    (joints,) = _check_arguments(arm, jpos=(jpos, (7,)))
    with _array_arithmetic():
        return _stack(gravity.gravity_torque(arm, _to_vec(joints)))


@contextlib.contextmanager
def _array_arithmetic() -> Generator[None]:
    """Let functions of single numbers compute with NumPy arrays, without warnings about NaN."""
    with run_eagerly(), np.errstate(all="ignore"):
        yield


def _to_vec(rows: Array) -> Vec:
    # Returns the entries of the last axis as a Vec of arrays.
    return Vec(rows[..., k] for k in range(rows.shape[-1]))


def _stack(numbers: Vec) -> Array:
    # Returns the arrays of a Vec as one array, with the entries of the Vec on the last axis.
    return np.stack(np.broadcast_arrays(*numbers), axis=-1)


def _stack_rows(rows: Vec) -> Array:
    return np.stack([_stack(row) for row in rows], axis=-2)


def _check_arguments(arm: str, **arguments: tuple[ArrayLike, tuple[int, ...]]) -> list[Array]:
    # Returns the arguments as arrays with broadcast leading axes. Raises UserError. arguments: name
    # -> (value, shape of the last axes).
    if arm not in ARMS:
        raise UserError(describe_unknown_name("arm", arm, ARMS))
    arrays, leading_shapes = dict[str, Array](), dict[str, tuple[int, ...]]()
    for name, (value, last_shape) in arguments.items():
        arrays[name] = array = _check_numbers(name, value, last_shape)
        leading_shapes[name] = array.shape[: array.ndim - len(last_shape)]
    try:
        shape = np.broadcast_shapes(*leading_shapes.values())
    except ValueError:
        shapes = ", ".join(f"{name} {shape}" for name, shape in leading_shapes.items())
        raise UserError(
            f"the leading axes of the arguments do not broadcast against each other: {shapes}"
        ) from None
    return [np.broadcast_to(a, shape + arguments[name][1]) for name, a in arrays.items()]


def _check_numbers(name: str, value: ArrayLike, last_shape: tuple[int, ...]) -> Array:
    # Returns finite numbers as a float64 array [..., *last_shape], or raises UserError.
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise UserError(f"{name} is not an array of numbers: {error}") from None
    # Integers, unsigned integers and floating-point numbers
    if array.dtype.kind not in "iuf" or np.ma.is_masked(value):
        kind = "masked numbers" if np.ma.is_masked(value) else str(array.dtype)
        raise UserError(f"{name} is not an array of numbers: got {kind}, expected real numbers")
    if array.shape[max(array.ndim - len(last_shape), 0) :] != last_shape:
        expected = ", ".join(("...", *map(str, last_shape)))
        order = f" in the order {', '.join(JOINTS)}" if last_shape == (7,) else ""
        raise UserError(f"{name} has shape {array.shape}, expected [{expected}]{order}")
    if wrong_indices := np.argwhere(~np.isfinite(array)).tolist():
        index = wrong_indices[0]
        joint = f" ({JOINTS[index[-1]]})" if last_shape == (7,) else ""
        where = f"{name}{index or ''}{joint}"
        raise UserError(f"{where} is {array[tuple(index)]}, expected a finite number")
    return array.astype(np.float64)


def _require_rotations(matrices: Array) -> None:
    # Raises UserError for the first matrix that is no rotation.
    errors = np.abs(np.swapaxes(matrices, -1, -2) @ matrices - np.eye(3)).max(axis=(-1, -2))
    is_wrong = (errors > MAX_ROTATION_ERROR) | (np.linalg.det(matrices) < 0)
    if is_wrong.any():
        index = np.argwhere(is_wrong)[0].tolist()
        error, problem = errors[tuple(index)], "is a reflection"
        if error > MAX_ROTATION_ERROR:
            problem = f"has columns that are not orthonormal (off by {error:.2g})"
        raise UserError(
            f"rotation{index or ''} {problem}, expected a rotation matrix,"
            " whose columns are the axes of the jaws' frame"
        )
