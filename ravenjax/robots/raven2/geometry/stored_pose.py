"""A pose as the control software stores it (raven2 `include/DS0.h`).

The position is three int in um, the rotation float R[3][3], and the jaw opening an int in mrad.
"""

from ravenjax.numbers import Scalar, Vec, narrow_numbers, record, to_int32, widen_numbers
from ravenjax.robots.raven2.geometry.kinematics import Pose
from ravenjax.robots.raven2.setup import RavenSetup

UM_PER_M = 1e6


@record
class StoredPose:
    """Pose of one instrument tip in frame 0 of its arm."""

    position_um: Vec  # 3 int32
    rotation: Vec  # 3 row Vecs
    grasp_mrad: Scalar  # int32, jaw opening, positive open


def store_pose(setup: RavenSetup, pose: Pose, grasp_mrad: Scalar) -> StoredPose:
    """Return a pose (m) as it is stored: position truncated toward zero, rotation rounded."""
    position = Vec(to_int32(p * UM_PER_M) for p in pose.position)
    return StoredPose(position, narrow_numbers(setup, pose.rotation), grasp_mrad)


def load_pose(setup: RavenSetup, stored: StoredPose) -> Pose:
    """Return a stored pose in metres, in the wide type in which kinematics is evaluated."""
    position = widen_numbers(setup, stored.position_um) / UM_PER_M
    return Pose(position, widen_numbers(setup, stored.rotation))
