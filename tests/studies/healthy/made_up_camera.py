"""Logs of a camera that looks at an arm whose errors are known."""

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from ravenjax.robots.raven2.geometry import arrays
from studies.healthy_robot import tip_error
from studies.healthy_robot.camera_log import ARM, CameraLog

LOW, HIGH = (0.35, 1.1, 0.30, -0.7, 0.1, -0.3, -0.3), (1.1, 2.0, 0.38, 0.7, 0.6, 0.3, 0.3)
MOTIONS, ROWS = 40, 10


def log(values: np.ndarray, noise_m: float = 0.0, seed: int = 0) -> CameraLog:
    """Of an arm with kinematic errors [16] at `tip_error.PATHS`, by a camera that stands
    somewhere.
    """
    rng = np.random.default_rng(seed)
    joints = rng.uniform(LOW, HIGH, (MOTIONS * ROWS, 7))
    reported, rotation = arrays.forward_kinematics(joints, ARM)
    with jax.enable_x64(True):
        true = np.asarray(tip_error.true_tips(jax.numpy.asarray(values), jax.numpy.asarray(joints)))
    turn = Rotation.from_rotvec([0.05, -0.04, 0.07]).as_matrix()
    seen = true @ turn.T + (0.01, -0.005, 0.003) + noise_m * rng.normal(size=true.shape)
    return CameraLog(np.repeat(np.arange(MOTIONS), ROWS), joints, rotation, reported, seen)
