"""Simulates a tree of joints from any MuJoCo model with the time step of MuJoCo's integrator
implicitfast.

    arm = read_mechanism(mujoco.MjModel.from_xml_path("arm.xml"), "tip_site")
    qpos, qvel = step(arm, qpos, qvel, torque)

The step is implicit in damping and in the velocity gains of a controller or motor. Springs,
armature, friction loss and couplings of joints (equality constraints) are those of the model.
Friction loss and couplings are MuJoCo's soft constraints. Their forces are computed by `SWEEPS`
sweeps of projected Gauss-Seidel. Ranges of joints and actuators exert no force; the code of a robot
applies its limits.

The table gives the largest difference of any joint from MuJoCo's `mj_step`, in rad or m, with steps
of 1 ms. The last column is for a step that is not implicit in the velocity gain. The models are in
tests/mechanics/test_mechanism.py.

                                                       over 2 s    not implicit, over 0.2 s
    UR5e, kp 4500, kv 450, damping, armature           6e-17       unstable
    Allegro finger with springs, last joint coupled    7e-13       0.003
    SCARA with friction loss                           8e-6        0.004
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import dataclasses
import functools

import mujoco
import numpy as np

from ravenjax.errors import UserError
from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program, rigid_tree
from ravenjax.numbers import Scalar, Vec, jnp
from ravenjax.numbers.algebra import add, dot, matvec, minus, mul, plus, scale, solve_spd, transpose

SWEEPS = 10
"""Sweeps over the constraints of a step."""


@dataclasses.dataclass(frozen=True)
class Constraint:
    """The friction loss of a joint, or its coupling to a polynomial of another joint."""

    joint: int
    limit: float  # largest force, Nm or N; 0: a coupling, of any force
    leader: int  # the other joint; -1: none
    polynomial: tuple[float, ...]  # of its distance from qpos0, from the constant on
    solref: tuple[float, float]
    solimp: tuple[float, ...]
    invweight: float

    def wanted(self, position: Scalar, velocity: Scalar, timestep: float) -> tuple[Scalar, Scalar]:
        """Return the acceleration that the constraint asks for, and its regularisation."""
        low, high, width, middle, power = self.solimp
        x, exponent = jnp.minimum(jnp.abs(position) / width, 1.0), round(power)
        rise = x**exponent / middle ** (exponent - 1)
        fall = 1.0 - (1.0 - x) ** exponent / (1.0 - middle) ** (exponent - 1)
        impedance = low + jnp.where(x <= middle, rise, fall) * (high - low)
        time = high * max(self.solref[0], 2.0 * timestep)
        stiffness, damping = 1.0 / (time * self.solref[1]) ** 2, 2.0 / time
        acceleration = -(velocity * damping + position * stiffness * impedance)
        return acceleration, (1.0 / impedance - 1.0) * self.invweight


@dataclasses.dataclass(frozen=True, eq=False)
class Mechanism:
    """A fixed base with hinges and slides. Vectors have one number per joint, in SI units."""

    links: tuple[rigid_tree.Link, ...]
    timestep: float  # s
    gravity: Vec  # m/s^2, in the frame of the base
    damping: Vec
    stiffness: Vec
    rest: Vec  # positions at which the springs are relaxed
    constraints: tuple[Constraint, ...]
    carrier: int  # link that carries the tip; -1: the base
    tip: Vec  # in the frame of that link, m


def read_mechanism(model: mujoco.MjModel, tip: str) -> Mechanism:
    """Return what moves in a model, on its fixed world. tip: a site.

    Raises UserError that names what the step does not have: free and ball joints, tendons,
    contacts, equality constraints other than joint polynomials, drag and gravity compensation.
    """
    _require_known(model)
    links = rigid_tree.read_tree(model, "world")
    joints = [link.number for link in links]
    place = {joint: k for k, joint in enumerate(joints)} | {-1: -1}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = model.body_weldid[model.site(tip).bodyid[0]]
    carrier = place[int(model.body_jntadr[body] + model.body_jntnum[body] - 1)] if body else -1
    home = Vec(link.reference for link in links)
    point = Vec(data.site(tip).xpos.tolist())
    dofs, weight = model.jnt_dofadr, model.dof_invweight0
    losses = [
        Constraint(
            *(place[joint], float(model.dof_frictionloss[k]), -1, (0.0,)),
            *(tuple(model.dof_solref[k]), tuple(model.dof_solimp[k]), float(weight[k])),
        )
        for joint in joints
        if model.dof_frictionloss[k := dofs[joint]]
    ]
    couplings = []
    for k in np.flatnonzero(model.eq_active0):
        both = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        lightness = float(sum(weight[dofs[joint]] for joint in both if joint >= 0))
        soft = tuple(model.eq_solref[k]), tuple(model.eq_solimp[k]), lightness
        polynomial = tuple(model.eq_data[k, : 5 if both[1] >= 0 else 1].tolist())
        couplings.append(Constraint(place[both[0]], 0.0, place[both[1]], polynomial, *soft))
    return Mechanism(
        links,
        float(model.opt.timestep),
        Vec(model.opt.gravity.tolist()),
        Vec(model.dof_damping[dofs[joints]].tolist()),
        Vec(model.jnt_stiffness[joints].tolist()),
        Vec(model.qpos_spring[model.jnt_qposadr[joints]].tolist()),
        (*losses, *couplings),
        carrier,
        rigid_program.point_in_link(links, home, carrier, point),
    )


def _require_known(model: mujoco.MjModel) -> None:
    # A part of the model without equations here would be ignored silently, so it is refused.
    hinges, slides = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    touching = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    solid = touching & (model.geom_contype | model.geom_conaffinity > 0)
    unknown = {
        "joint": ("free or ball joints", ~np.isin(model.jnt_type, (hinges, slides))),
        "tendon": ("tendons", np.ones(model.ntendon, bool)),
        "equality": (
            "equality constraints that do not couple joints",
            model.eq_type != mujoco.mjtEq.mjEQ_JOINT,
        ),
        "geom": ("geoms with contacts", solid),
        "body": ("bodies with gravity compensation", model.body_gravcomp != 0.0),
    }
    found = []
    for kind, (what, which) in unknown.items():
        names = [getattr(model, kind)(int(i)).name or f"number {i}" for i in np.flatnonzero(which)]
        if names:
            found.append(f"{what} ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})")
    if model.opt.density or model.opt.viscosity:
        found.append("a medium with density or viscosity")
    if model.jnt_stiffnesspoly.any() or model.dof_dampingpoly.any():
        found.append("polynomial springs or dampers")
    if (model.dof_solref < 0).any() or (model.eq_solref < 0).any():
        found.append("constraints with a negative solref")
    if found:
        raise UserError(
            f"the MJCF model has {'; '.join(found)}: expected a fixed base, hinge and slide joints,"
            " and couplings of joints. Remove all else from the model. To disable contacts write"
            ' <option><flag contact="disable"/></option>'
        )


@functools.lru_cache(maxsize=64)
def _program(mechanism: Mechanism, known: tuple[float | None, ...]) -> Program:
    return rigid_program.mass_matrix_and_bias(mechanism.links, known)


def tip_position(mechanism: Mechanism, qpos: Vec) -> Vec:
    """Return the tip in the frame of the base, m."""
    links, carrier, tip = mechanism.links, mechanism.carrier, mechanism.tip
    return rigid_program.carried_point(links, qpos, carrier, tip)


def gravity_torque(mechanism: Mechanism, qpos: Vec) -> Vec:
    """Return the torques or forces that hold the joints at rest against gravity, Nm or N."""
    inputs = (*qpos, *qpos.map(lambda _: 0.0), *mechanism.gravity)
    program = functools.partial(_program, mechanism)
    return Vec(rigid_program.evaluate_program(program, inputs)[1])


def step(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, torque: Vec, velocity_gain: Vec | None = None
) -> tuple[Vec, Vec]:
    """Return positions and velocities a time step later.

    torque: of motors or controller at this state, Nm or N. velocity_gain: by how much it falls for
    each rad/s or m/s, not negative; None: 0.
    """
    h, program = mechanism.timestep, functools.partial(_program, mechanism)
    rows, bias = rigid_program.evaluate_program(program, (*qpos, *qvel, *mechanism.gravity))
    for k, link in enumerate(mechanism.links):
        rows[k][k] = add(rows[k][k], link.armature)
    springs = mechanism.stiffness.map(mul, minus(qpos, mechanism.rest))
    force = minus(minus(minus(torque, Vec(bias)), springs), mechanism.damping.map(mul, qvel))
    mass = tuple(map(Vec, rows))
    force = plus(force, _constraint_force(mechanism, qpos, qvel, mass, force))
    slope = mechanism.damping if velocity_gain is None else plus(mechanism.damping, velocity_gain)
    for k, rate in enumerate(slope):
        rows[k][k] = add(rows[k][k], mul(h, rate))
    after = qvel + scale(h, solve_spd(tuple(map(Vec, rows)), force))
    return qpos + scale(h, after), after


def _constraint_force(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, mass: tuple[Vec, ...], force: Vec
) -> Vec:
    """Return the joint forces of friction loss and couplings."""
    rows: list[tuple[Vec, Scalar, Scalar]] = []
    for c in mechanism.constraints:
        way, position = Vec(float(k == c.joint) for k in range(len(qpos))), 0.0
        if not c.limit:
            followed = slope = 0.0
            for coefficient in reversed(c.polynomial):
                apart = qpos[c.leader] - mechanism.links[c.leader].reference
                slope = add(mul(slope, apart), followed)
                followed = add(mul(followed, apart), coefficient)
            way = way.replace(c.leader, -slope) if c.leader >= 0 else way
            position = qpos[c.joint] - mechanism.links[c.joint].reference - followed
        rows.append((way, *c.wanted(position, dot(way, qvel), mechanism.timestep)))
    if not rows:
        return qpos.map(lambda _: 0.0)
    ways = Vec(way for way, _, _ in rows)
    free = matvec(ways, solve_spd(mass, force))
    yielding = [solve_spd(mass, way) for way in ways]
    pushes: list[Scalar] = [0.0] * len(rows)
    for _ in range(SWEEPS if len(rows) > 1 else 1):
        for k, (way, wanted, soft) in enumerate(rows):
            response = [dot(way, column) for column in yielding]
            lacking = free[k] - wanted + dot(Vec(response), Vec(pushes)) + soft * pushes[k]
            push = pushes[k] - lacking / (response[k] + soft)
            if limit := mechanism.constraints[k].limit:
                push = jnp.minimum(jnp.maximum(push, -limit), limit)
            pushes[k] = push
    return matvec(transpose(ways), Vec(pushes))
