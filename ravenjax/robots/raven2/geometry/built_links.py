"""Tip of an arm whose links differ from the drawings: a Denavit-Hartenberg table with errors.

`kinematics.forward_pose` uses the table of the control software, in which shoulder, elbow and
insertion axes meet in one point. In this module, every link may have its own twist and length.
`joints` explains the convention.
"""

from ravenjax.numbers import Scalar, Vec, describe_fields, jnp, record, trigonometry
from ravenjax.numbers.algebra import add, mul, sub
from ravenjax.robots.raven2.geometry.joints import D4, GEOMETRY, LINK12, LINK23, LW, PI


@describe_fields
@record
class LinkErrors:
    """True twists and lengths of the links minus those of the software's table; 0: as drawn."""

    twist12: Scalar  # rad
    twist23: Scalar  # rad
    length12: Scalar  # m
    length23: Scalar  # m
    length34: Scalar  # m
    tool_length: Scalar  # m
    wrist_length: Scalar  # m


def jaw_axis_position(arm: str, jpos: Vec, errors: LinkErrors) -> Vec:
    """Return the position (3, m, frame 0) of the jaw axis of an arm with link errors. The jaw axis
    is known in frame 4 and converted from frame to frame. jpos: joints, rad and m. `add`, `sub` and
    `mul` omit operations with an error that is the constant 0.
    """
    geometry = GEOMETRY[arm]
    # The green arm has the other twist of link 2, and frame 0 is rotated by 180 deg about x
    gold = geometry.flip > 0
    twist2 = sub(PI - LINK23, errors.twist23) if gold else add(LINK23, errors.twist23)
    sign2 = -1.0 if geometry.zero2 else 1.0  # cos(theta2) / cos(elbow), as theta2 = elbow + zero2
    angle1, angle4 = jpos[0] + geometry.zero1, jpos[3]
    s5, c5 = jnp.sin(jpos[4]), jnp.cos(jpos[4])  # theta5 = wrist - 90 deg
    reach = add(LW, errors.wrist_length)
    point = Vec((reach * s5, 0.0, -reach * c5))  # in frame 4; axis 5 is at 90 deg to axis 4
    depth = jpos[2] + sub(D4, errors.tool_length)
    point = _rotate_z(point, jnp.cos(angle4), jnp.sin(angle4))
    point = Vec((add(point[0], errors.length34), point[1], point[2] + depth))  # in frame 3
    # The rotation about z3 by theta3 = +-90 deg
    point = Vec((mul(-geometry.side, point[1]), mul(geometry.side, point[0]), point[2]))
    point = _to_previous_frame(point, errors.length23, twist2)
    point = _rotate_z(point, sign2 * jnp.cos(jpos[1]), sign2 * jnp.sin(jpos[1]))
    point = _to_previous_frame(point, errors.length12, add(LINK12, errors.twist12))
    x, y, z = _rotate_z(point, jnp.cos(angle1), jnp.sin(angle1))
    return Vec((x, y, z)) if gold else Vec((x, -y, -z))


def _rotate_z(point: Vec, cosine: Scalar, sine: Scalar) -> Vec:
    # Returns the point after a rotation about z, by an angle with this cosine and sine.
    x, y, z = point
    return Vec((sub(mul(cosine, x), mul(sine, y)), add(mul(sine, x), mul(cosine, y)), z))


def _to_previous_frame(point: Vec, length: Scalar, twist: Scalar) -> Vec:
    """Return a point in the previous frame: shifted along x, then rotated about x by `twist`."""
    # A twist without an error is a Python number
    functions = trigonometry if isinstance(twist, float) else jnp
    cosine, sine = functions.cos(twist), functions.sin(twist)
    x, y, z = point
    return Vec((add(x, length), cosine * y - sine * z, sine * y + cosine * z))
