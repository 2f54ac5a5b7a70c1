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

import contextlib
import copy
import dataclasses
import functools
import io
from typing import Any

import mujoco
import numpy as np

from ravenjax.errors import UserError
from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program, rigid_tree
from ravenjax.numbers import Scalar, Vec
from ravenjax.numbers.algebra import add, dot, matvec, minus, mul, plus, scale, solve_spd, transpose
from ravenjax.numbers.lazy import jax, jnp

SWEEPS = 10
"""Sweeps over the constraints of a step."""


@dataclasses.dataclass(frozen=True)
class Constraint:
    """The friction loss of a joint, or its coupling to a polynomial of another joint."""

    joint: int
    limit: float  # largest friction force, Nm or N; 0: a coupling, without a limit
    leader: int  # joint that `joint` is coupled to; -1: none
    # coefficients, constant first: position of `joint` over that of the leader, both from qpos0
    polynomial: tuple[float, ...]
    solref: tuple[float, float]
    solimp: tuple[float, ...]
    invweight: float

    def wanted(self, position: Scalar, velocity: Scalar, timestep: float) -> tuple[Scalar, Scalar]:
        """Return the acceleration that the constraint aims at, and its regularisation.

        position, velocity: deviation from the constraint. The formulas are those of MuJoCo's solver
        parameters solref and solimp.
        """
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
    # The model without actuators and ranges of joints, for `step_by_mjx`.
    model: mujoco.MjModel


def read_mechanism(model: mujoco.MjModel, tip: str) -> Mechanism:
    """Return the moving parts of a model whose base is fixed. tip: name of a site.

    Raises UserError if the model has features that are not supported: free and ball joints,
    tendons, contacts, equality constraints other than joint polynomials, drag and gravity
    compensation.
    """
    _require_known(model)
    links = rigid_tree.read_tree(model, "world")
    joints = [link.number for link in links]
    index_of = {joint: k for k, joint in enumerate(joints)} | {-1: -1}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = model.body_weldid[model.site(tip).bodyid[0]]
    carrier = index_of[int(model.body_jntadr[body] + model.body_jntnum[body] - 1)] if body else -1
    home_positions = Vec(link.reference for link in links)
    tip_at_home = Vec(data.site(tip).xpos.tolist())
    dofs, weight = model.jnt_dofadr, model.dof_invweight0
    losses = [
        Constraint(
            *(index_of[joint], float(model.dof_frictionloss[k]), -1, (0.0,)),
            *(tuple(model.dof_solref[k]), tuple(model.dof_solimp[k]), float(weight[k])),
        )
        for joint in joints
        if model.dof_frictionloss[k := dofs[joint]]
    ]
    couplings = []
    for k in np.flatnonzero(model.eq_active0):
        pair = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        weight_sum = float(sum(weight[dofs[joint]] for joint in pair if joint >= 0))
        soft = tuple(model.eq_solref[k]), tuple(model.eq_solimp[k]), weight_sum
        polynomial = tuple(model.eq_data[k, : 5 if pair[1] >= 0 else 1].tolist())
        couplings.append(Constraint(index_of[pair[0]], 0.0, index_of[pair[1]], polynomial, *soft))
    bare = copy.copy(model)
    bare.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    bare.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    bare.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    return Mechanism(
        links,
        float(model.opt.timestep),
        Vec(model.opt.gravity.tolist()),
        Vec(model.dof_damping[dofs[joints]].tolist()),
        Vec(model.jnt_stiffness[joints].tolist()),
        Vec(model.qpos_spring[model.jnt_qposadr[joints]].tolist()),
        (*losses, *couplings),
        carrier,
        rigid_program.point_in_link(links, home_positions, carrier, tip_at_home),
        bare,
    )


def _require_known(model: mujoco.MjModel) -> None:
    # Refuses models with features that this module would ignore.
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

    torque: torques of motors or controller at this state, Nm or N. velocity_gain: decrease of the
    torque for each rad/s or m/s, not negative; None: 0.
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


def step_by_mjx(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, torque: Vec, velocity_gain: Vec
) -> tuple[Vec, Vec]:
    """Return what `step` returns, by a step of MuJoCo MJX, which solves the constraints, too."""
    applied = plus(torque, velocity_gain.map(mul, qvel))
    damping = jnp.array(plus(mechanism.damping, velocity_gain))
    option = {"timestep": mechanism.timestep}
    places, speeds = advance_by_mjx(
        mechanism.model, qpos, qvel, applied, option, dof_damping=damping
    )
    dtype = jnp.result_type(*qpos)
    return Vec(places.astype(dtype)), Vec(speeds.astype(dtype))


def advance_by_mjx(
    model: mujoco.MjModel, qpos: Vec, qvel: Vec, applied: Any, option: Any, **numbers: Any
) -> tuple[Any, Any]:
    """Return positions and velocities after one `mjx.step`, arrays of at least these types.

    applied: `qfrc_applied`, Nm or N. option, numbers: fields of `model.opt` and of the model that
    this step replaces. A model whose integrator is implicit takes damping at the end of the step.
    """
    dtype = jnp.result_type(*qpos)
    real = functools.partial(jnp.array, dtype=dtype)
    mjx, mjx_model, data = _put_model(model, str(dtype))
    # By default, GPUs multiply matrices with 10 bits of mantissa.
    with jax.default_matmul_precision("highest"):
        # MuJoCo Warp takes arrays only.
        options = {name: real(value) for name, value in option.items()}
        mjx_model = mjx_model.replace(opt=mjx_model.opt.replace(**options), **numbers)
        data = data.replace(qpos=real(qpos), qvel=real(qvel), qfrc_applied=real(applied))
        data = mjx.step(mjx_model, data)
    return data.qpos, data.qvel


@functools.lru_cache(maxsize=64)
def _put_model(model: mujoco.MjModel, dtype: str) -> tuple[Any, Any, Any]:
    """Return `mjx`, and the model and its data for JAX, of `dtype`."""
    # The import takes half a second and prints a line for each optional backend that is missing.
    with contextlib.redirect_stdout(io.StringIO()):
        from mujoco import mjx
    with jax.ensure_compile_time_eval():
        return mjx, mjx.put_model(model), mjx.make_data(model)


def _constraint_force(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, mass: tuple[Vec, ...], force: Vec
) -> Vec:
    """Return the joint forces of friction loss and couplings."""
    rows: list[tuple[Vec, Scalar, Scalar]] = []
    for c in mechanism.constraints:
        direction, position = Vec(float(k == c.joint) for k in range(len(qpos))), 0.0
        if not c.limit:
            target = slope = 0.0
            for coefficient in reversed(c.polynomial):
                offset = qpos[c.leader] - mechanism.links[c.leader].reference
                slope = add(mul(slope, offset), target)
                target = add(mul(target, offset), coefficient)
            direction = direction.replace(c.leader, -slope) if c.leader >= 0 else direction
            position = qpos[c.joint] - mechanism.links[c.joint].reference - target
        rows.append((direction, *c.wanted(position, dot(direction, qvel), mechanism.timestep)))
    if not rows:
        return qpos.map(lambda _: 0.0)
    directions = Vec(direction for direction, _, _ in rows)
    free_acceleration = matvec(directions, solve_spd(mass, force))
    responses = [solve_spd(mass, direction) for direction in directions]
    magnitudes: list[Scalar] = [0.0] * len(rows)
    for _ in range(SWEEPS if len(rows) > 1 else 1):
        for k, (direction, acceleration, soft) in enumerate(rows):
            response = [dot(direction, column) for column in responses]
            residual = (
                free_acceleration[k]
                - acceleration
                + dot(Vec(response), Vec(magnitudes))
                + soft * magnitudes[k]
            )
            magnitude = magnitudes[k] - residual / (response[k] + soft)
            if limit := mechanism.constraints[k].limit:
                magnitude = jnp.minimum(jnp.maximum(magnitude, -limit), limit)
            magnitudes[k] = magnitude
    return matvec(transpose(directions), Vec(magnitudes))
