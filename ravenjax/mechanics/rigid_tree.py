"""Reads a tree of hinge and slide joints from a compiled MuJoCo model.

The result is written for `rigid_program`, which computes the tree's dynamics. Any subtree of any
model can be read. Three choices reduce the number of operations and leave the dynamics unchanged:

- Each moving link gets its own frame. The z axis is the joint axis. The x axis is the common normal
  to the joint axis of the link's first child. The origin is on the joint axis, at the foot of the
  common normal to the parent's joint axis (of a slide: at the parent's origin). The rotation to the
  parent is Rz(beta) Rx(alpha) Rz(angle), often with beta = 0 (Khalil, Kleinfinger, ICRA 1986).
- Bodies that are fixed to a link become part of the link.
- Inertia that has no effect on the joint's own motion is moved to the parent. For a hinge about z
  this is the mass, the first moment along z and the second moment along z. For a slide it is all
  second moments (minimal inertial parameters, W. Khalil, F. Bennis 1989).
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import dataclasses
import functools
import math

import mujoco
import numpy as np

_PARALLEL = 1e-9  # sine of the angle below which two axes count as parallel
# relative size below which a number is the rounding of an exact zero
_SNAP = 1e-13


@dataclasses.dataclass(frozen=True)
class Link:
    """One joint and the bodies that move rigidly with it. Units: m, kg, rad."""

    joint: str
    number: int  # of the joint in the model
    parent: int  # index of the parent link; -1: the fixed base
    slide: bool
    beta: float  # constant rotation to the parent: Rz(beta) Rx(alpha) Rz(offset + q) for a hinge,
    alpha: float  # Rz(beta) Rx(alpha) Rz(offset) for a slide
    offset: float
    reference: float  # qpos0: a slide has moved by q - reference along z
    position: tuple[float, float, float]  # m, origin in the parent frame (slide: at q = reference)
    pseudo_inertia: np.ndarray  # [[integral of r r^T dm, m c], [m c^T, m]] in this frame, regrouped
    armature: float  # added to the diagonal of the mass matrix; kg m^2 or kg


def read_tree(model: mujoco.MjModel, base: str) -> tuple[Link, ...]:
    """Return the joints below body `base`, in the order of the model's degrees of freedom. Body
    `base` is fixed. Joint positions are as in the model. All joints are hinges or slides.
    """
    joints = _home_joints(model, model.body(base).id)
    _choose_frames(joints)
    return _make_links(joints)


@dataclasses.dataclass
class _HomeJoint:
    """A joint at q = qpos0 in the coordinates of the base."""

    name: str
    number: int
    parent: int
    slide: bool
    axis: np.ndarray
    anchor: np.ndarray
    pseudo_inertia: np.ndarray
    reference: float
    armature: float
    # Axis x and origin of the link's frame, which `_choose_frames` chooses.
    x: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    origin: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))

    @property
    def rotation(self) -> np.ndarray:
        return np.column_stack([self.x, np.cross(self.axis, self.x), self.axis])


def _home_joints(model: mujoco.MjModel, base: int) -> list[_HomeJoint]:
    # Returns the joints below a body at home (qpos0), in the body's frame. Bodies without a joint
    # are added to the link that carries them.
    joints: list[_HomeJoint] = []
    # Position and rotation of each body, and the index of the link that carries it.
    poses = {base: (np.zeros(3), np.eye(3))}
    carrier = {base: -1}
    for body in range(base + 1, model.nbody):
        parent = int(model.body_parentid[body])
        # The body is not below the base.
        if parent not in poses:
            continue
        position, rotation = poses[parent]
        position = position + _product(rotation, model.body_pos[body])
        rotation = _product(rotation, rotation_matrix(model.body_quat[body]))
        poses[body] = position, rotation
        carrier[body] = carrier[parent]
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            joints.append(
                _HomeJoint(
                    name=model.joint(joint).name,
                    number=joint,
                    parent=carrier[body],
                    slide=int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_SLIDE,
                    axis=_product(rotation, model.jnt_axis[joint]),
                    anchor=position + _product(rotation, model.jnt_pos[joint]),
                    pseudo_inertia=np.zeros((4, 4)),
                    reference=float(model.qpos0[model.jnt_qposadr[joint]]),
                    armature=float(model.dof_armature[model.jnt_dofadr[joint]]),
                )
            )
            carrier[body] = len(joints) - 1
        if carrier[body] >= 0:
            inertial = _product(rotation, rotation_matrix(model.body_iquat[body]))
            joints[carrier[body]].pseudo_inertia += pseudo_inertia(
                float(model.body_mass[body]),
                position + _product(rotation, model.body_ipos[body]),
                _product(inertial, np.diag(model.body_inertia[body]), inertial.T),
            )
    return joints


def pseudo_inertia(mass: float, com: np.ndarray, central: np.ndarray) -> np.ndarray:
    """Return a pseudo-inertia [4, 4] of mass (kg), centre (m) and central inertia (kg m^2)."""
    moments = 0.5 * np.trace(central) * np.eye(3) - central + mass * np.outer(com, com)
    first = mass * np.asarray(com)[:, None]
    return np.block([[moments, first], [first.T, np.array([[mass]])]])


def _choose_frames(joints: list[_HomeJoint]):
    """Set the x axis and the origin of each link's frame, as the module's docstring describes."""
    for index, joint in enumerate(joints):
        parent = joints[joint.parent] if joint.parent >= 0 else None
        child = next((other for other in joints if other.parent == index), None)
        if parent is not None and joint.slide:
            joint.origin = parent.origin
        elif parent is not None:
            joint.origin = _foot(joint, parent.origin, parent.axis)
        elif child is not None and not child.slide:
            joint.origin = _foot(joint, child.anchor, child.axis)
        else:
            joint.origin = joint.anchor
        x_axis = None if joint.slide else _leaf_direction(joint)
        if child is not None and not joint.slide:
            x_axis = _normal(joint, child.anchor, child.axis)
        # A slide, or a hinge on the same line as its child: the normal to the parent's axis, or the
        # parent's x axis if both axes are parallel.
        if x_axis is None and parent is not None:
            x_axis = _unit(np.cross(parent.axis, joint.axis))
            x_axis = parent.x if x_axis is None else x_axis
        joint.x = _leaf_direction(joint) if x_axis is None else x_axis


def _foot(joint: _HomeJoint, point: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the point of the joint's axis nearest to the line through `point` along `axis`. If the
    axes are parallel, it is the point nearest to `point`.
    """
    offset = point - joint.anchor
    # Both axes are unit vectors. 1 - cosine^2 is the squared sine of the angle between them.
    cosine = float(_product(joint.axis, axis))
    if 1.0 - cosine**2 < _PARALLEL**2:
        return joint.anchor + joint.axis * _product(joint.axis, offset)
    along = _product(joint.axis - cosine * axis, offset) / (1.0 - cosine**2)
    return joint.anchor + joint.axis * along


def _normal(joint: _HomeJoint, point: np.ndarray, axis: np.ndarray) -> np.ndarray | None:
    """Return the unit vector that is normal to the joint's axis and to the line through `point`
    along `axis`. None: both are the same line.
    """
    normal = _unit(np.cross(joint.axis, axis))
    # Parallel lines have many normals. One of them points from the origin to the other line.
    return _unit(_perpendicular(joint, point - joint.origin)) if normal is None else normal


def _perpendicular(joint: _HomeJoint, vector: np.ndarray) -> np.ndarray:
    # Returns the part of the vector that is perpendicular to the joint's axis.
    return vector - joint.axis * _product(joint.axis, vector)


def _unit(vector: np.ndarray, min_length: float = _PARALLEL) -> np.ndarray | None:
    """Return the vector with length 1, or None if it is not longer than `min_length`."""
    length = math.hypot(*vector)
    return vector / length if length > min_length else None


def _leaf_direction(joint: _HomeJoint) -> np.ndarray:
    """Return the x axis of a link without children: towards its centre of mass, or else the axis of
    the base that is most perpendicular to the joint's axis.
    """
    # The mass times the position of its centre, and the mass.
    first_moment, mass = joint.pseudo_inertia[:3, 3], joint.pseudo_inertia[3, 3]
    base_axes = np.eye(3)[np.argsort(np.abs(joint.axis))]
    for candidate in (first_moment - mass * joint.origin, *base_axes):
        # A mass of 0, or a centre of mass within 1 um of the axis, gives no direction.
        direction = _unit(_perpendicular(joint, candidate), 1e-6 * max(mass, 1e-300))
        if direction is not None:
            return direction
    return joint.x


def _make_links(joints: list[_HomeJoint]) -> tuple[Link, ...]:
    # Returns the links in their frames. Inertia without effect on a joint's own motion is moved to
    # the parent, as the module's docstring describes.
    inertias = []
    for joint in joints:
        to_link = joint.rotation.T
        position = -_product(to_link, joint.origin)
        inertias.append(_transform_inertia(to_link, position, joint.pseudo_inertia))
    links: list[Link] = []
    for index in reversed(range(len(joints))):
        joint, inertia = joints[index], inertias[index]
        parent_rotation, parent_origin = np.eye(3), np.zeros(3)
        if joint.parent >= 0:
            parent = joints[joint.parent]
            parent_rotation, parent_origin = parent.rotation, parent.origin
        rotation = _product(parent_rotation.T, joint.rotation)
        position = _product(parent_rotation.T, joint.origin - parent_origin)
        moved = np.zeros((4, 4))
        if joint.slide:
            moved[:3, :3] = inertia[:3, :3]
        else:
            moved[2:, 2:] = inertia[2:, 2:]
        if joint.parent >= 0:
            inertias[joint.parent] += _transform_inertia(rotation, position, moved)
        kept = inertia - moved
        kept = np.where(np.abs(kept) < _SNAP * np.abs(inertia).max(), 0.0, kept)
        beta, alpha, offset = _zxz(rotation)
        links.append(
            Link(
                joint=joint.name,
                number=joint.number,
                parent=joint.parent,
                slide=joint.slide,
                beta=beta,
                alpha=alpha,
                offset=offset if joint.slide else _round_right_angle(offset - joint.reference),
                reference=joint.reference,
                position=tuple(float(x) if abs(x) > _SNAP else 0.0 for x in position),  # type: ignore[arg-type]
                pseudo_inertia=kept,
                armature=joint.armature,
            )
        )
    return tuple(reversed(links))


def _transform_inertia(
    rotation: np.ndarray, position: np.ndarray, inertia: np.ndarray
) -> np.ndarray:
    # Returns a pseudo-inertia in the frame in which a point p has the coordinates rotation p +
    # position.
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, position
    return _product(transform, inertia, transform.T)


def _product(*factors: np.ndarray) -> np.ndarray:
    """Return the matrix product of the factors, with the same bits on every host."""
    # NumPy's product of floats is BLAS, which sums in an order that depends on the CPU.
    objects = (np.asarray(factor, object) for factor in factors)
    return np.asarray(functools.reduce(np.matmul, objects), float)


def _zxz(rotation: np.ndarray) -> tuple[float, float, float]:
    """Return the angles of rotation = Rz(beta) Rx(alpha) Rz(gamma), rad. Right angles are exact."""
    sine = math.hypot(rotation[0, 2], rotation[1, 2])
    alpha = math.atan2(sine, rotation[2, 2])
    # Here alpha is 0 or pi, so beta and gamma are about parallel axes. One of them is enough.
    if sine <= _PARALLEL:
        gamma = math.atan2(rotation[1, 0] * rotation[2, 2], rotation[0, 0])
        return 0.0, _round_right_angle(alpha), _round_right_angle(gamma)
    beta = math.atan2(rotation[0, 2], -rotation[1, 2])
    gamma = math.atan2(rotation[2, 0], rotation[2, 1])
    # beta is pi or -pi: Rz(pi) Rx(a) Rz(c) = Rx(-a) Rz(pi + c) needs one rotation less.
    if abs(abs(beta) - math.pi) < 1e-12:
        gamma = math.remainder(gamma + math.pi, 2 * math.pi)
        return 0.0, _round_right_angle(-alpha), _round_right_angle(gamma)
    return _round_right_angle(beta), _round_right_angle(alpha), _round_right_angle(gamma)


def _round_right_angle(angle: float) -> float:
    # Returns the nearest multiple of a right angle, if the angle differs from it by rounding only.
    right_angle = round(angle / (math.pi / 2)) * (math.pi / 2)
    return right_angle if abs(angle - right_angle) < 1e-12 else angle


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix [3, 3] of a quaternion w, x, y, z."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
