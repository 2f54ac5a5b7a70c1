"""Reads a recording of an arm with two tips in each row, measured by cameras and reported by the
robot: `camera_poses_left_arm.parquet` (a Raven-II, UC Berkeley, 2014; repository rll/raven_2).

The frame of the recording has z upward and the remote centre at its origin: frame 0 of the gold arm
with other names of the axes. Of the 24 assignments, one alone gives joints within their limits.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.errors import UserError
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import kinematics, limits
from ravenjax.robots.raven2.geometry.joints import Pose, joint_from_theta

FILE = "camera_poses_left_arm.parquet"
ARM = "gold"
AXES = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation from the recording's frame to frame 0."""
BAD_M = 0.05
"""A row whose two positions are further apart than this, before any fit, is a bad frame."""


class CameraLog(NamedTuple):
    """Rows by time, in the axes of frame 0. The camera's origin is unknown."""

    trajectory: np.ndarray  # [n] number of the motion
    # [n, 7] rad and m, of the reported pose, with jaws closed.
    joints: np.ndarray
    rotation: np.ndarray  # [n, 3, 3] reported; columns are the axes of the jaws
    reported: np.ndarray  # [n, 3] m
    camera: np.ndarray  # [n, 3] m

    def rows(self, index: np.ndarray | slice) -> CameraLog:
        """Return some of the log's rows."""
        return CameraLog(*(column[index] for column in self))


def halves(values: np.ndarray, axis: int = 0) -> list[np.ndarray]:
    """Return the first half of the rows, for the fit, and the second half, for the test."""
    return np.split(values, [values.shape[axis] // 2], axis)


def read(path: Path) -> CameraLog:
    """Read the recording without repeated times. Raises UserError if columns are missing."""
    table = pd.read_parquet(path)
    tips = {who: [f"{who}_{axis}_m" for axis in "xyz"] for who in ("camera", "reported")}
    turns = [f"reported_r{i}{j}" for i in range(3) for j in range(3)]
    wanted = [*tips["camera"], *tips["reported"], *turns, "time_s"]
    if lacking := [name for name in wanted if name not in table]:
        raise UserError(f"{path}: no column {', '.join(lacking)}; expected those of {FILE}")
    table = pd.DataFrame(table.drop_duplicates("time_s").sort_values("time_s"))
    camera, reported = (np.asarray(table[names], float) for names in tips.values())
    good = np.linalg.norm(camera - reported, axis=1) < BAD_M
    table, camera, reported = table.loc[good], camera[good] @ AXES.T, reported[good] @ AXES.T
    left, _, right = np.linalg.svd(np.asarray(table[turns], float).reshape(-1, 3, 3))
    rotation = AXES @ (left @ right)
    return CameraLog(
        np.asarray(table["trajectory"]), joints(reported, rotation), rotation, reported, camera
    )


def joints(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the joints [n, 7] (rad, m) nearest to home of poses [n, 3], [n, 3, 3] in frame 0."""

    def one(position: jax.Array, rotation: jax.Array) -> tuple[jax.Array, jax.Array]:
        pose = Pose(
            Vec(position[i] for i in range(3)),
            Vec(Vec(row[i] for i in range(3)) for row in rotation),
        )
        solutions = kinematics.inverse_candidates(ARM, pose)
        angles = [jnp.stack([*joint_from_theta(ARM, theta, 0.0)]) for theta, _ in solutions]
        return jnp.stack(angles), jnp.stack([valid for _, valid in solutions])

    with jax.enable_x64(True):
        # Compiles in a third of the time, for code that runs once.
        solve = jax.jit(jax.vmap(one), compiler_options={"xla_disable_hlo_passes": "fusion"})
        candidates, valid = (np.asarray(x) for x in solve(position, rotation))
    home = np.array([*limits.HOME_JPOS[:5], 0.0, 0.0])
    apart = np.where(valid, np.square(candidates - home).sum(axis=-1), np.inf)
    return np.take_along_axis(candidates, apart.argmin(axis=1)[:, None, None], axis=1)[:, 0]
