"""Computes which poses of a recording an arm can reach within its joint limits."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS, ArmName

MARGIN_RAD, MARGIN_M = math.radians(1.0), 2e-3
"""Distance to keep from the soft limits, because the robot lags behind the operator."""

LARGEST_STEP = 0.1
"""Largest step of a joint per millisecond, rad or m. A larger step is no motion of the arm, but a
change to another solution of the inverse kinematics.
"""

BLOCK_ROWS = 4096

_INSERTION = JOINTS.index("insertion")


class Bounds(NamedTuple):
    """Soft limits of shoulder, elbow (rad), insertion (m), tool roll and wrist (rad), without
    margin; and how the control software limits the opening of the jaws.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    # Gain on the commanded change, and least and greatest opening, mrad, at which it is limited.
    jaws: tuple[float, float, float] = (1.0, -math.inf, math.inf)

    def within(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest joint positions [5] of a motion, which include margins."""
        margin = np.where(np.arange(5) == _INSERTION, MARGIN_M, MARGIN_RAD)
        return np.array(self.lower, float) + margin, np.array(self.upper, float) - margin


class Poses(NamedTuple):
    """Desired tip poses of some arms, one row per millisecond."""

    arms: tuple[ArmName, ...]
    position: np.ndarray  # [T, A, 3] m
    quat: np.ndarray  # [T, A, 4]
    opening_mrad: np.ndarray  # [T, A]

    def part(self, begin: int, end: int) -> "Poses":
        """Return the rows from `begin` to before `end`."""
        return Poses(self.arms, *(values[begin:end] for values in self[1:]))


class ArmReach(NamedTuple):
    """Joint positions at which the tips of some arms have the desired poses."""

    jpos: np.ndarray  # [T, A, 7] rad and m
    inside: np.ndarray  # [T, A] whether the pose is reachable within the joint limits
    leaps: np.ndarray  # [T] whether some joint jumps between this row and the row before

    def first_bad(self, begin: int, end: int) -> int | None:
        """Return the first row that prevents a replay of the rows `begin` to `end` - 1."""
        bad = ~np.all(self.inside[begin:end], axis=1) | self.leaps[begin:end]
        # A leap from the row before `begin` is not replayed.
        bad[0] = not np.all(self.inside[begin])
        return begin + int(np.argmax(bad)) if bad.any() else None


def reach_poses(poses: "Poses", bounds: Bounds) -> ArmReach:
    """Return the joint positions that reach each desired pose."""
    parts = [_arm_joints(poses, i, bounds) for i in range(len(poses.arms))]
    jpos, inside = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
    # Joint 6, the second jaw, follows from joint 5 and the opening, so it is left out.
    steps = np.abs(np.diff(jpos[..., :6], axis=0, prepend=jpos[:1, :, :6])).max(axis=(1, 2))
    return ArmReach(jpos, inside, steps >= LARGEST_STEP)


def _arm_joints(poses: "Poses", i: int, bounds: Bounds) -> tuple[np.ndarray, np.ndarray]:
    # Returns joint positions [T, 7] of the arm with index i, and whether they are within the limits
    # [T]. Of several solutions it takes the first within the limits, or the first if none is.
    lower, upper = bounds.within()
    rows, chosen, inside = len(poses.position), [], []
    for begin in range(0, rows, BLOCK_ROWS):
        candidates, valid = _candidates(poses, i, np.arange(begin, min(begin + BLOCK_ROWS, rows)))
        limited = candidates[..., :5]  # all joints except the jaws
        fits = valid & ((limited >= lower) & (limited <= upper)).all(-1)
        first = np.argmax(fits, axis=1)
        chosen.append(np.take_along_axis(candidates, first[:, None, None], axis=1)[:, 0])
        inside.append(fits.any(axis=1))
    return np.concatenate(chosen), np.concatenate(inside)


def unreached_reason(poses: "Poses", row: int, bounds: Bounds) -> str:
    """Return why the poses of a row cannot be reached, as text."""
    lower, upper = bounds.within()
    for i, arm in enumerate(poses.arms):
        candidates, valid = _candidates(poses, i, np.array([row]))
        if not valid.any():
            return f"no joint positions of {arm} bring its tip to this pose"
        reachable = candidates[0][valid[0], :5]
        excess = np.maximum(lower - reachable, reachable - upper)
        # The solution that exceeds the limits least, and its joint that exceeds them most.
        nearest = int(np.argmin(excess.max(axis=1)))
        joint = int(np.argmax(excess[nearest]))
        if excess[nearest, joint] > 0.0:
            scale, unit = (1e3, "mm") if joint == _INSERTION else (math.degrees(1.0), "deg")
            value, low, high = scale * np.array([reachable[nearest], lower, upper])[:, joint]
            return (
                f"{JOINTS[joint]} of {arm} would be at {value:.2f} {unit}, but must be within"
                f" {low:.2f} to {high:.2f} {unit}"
            )
    return f"a joint would step by more than {LARGEST_STEP:g} rad or m within a millisecond"


def _candidates(poses: "Poses", i: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the eight solutions of inverse kinematics for n <= BLOCK_ROWS rows of the arm with
    index i: joint positions [n, 8, 7], and whether each is valid [n, 8].
    """
    from ravenjax.numbers.lazy import jax

    # Always BLOCK_ROWS rows, the last repeated, so that JAX compiles the solver only once.
    index = rows[np.minimum(np.arange(BLOCK_ROWS), len(rows) - 1)]
    pose = poses.position[index, i], poses.quat[index, i], poses.opening_mrad[index, i] * 1e-3
    with jax.enable_x64(True):
        solution, valid = (np.array(x)[: len(rows)] for x in _solver(poses.arms[i])(*pose))
    # The tool roll (joint 3) is the same after a whole turn. Take it within half a turn of 0.
    turn = 2.0 * math.pi
    solution[..., 3] -= turn * np.round(solution[..., 3] / turn)
    return solution, valid


@functools.cache
def _solver(arm: ArmName) -> Callable[..., Any]:
    # Compiles the inverse kinematics of an arm for many poses at once.
    from ravenjax.numbers.lazy import jax, jnp
    from ravenjax.robots.raven2.geometry import kinematics
    from ravenjax.robots.raven2.geometry.joints import joint_from_theta
    from ravenjax.robots.raven2.geometry.mapping import matrix_from_quat

    def solve(position, quat, opening) -> tuple[Any, Any]:
        # Returns all joint positions [8, 7] that reach one pose, and whether each is valid.
        pose = kinematics.Pose(Vec(position), matrix_from_quat(Vec(quat)))
        candidates = kinematics.inverse_candidates(arm, pose)
        solutions = [jnp.stack([*joint_from_theta(arm, theta, opening)]) for theta, _ in candidates]
        return jnp.stack(solutions), jnp.stack([jnp.asarray(valid) for _, valid in candidates])

    return jax.jit(jax.vmap(solve))
