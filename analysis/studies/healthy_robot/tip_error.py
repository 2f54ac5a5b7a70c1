"""Computes the tip error of a healthy arm: as measured by cameras, in drawn robots, and with the
fitted parameters of one arm.

The tip error is the distance from the reported tip after registration by a rigid motion, which is
fitted to the first half of the log. The distribution of kinematic errors has one fitted factor:
half of the drawn robots have a larger median error on the first half than the cameras measured. The
factor is an upper bound, because it attributes the whole measured error to the arm.
"""

from typing import NamedTuple

import numpy as np

from ravenjax.numbers import paths, tree
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.plant import kinematic_errors
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED, KinematicErrors
from ravenjax.robots.raven2.setup import RavenSetup
from studies.healthy_robot.camera_log import ARM, CameraLog, halves

LIMIT_M = 3e-3
FAR_M = 2e-3
"""Distances beyond this count linearly, as in Huber's loss."""
ITERATIONS = 10
PATHS, SPREAD = tuple(MEASURED), np.array(tuple(MEASURED.values()))


class RigidMotion(NamedTuple):
    """A rotation and a displacement, or one of each for each of many sets."""

    rotation: np.ndarray  # [..., 3, 3]
    translation: np.ndarray  # [..., 3] m

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return moved points, [..., n, 3]."""
        return points @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :]


def fit_motion(points: np.ndarray, onto: np.ndarray) -> RigidMotion:
    """Return the motion of `points` [n, 3] onto others [..., n, 3], m (Kabsch, Huber's loss)."""
    weight, motion = np.ones(onto.shape[:-1]), RigidMotion(np.eye(3), np.zeros(3))
    for _ in range(ITERATIONS):
        share = (weight / weight.sum(axis=-1, keepdims=True))[..., None]
        centre, other = (share * points).sum(axis=-2), (share * onto).sum(axis=-2)
        spread = np.swapaxes(share * (points - centre[..., None, :]), -1, -2) @ (
            onto - other[..., None, :]
        )
        left, _, right = np.linalg.svd(spread)
        left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
        rotation = np.swapaxes(left @ right, -1, -2)
        motion = RigidMotion(rotation, other - (rotation @ centre[..., None])[..., 0])
        weight = huber(np.linalg.norm(onto - motion(points), axis=-1))
    return motion


def huber(distance: np.ndarray) -> np.ndarray:
    """Return the weight of the square of each distance, m."""
    return 1.0 / np.maximum(1.0, distance / FAR_M)


def errors_of(log: CameraLog, true: np.ndarray) -> list[np.ndarray]:
    """Return tip errors [..., n] (m) on both halves of a log, for tips [..., n, 3]."""
    return halves(np.linalg.norm(vectors_of(log, true), axis=-1), axis=-1)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.square(errors).mean()))


def vectors_of(log: CameraLog, true: np.ndarray) -> np.ndarray:
    """Return the tip errors of `errors_of` as vectors, [..., n, 3] m."""
    motion = fit_motion(halves(log.reported)[0], halves(true, axis=-2)[0])
    return true - motion(log.reported)


def between(log: CameraLog, true: np.ndarray) -> np.ndarray:
    """Return the share of the second half's mean square error from trajectories, [...]."""
    vectors, trajectory = halves(vectors_of(log, true), axis=-2)[1], halves(log.trajectory)[1]
    means = np.empty_like(vectors)
    for number in np.unique(trajectory):
        mine = trajectory == number
        means[..., mine, :] = vectors[..., mine, :].mean(axis=-2, keepdims=True)
    above, below = ((part**2).sum(axis=-1).mean(axis=-1) for part in (means, vectors))
    return above / below


def quadratic_left(log: CameraLog) -> list[np.ndarray]:
    """Return the measured tip errors, m, that a null model leaves on both halves. The null model is
    a static quadratic map of six joints, fitted to the first half.
    """
    joints = log.joints[:, :6]
    first, seen = halves(joints)[0], vectors_of(log, log.camera)
    scaled = (joints - first.mean(axis=0)) / first.std(axis=0)
    pairs = [scaled[:, i] * scaled[:, j] for i in range(6) for j in range(i, 6)]
    columns = np.column_stack([np.ones(len(scaled)), scaled, *pairs])
    best, *_ = np.linalg.lstsq(halves(columns)[0], halves(seen)[0], rcond=None)
    return halves(np.linalg.norm(seen - columns @ best, axis=1))


def with_values(values: jax.Array) -> KinematicErrors:
    """Return kinematic errors with `values` [16] at PATHS."""
    exact, entries = kinematic_errors.no_errors(), {path: values[k] for k, path in enumerate(PATHS)}
    leaves = paths.path_leaves(exact, RavenSetup())
    return tree.fill_tree(exact, [entries.get(path, number) for path, number in leaves])


def true_tips(values: jax.Array, joints: jax.Array) -> jax.Array:
    """Return [n, 3] true tips (m, frame 0) of an arm that reports joints [n, 7]."""
    errors = with_values(values)
    links = kinematic_errors.true_joints(errors, Vec(joints[:, i] for i in range(7)))
    return jnp.stack([*kinematic_errors.true_tip(ARM, errors, None, links)], axis=-1)


_tips_of_robots = jax.jit(jax.vmap(true_tips, in_axes=(0, None)))


def draw(robots: int, seed: int = 0) -> np.ndarray:
    """Return [robots, 16] kinematic errors at PATHS, drawn as in a campaign."""
    return np.random.default_rng(seed).normal(size=(robots, len(PATHS))) * SPREAD


def predicted(log: CameraLog, robots: np.ndarray) -> list[np.ndarray]:
    """Return tip errors [robots, n] (m) on both halves of a log, for errors [robots, 16]."""
    return errors_of(log, tips_of(log, robots))


def tips_of(log: CameraLog, robots: np.ndarray) -> np.ndarray:
    """Return [robots, n, 3] true tips (m) of robots with errors [robots, 16]."""
    with jax.enable_x64(True):
        return np.asarray(_tips_of_robots(robots, log.joints))


def factor(log: CameraLog, robots: np.ndarray) -> float:
    """Return the factor on MEASURED with which the median robot has the cameras' median error."""
    goal = float(np.median(errors_of(log, log.camera)[0]))
    low, high = 0.05, 4.0
    for _ in range(12):
        middle = np.sqrt(low * high)
        larger = float(np.median(np.median(predicted(log, middle * robots)[0], axis=1))) > goal
        low, high = (low, middle) if larger else (middle, high)
    return float(np.sqrt(low * high))


def gaussian(log: CameraLog, seed: int = 0) -> np.ndarray:
    """Return [n] tip errors of a null model, m: isotropic normal with the first half's rms."""
    deviation = rms(errors_of(log, log.camera)[0]) / np.sqrt(3.0)
    normal = np.random.default_rng(seed).normal(size=(len(halves(log.joints)[1]), 3))
    return np.linalg.norm(deviation * normal, axis=1)
