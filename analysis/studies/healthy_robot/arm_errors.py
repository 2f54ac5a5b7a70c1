"""Estimates the kinematic errors of one recorded arm by Gauss-Newton iteration on the first half of
a camera log. A rigid motion and the point of the jaws that the camera measures are estimated too.
The prior is normal, with the standard deviations of MEASURED. Rows of one motion are similar, so
each motion counts as one reading with the noise NOISE_M.
"""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import jax, jnp
from studies.healthy_robot import tip_error
from studies.healthy_robot.camera_log import CameraLog, halves
from studies.healthy_robot.tip_error import PATHS, SPREAD

# Assumed largest distance of the camera's point from the jaw axis
POINT_M = 0.01
NOISE_M = 2e-3  # about the median of the remaining error
ITERATIONS = 15
POINT = ("point",)
"""Parameters of the camera in the fit."""


class ArmFit(NamedTuple):
    """The fit of one arm."""

    values: np.ndarray  # [16] kinematic errors at PATHS; 0 if not fitted
    left: list[np.ndarray]  # m, remaining tip errors on the first and the second half
    own: list[np.ndarray]  # m, tip errors of an arm with only `values`


def fit(log: CameraLog, parts: Collection[str]) -> ArmFit:
    """Return the most probable errors of some `parts`: joint_offset, ratio_error, links, point."""
    first = log.rows(slice(len(log.joints) // 2))
    open_ = np.array([path.partition(".")[0] in parts for path in PATHS])
    spread = np.concatenate([np.full(6, 1e3), np.full(3, POINT_M), SPREAD])
    free = np.flatnonzero(np.concatenate([np.ones(6, bool), np.full(3, "point" in parts), open_]))
    readings = len(np.unique(first.trajectory)) / len(first.joints)
    x = np.zeros(len(spread))
    with jax.enable_x64(True):
        for _ in range(ITERATIONS):
            slope = np.asarray(_slope(x, first.joints, first.rotation))[..., free]
            left = first.camera - np.asarray(_predicted(x, first.joints, first.rotation))
            weight = tip_error.huber(np.linalg.norm(left, axis=1)) * readings / NOISE_M**2
            prior = np.diag(spread[free] ** -2.0)
            normal = np.einsum("nak,n,nal->kl", slope, weight, slope) + prior
            pull = np.einsum("nak,n,na->k", slope, weight, left) - x[free] / spread[free] ** 2
            x[free] += np.linalg.solve(normal, pull)
        left = log.camera - np.asarray(_predicted(x, log.joints, log.rotation))
    own = [errors[0] for errors in tip_error.predicted(log, x[None, 9:])]
    return ArmFit(x[9:], halves(np.linalg.norm(left, axis=1)), own)


def _tips(x: jax.Array, joints: jax.Array, rotation: jax.Array) -> jax.Array:
    """Return [n, 3] seen points (m) for rigid motion x[:6], point x[6:9], errors x[9:]."""
    points = tip_error.true_tips(x[9:], joints) + rotation @ x[6:9]
    turn = jnp.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])
    return points @ jax.scipy.linalg.expm(turn).T + x[3:6]


_predicted = jax.jit(_tips)
_slope = jax.jit(jax.jacfwd(_tips))
