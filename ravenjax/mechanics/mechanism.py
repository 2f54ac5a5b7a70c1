"""A tree of joints from any MuJoCo model, and its time step, as `mj_step` with the integrator
implicitfast makes it.

    arm = read_mechanism(mujoco.MjModel.from_xml_path("arm.xml"), tip="wrist_site")
    qpos, qvel = step(arm, qpos, qvel, torque)

The step is implicit in damping and in the velocity gains of a controller or motor. Springs,
armature, friction loss and couplings of joints (equality constraints) are those of the model.
Friction loss and couplings are MuJoCo's soft constraints; their forces are found by `SWEEPS` sweeps
of projected Gauss-Seidel. Ranges of joints and actuators exert no force: a robot's code does.

Largest distance of any joint from `mj_step`, rad or m, with steps of 1 ms (models of
tests/mechanics/test_mechanism.py), and of a step that is not implicit in the velocity gain:

                                                       over 2 s    not implicit, over 0.2 s
    UR5e, kp 4500, kv 450, damping, armature           6e-17       unstable
    Allegro finger with springs, last joint coupled    7e-13       0.003
    SCARA with friction loss                           8e-6        0.004
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import dataclasses
import functools

import mujoco
import numpy as np

from ravenjax.errors import UserError
from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program, rigid_tree
from ravenjax.mechanics.rigid_tree import Link
from ravenjax.numbers.algebra import add, dot, matvec, minus, mul, plus, scale, solve_spd
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec

SWEEPS = 10
"""Sweeps over the constraints of a step."""


@dataclasses.dataclass(frozen=True)
class Softness:
    """How a constraint yields: MuJoCo's solref and solimp, and the inverse inertia it acts on."""

    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    invweight: float

    def wanted(self, position: Scalar, velocity: Scalar, timestep: float) -> tuple[Scalar, Scalar]:
        """Return the acceleration that the constraint asks for, and its regularisation R."""
        low, high, width, middle, power = self.solimp
        x = jnp.minimum(jnp.abs(position) / width, 1.0)
        exponent = round(power)
        rise = x**exponent / middle ** (exponent - 1)
        fall = 1.0 - (1.0 - x) ** exponent / (1.0 - middle) ** (exponent - 1)
        impedance = low + jnp.where(x <= middle, rise, fall) * (high - low)
        time, ratio = self.solref
        time = max(time, 2.0 * timestep)
        stiffness, damping = 1.0 / (high * time * ratio) ** 2, 2.0 / (high * time)
        acceleration = -(velocity * damping + position * stiffness * impedance)
        return acceleration, (1.0 / impedance - 1.0) * self.invweight


@dataclasses.dataclass(frozen=True)
class Coupling:
    """A joint that follows a polynomial of another joint, or of none."""

    joint: int
    leader: int | None
    polynomial: tuple[float, ...]  # coefficients from the constant on, rad or m
    softness: Softness


@dataclasses.dataclass(frozen=True, eq=False)
class Mechanism:
    """A fixed base with hinges and slides. Vectors have one number per joint, in SI units."""

    links: tuple[Link, ...]
    timestep: float  # s
    gravity: Vec  # m/s^2, in the frame of the base
    damping: Vec
    stiffness: Vec
    rest: Vec  # positions at which the springs are relaxed
    friction: Vec  # largest friction loss
    give: tuple[Softness, ...]  # of the friction loss
    couplings: tuple[Coupling, ...]
    tip: tuple[int, Vec]  # link that carries the tip (-1: the base), and where in its frame, m


def read_mechanism(model: mujoco.MjModel, base: str = "world", tip: str = "") -> Mechanism:
    """Return what moves on body `base`, which counts as fixed. tip: a site; "": the last link.

    Raises UserError that names what the step does not have: free and ball joints, tendons,
    contacts, equality constraints other than joint polynomials, drag and gravity compensation.
    """
    _require_known(model)
    links = rigid_tree.read_tree(model, base)
    joints = [model.joint(link.joint).id for link in links]
    place = {joint: k for k, joint in enumerate(joints)}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rotation, origin = data.body(base).xmat.reshape(3, 3), data.body(base).xpos
    point = Vec((0.0, 0.0, 0.0))
    if tip:
        body = int(model.site(tip).bodyid[0])
        while body and not model.body_jntnum[body]:
            body = int(model.body_parentid[body])
        carrier = place[int(model.body_jntadr[body] + model.body_jntnum[body] - 1)] if body else -1
        home = Vec(link.reference for link in links)
        world = Vec((rotation.T @ (data.site(tip).xpos - origin)).tolist())
        point = rigid_program.point_in_link(links, home, carrier, world)
    else:
        carrier = len(links) - 1

    def softness(solref: np.ndarray, solimp: np.ndarray, weight: float) -> Softness:
        return Softness(tuple(solref.tolist()), tuple(solimp.tolist()), float(weight))

    def coupling(k: int) -> Coupling:
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        both = [joint for joint in (first, second) if joint >= 0]
        zero = model.qpos0[[model.jnt_qposadr[joint] for joint in both]].tolist()
        # MuJoCo's polynomial is of the distance from qpos0, for both joints.
        shift = np.polynomial.Polynomial(model.eq_data[k, :5])
        if second >= 0:
            shift = shift(np.polynomial.Polynomial([-zero[1], 1.0]))
        coefficients = (shift + zero[0]).coef.tolist()
        weight = model.dof_invweight0[[model.jnt_dofadr[joint] for joint in both]].sum()
        soft = softness(model.eq_solref[k], model.eq_solimp[k], weight)
        return Coupling(place[first], place.get(second), tuple(coefficients), soft)

    dofs, weight = model.jnt_dofadr[joints], model.dof_invweight0
    return Mechanism(
        links,
        float(model.opt.timestep),
        Vec((rotation.T @ model.opt.gravity).tolist()),
        Vec(model.dof_damping[dofs].tolist()),
        Vec(model.jnt_stiffness[joints].tolist()),
        Vec(model.qpos_spring[model.jnt_qposadr[joints]].tolist()),
        Vec(model.dof_frictionloss[dofs].tolist()),
        tuple(softness(model.dof_solref[k], model.dof_solimp[k], weight[k]) for k in dofs),
        tuple(coupling(k) for k in range(model.neq) if model.eq_active0[k]),
        (carrier, point),
    )


def _require_known(model: mujoco.MjModel) -> None:
    hinges, slides = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    touching = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    solid = touching & (model.geom_contype | model.geom_conaffinity > 0)
    unknown = {
        "joint": ("free or ball joints", ~np.isin(model.jnt_type, (hinges, slides))),
        "tendon": ("tendons", np.ones(model.ntendon, bool)),
        "equality": (
            "equality constraints other than of joints",
            model.eq_type != mujoco.mjtEq.mjEQ_JOINT,
        ),
        "geom": ("geoms that may touch", solid),
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
        found.append("springs or dampers with polynomials")
    if (model.dof_solref < 0).any() or (model.eq_solref < 0).any():
        found.append("constraints with a negative solref")
    if found:
        raise UserError(
            f"the MJCF model has {'; '.join(found)}: expected a fixed base, hinges and slides, and"
            " couplings of joints. Remove the others; contacts end with"
            ' <option><flag contact="disable"/></option>'
        )


@functools.lru_cache(maxsize=64)
def _program(mechanism: Mechanism, known: tuple[float | None, ...]) -> Program:
    return rigid_program.mass_matrix_and_bias(mechanism.links, known)


def tip_position(mechanism: Mechanism, qpos: Vec) -> Vec:
    """Return the tip in the frame of the base, m."""
    carrier, point = mechanism.tip
    return rigid_program.carried_point(mechanism.links, qpos, carrier, point)


def step(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, torque: Vec, velocity_gain: Vec | None = None
) -> tuple[Vec, Vec]:
    """Return positions and velocities a time step later.

    torque: of motors or controller at this state, Nm or N. velocity_gain: by how much it falls for
    each rad/s or m/s, not negative; None: 0.
    """
    h, n = mechanism.timestep, len(qpos)
    inputs = (*qpos, *qvel, *mechanism.gravity)
    known = tuple(float(x) if type(x) in (int, float) else None for x in inputs)
    rows, bias = rigid_program.evaluate_program(_program(mechanism, known), inputs)
    for k, link in enumerate(mechanism.links):
        rows[k][k] = add(rows[k][k], link.armature)
    springs = mechanism.stiffness.map(mul, minus(qpos, mechanism.rest))
    force = minus(minus(minus(torque, Vec(bias)), springs), mechanism.damping.map(mul, qvel))
    mass = tuple(map(Vec, rows))
    force = plus(force, _constraint_force(mechanism, qpos, qvel, mass, force))
    slope = mechanism.damping if velocity_gain is None else plus(mechanism.damping, velocity_gain)
    for k in range(n):
        rows[k][k] = add(rows[k][k], mul(h, slope[k]))
    after = qvel + scale(h, solve_spd(tuple(map(Vec, rows)), force))
    return qpos + scale(h, after), after


def _constraint_force(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, mass: tuple[Vec, ...], force: Vec
) -> Vec:
    """Return the joint forces of friction loss and couplings."""
    n, h = len(qpos), mechanism.timestep
    unit = [Vec(float(i == k) for i in range(n)) for k in range(n)]
    ways: list[Vec] = []
    limits: list[float | None] = []
    wanted: list[tuple[Scalar, Scalar]] = []
    for k, most in enumerate(mechanism.friction):
        if most:
            ways.append(unit[k])
            limits.append(most)
            wanted.append(mechanism.give[k].wanted(0.0, qvel[k], h))
    for coupling in mechanism.couplings:
        way, followed, slope = unit[coupling.joint], coupling.polynomial[0], 0.0
        if coupling.leader is not None:
            followed = 0.0
            for coefficient in reversed(coupling.polynomial):
                slope = add(mul(slope, qpos[coupling.leader]), followed)
                followed = add(mul(followed, qpos[coupling.leader]), coefficient)
            way = way.replace(coupling.leader, -slope)
        ways.append(way)
        limits.append(None)
        position = qpos[coupling.joint] - followed
        wanted.append(coupling.softness.wanted(position, dot(way, qvel), h))
    if not ways:
        return Vec.full(n, 0.0)
    yielding = [solve_spd(mass, way) for way in ways]
    free = solve_spd(mass, force)
    lacking = [dot(way, free) - w for way, (w, _) in zip(ways, wanted, strict=True)]
    pushes: list[Scalar] = [0.0] * len(ways)
    response = Vec(Vec(dot(way, column) for column in yielding) for way in ways)
    for _ in range(SWEEPS if len(ways) > 1 else 1):
        for k, limit in enumerate(limits):
            soft = wanted[k][1]
            error = lacking[k] + dot(response[k], Vec(pushes)) + soft * pushes[k]
            push = pushes[k] - error / (response[k][k] + soft)
            if limit is not None:
                push = jnp.minimum(jnp.maximum(push, -limit), limit)
            pushes[k] = push
    return matvec(Vec(Vec(row) for row in zip(*ways, strict=True)), Vec(pushes))
