"""Models an arm that differs from the drawings, so that its reported tip is wrong.

- The **true** arm has the links as they were built, with their true lengths and twists, at joint
  angles that nobody measures.
- The **reported** arm is what the software computes: joints from encoder counts by the drawings'
  ratios and by the zero that homing found, and a tip from these joints by the drawings' links.
  Controller, checks, report and cue use this arm only.
- The **nominal model** starts at the reported pose and has the drawings' links, so kinematic errors
  cause no distance between this model and the reported tip.

An error that is 0 adds no operations to the tick. The true joints q follow from the reported joints
r and the home pose h. This formula is without the stretch of cables, which is added:

    q = h + (1 + ratio_error) (r - h) + joint_offset

A camera does not know the robot's frame 0, so a rigid displacement of the arm is not visible as an
error. `registered` removes this displacement by a rigid motion, constant in a run, that moves the
true tips at POSES onto the reported tips by least squares.
"""

import functools
import itertools
import math

import numpy as np

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, describe_fields, jnp, record, run_eagerly, tree, where
from ravenjax.numbers.algebra import add, dot, matmul, matrix, matvec, mul
from ravenjax.robots.raven2.geometry import built_links, kinematics, limits, mapping

_DEG = math.pi / 180.0


@describe_fields
@record
class KinematicErrors:
    """Kinematic errors of one arm. Without errors, all but `scale` are 0."""

    scale: Scalar
    joint_offset: Vec  # rad; m
    ratio_error: Vec
    links: built_links.LinkErrors
    registered: Scalar  # int32


@record
class Registration:
    """A rigid motion from frame 0 of the true arm to frame 0 of the reported arm."""

    rotation: Vec  # 3 rows
    translation: Vec  # m, 3


MEASURED: dict[str, float] = resources.read_tables(__file__, "kinematic_errors.toml")
"""Standard deviation of each error if a campaign draws them (normal, mean 0); rad, m and shares.

Their relative sizes are *assumed*: homing against stops leaves larger errors than machining. Their
common factor is fitted to the first half of a recording,
`analysis/studies/healthy_robot/tip_error.py`. A recording of one arm in a part of its workspace
cannot separate the errors; it shows the tip's error after registration. The shoulder has no offset,
because it would only turn the frame. The jaws have none, because they do not move their axis.
"""


def no_errors() -> KinematicErrors:
    """Return zero errors of joints, ratios and links, with scale 1 and without registration."""
    zeros, link_errors = Vec.full(7, 0.0), built_links.LinkErrors(*Vec.full(7, 0.0))
    return KinematicErrors(1.0, zeros, zeros, link_errors, registered=np.int32(0))


def is_exact(errors: KinematicErrors) -> bool:
    """Return whether all errors are 0 in all runs, so that the tick need not compute them."""
    numbers = tree.tree_leaves((errors.joint_offset, errors.ratio_error, errors.links))
    # Only a number that is the same in all runs is a Python number.
    return all(type(number) in (int, float) and number == 0 for number in numbers)


def true_joints(errors: KinematicErrors, reported: Vec) -> Vec:
    """Return the true joints (7) at reported ones (rad, m), with unstretched cables."""

    def true_joint(joint: Scalar, home: float, offset: Scalar, error: Scalar) -> Scalar:
        # joint + error (joint - home) + offset, with both errors multiplied by `scale`
        scaled = mul(mul(errors.scale, error), joint - home)
        return add(joint, add(scaled, mul(errors.scale, offset)))

    return reported.map(true_joint, limits.HOME_JPOS, errors.joint_offset, errors.ratio_error)


def register_frame(arm: str, errors: KinematicErrors) -> Registration | None:
    """Return the registration of the arm's frame 0; None if there are no errors, or if no run is to
    be registered. A run that is not to be registered gets the identity.
    """
    # A NumPy integer is the same in all runs. Other types stand for a number of each run.
    never_registered = isinstance(errors.registered, np.integer) and not errors.registered
    if is_exact(errors) or never_registered:
        return None
    true_tips = [_tip(arm, true_joints(errors, pose), errors) for pose in POSES]
    return where(errors.registered != 0, fit_registration(arm, true_tips), _no_motion())


def true_tip(arm: str, errors: KinematicErrors, frame: Registration | None, jpos: Vec) -> Vec:
    """Return the true tip (3, m) with the links at the true joints `jpos` (7, rad and m)."""
    position = _tip(arm, jpos, errors)
    return position if frame is None else in_registered_frame(frame, position)


def _tip(arm: str, jpos: Vec, errors: KinematicErrors) -> Vec:
    if is_exact(errors):
        return kinematics.forward_pose(arm, jpos).position
    links = tree.map_leaves(lambda error: mul(errors.scale, error), errors.links)
    return built_links.jaw_axis_position(arm, jpos, links)


STEPS = 4
"""Gauss-Newton steps. With 20 degrees of rotation, the fourth changes no bit of a float32."""

_RANGES = (
    (20 * _DEG, 50 * _DEG),
    (70 * _DEG, 110 * _DEG),
    (0.32, 0.40),
    (-45 * _DEG, 45 * _DEG),
    (0.0, 40 * _DEG),
    # The jaws keep one angle.
    (45 * _DEG, 45 * _DEG),
    (45 * _DEG, 45 * _DEG),
)
"""Ranges of joints, rad and m: the workspace of recording `camera_poses_left_arm`."""
POSES = tuple(
    Vec(ends[i] for ends, i in zip(_RANGES, (a, b, c, a ^ b, b ^ c, 0, 0), strict=True))
    for a, b, c in itertools.product((0, 1), repeat=3)
)
"""Eight of the 32 corners of the ranges. Any two joints have all four combinations of ends."""


def in_registered_frame(frame: Registration, point: Vec) -> Vec:
    """Return a point (3, m) of the true arm's frame 0 in the registered frame."""
    return matvec(frame.rotation, point) + frame.translation


def fit_registration(arm: str, true_tips: list[Vec]) -> Registration:
    """Return the rigid motion that moves true tips (m) at POSES onto the reported tips."""
    reported_tips, fit_matrix = _linear_fit(arm)
    frame = _no_motion()
    for _ in range(STEPS):
        residuals = []
        for true, reported in zip(true_tips, reported_tips, strict=True):
            residuals.extend(Vec(reported) - in_registered_frame(frame, true))
        # The Gauss-Newton step: a small rotation (rad) and a translation (m)
        correction = Vec(dot(Vec(row), Vec(residuals)) for row in fit_matrix)
        # Half the rotation vector and 1 are the quaternion of a small rotation.
        rotation = mapping.matrix_from_quat(Vec((*(Vec(correction[:3]) * 0.5), 1.0)))
        translation = matvec(rotation, frame.translation) + correction[3:]
        frame = Registration(matmul(rotation, frame.rotation), translation)
    return frame


def _no_motion() -> Registration:
    zero, one = jnp.float32(0.0), jnp.float32(1.0)
    rows = matrix((one, zero, zero), (zero, one, zero), (zero, zero, one))
    return Registration(rows, Vec((zero,) * 3))


@functools.cache
def _linear_fit(arm: str) -> tuple[list[list[float]], list[list[float]]]:
    """Return the reported tips (m) at POSES, and the matrix [6, 3 * poses] that turns residuals of
    tips into the rotation (rad) and translation (m) of the least-squares fit.
    """
    # JAX may be tracing the tick when it calls this function, but the tips must be plain numbers.
    with run_eagerly():
        tips = np.array([kinematics.forward_pose(arm, pose).position for pose in POSES])
    design = np.zeros((len(tips), 3, 6))
    for rows, (x, y, z) in zip(design, tips, strict=True):
        # The cross product of a small rotation and the tip is the tip's displacement.
        rows[:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        rows[:, 3:] = np.eye(3)
    # The matrix is rounded, because LAPACK's last digits depend on the CPU.
    return tips.tolist(), np.linalg.pinv(design.reshape(-1, 6)).round(12).tolist()
