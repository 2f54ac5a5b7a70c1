"""Fits the rigid motion between two sets of points, by least squares with lower weight for distant
points.
"""

from typing import NamedTuple

import numpy as np

FAR_M = 2e-3
"""Distances beyond this count linearly, as in Huber's loss."""
ITERATIONS = 10


class RigidMotion(NamedTuple):
    """A rotation and a displacement, or one of each for each of many sets."""

    rotation: np.ndarray  # [..., 3, 3]
    translation: np.ndarray  # [..., 3] m

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return moved points, [..., n, 3]."""
        return points @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :]


def fit(points: np.ndarray, onto: np.ndarray) -> RigidMotion:
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
