"""Simulates a tree of joints from any MuJoCo model with the step of integrator implicitfast.

    arm = read_mechanism(mujoco.MjModel.from_xml_path("arm.xml"), "tip_site")
    qpos, qvel = step(arm, qpos, qvel, torque)

The step is implicit in damping and in the velocity gains of a controller or motor. Springs,
armature, friction loss and couplings of joints (equality constraints) are those of the model.
Friction loss and couplings are MuJoCo's soft constraints. Their forces are computed by `SWEEPS`
sweeps of projected Gauss-Seidel. Ranges of joints and actuators exert no force; a robot's code
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
import threading
from typing import Any

import mujoco
import numpy as np

from ravenjax.errors import UserError
from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program, rigid_tree
from ravenjax.numbers import Scalar, Vec, clamp
from ravenjax.numbers.algebra import add, dot, matvec, minus, mul, plus, scale, solve_spd, transpose
from ravenjax.numbers.lazy import jax, jnp

SWEEPS = 10
"""Sweeps over the constraints of a step."""
_MJX_IMPORT = threading.Lock()


@dataclasses.dataclass(frozen=True)
class Constraint:
    """The friction loss of a joint, or its coupling to a polynomial of another joint."""

    joint: int
    friction: float  # largest friction force, Nm or N; 0: a coupling
    leader: int  # joint that `joint` is coupled to; -1: none
    # coefficients, constant first: position of `joint` over that of the leader, both from qpos0
    polynomial: tuple[float, ...]
    solref: tuple[float, float]
    solimp: tuple[float, ...]
    invweight: float

    def reference(
        self, position: Scalar, velocity: Scalar, timestep: float
    ) -> tuple[Scalar, Scalar]:
        """Return the acceleration at which the constraint aims, and its regularisation, by the
        formulas of MuJoCo's solver parameters solref and solimp. position, velocity: deviation from
        the constraint, and its derivative. timestep: s.
        """
        # The impedance rises from `low` to `high` with the deviation x, in units of `width`: as a
        # power of x up to x = middle, then with a power of 1 - x.
        low, high, width, middle, power = self.solimp
        x, exponent = jnp.minimum(jnp.abs(position) / width, 1.0), round(power)
        rise = x**exponent / middle ** (exponent - 1)
        fall = 1.0 - (1.0 - x) ** exponent / (1.0 - middle) ** (exponent - 1)
        impedance = low + jnp.where(x <= middle, rise, fall) * (high - low)
        time_constant, damping_ratio = self.solref
        time = high * max(time_constant, 2.0 * timestep)
        stiffness, damping = 1.0 / (time * damping_ratio) ** 2, 2.0 / time
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
    carrier: int  # index of the link that carries the tip; -1: the base
    tip: Vec  # in the frame of that link, m
    # The model without actuators and ranges of joints, for `step_by_mjx`.
    model: mujoco.MjModel


def read_mechanism(model: mujoco.MjModel, tip: str) -> Mechanism:
    """Return the mechanism of a model whose base is fixed. tip: name of a site, the tip. Raise
    UserError if the model has features that are not supported: free and ball joints, tendons,
    contacts, drag, gravity compensation, and equality constraints that are not joint polynomials.
    """
    _require_supported(model)
    links = rigid_tree.read_tree(model, "world")
    joints = [link.number for link in links]
    index_of = {joint: k for k, joint in enumerate(joints)} | {-1: -1}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Index of the link that carries the tip, by the last joint of the tip's body; -1: the base.
    body = model.body_weldid[model.site(tip).bodyid[0]]
    carrier = index_of[int(model.body_jntadr[body] + model.body_jntnum[body] - 1)] if body else -1
    home_positions = Vec(link.reference for link in links)
    tip_at_home = Vec(data.site(tip).xpos.tolist())
    # For `step_by_mjx`. The code of a robot computes its actuators and applies its limits.
    passive_model = copy.copy(model)
    passive_model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    passive_model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    passive_model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    return Mechanism(
        links=links,
        timestep=float(model.opt.timestep),
        gravity=Vec(model.opt.gravity.tolist()),
        damping=Vec(model.dof_damping[model.jnt_dofadr[joints]].tolist()),
        stiffness=Vec(model.jnt_stiffness[joints].tolist()),
        rest=Vec(model.qpos_spring[model.jnt_qposadr[joints]].tolist()),
        constraints=_read_constraints(model, joints, index_of),
        carrier=carrier,
        tip=rigid_program.point_in_link(links, home_positions, carrier, tip_at_home),
        model=passive_model,
    )


def _read_constraints(
    model: mujoco.MjModel, joints: list[int], index_of: dict[int, int]
) -> tuple[Constraint, ...]:
    """Return the friction losses and couplings of the joints. index_of: joint -> index of link."""
    dofs, weight = model.jnt_dofadr, model.dof_invweight0
    constraints = []
    for joint in joints:
        dof = dofs[joint]
        if model.dof_frictionloss[dof]:
            friction, leader, polynomial = float(model.dof_frictionloss[dof]), -1, (0.0,)
            # solref, solimp and invweight, which make the constraint soft.
            soft = tuple(model.dof_solref[dof]), tuple(model.dof_solimp[dof]), float(weight[dof])
            constraints.append(Constraint(index_of[joint], friction, leader, polynomial, *soft))
    for k in np.flatnonzero(model.eq_active0):
        follower, leader = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        # Without a leader, the joint is held at a constant position.
        coefficients = 5 if leader >= 0 else 1
        polynomial = tuple(model.eq_data[k, :coefficients].tolist())
        weight_sum = float(sum(weight[dofs[j]] for j in (follower, leader) if j >= 0))
        soft = tuple(model.eq_solref[k]), tuple(model.eq_solimp[k]), weight_sum
        constraints.append(Constraint(index_of[follower], 0.0, index_of[leader], polynomial, *soft))
    return tuple(constraints)


def _require_supported(model: mujoco.MjModel):
    # Raises UserError for a model with features that this module would ignore.
    hinges, slides = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    touching = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    solid = touching & ((model.geom_contype | model.geom_conaffinity) > 0)
    # Kind of element -> what is not supported, and which elements have it.
    unsupported = {
        "joint": ("free or ball joints", ~np.isin(model.jnt_type, (hinges, slides))),
        "tendon": ("tendons", np.ones(model.ntendon, bool)),
        "equality": (
            "equality constraints that do not couple joints",
            model.eq_type != mujoco.mjtEq.mjEQ_JOINT,
        ),
        "geom": (
            'geoms with contacts, which <option><flag contact="disable"/></option> switches off',
            solid,
        ),
        "body": ("bodies with gravity compensation", model.body_gravcomp != 0.0),
    }
    found = []
    for kind, (feature, has_feature) in unsupported.items():
        numbers = np.flatnonzero(has_feature).tolist()
        names = [getattr(model, kind)(number).name or f"number {number}" for number in numbers]
        if names:
            more = ", ..." if len(names) > 3 else ""
            found.append(f"{feature} ({', '.join(names[:3])}{more})")
    if model.opt.density or model.opt.viscosity:
        found.append("a medium with density or viscosity")
    if model.jnt_stiffnesspoly.any() or model.dof_dampingpoly.any():
        found.append("polynomial springs or dampers")
    if (model.dof_solref < 0).any() or (model.eq_solref < 0).any():
        found.append("constraints with a negative solref")
    if found:
        raise UserError(
            f"the MJCF model has {'; '.join(found)}: expected a fixed base, hinge and slide joints,"
            " and couplings of joints only. Remove these elements from the model"
        )


@functools.lru_cache(maxsize=64)
def _program(mechanism: Mechanism, known: tuple[float | None, ...]) -> Program:
    # Returns the program of mass matrix and bias. known: values of inputs that are constant.
    return rigid_program.mass_matrix_and_bias(mechanism.links, known)


def tip_position(mechanism: Mechanism, qpos: Vec) -> Vec:
    """Return the position of the tip in the frame of the base, m."""
    return rigid_program.carried_point(mechanism.links, qpos, mechanism.carrier, mechanism.tip)


def gravity_torque(mechanism: Mechanism, qpos: Vec) -> Vec:
    """Return the torques or forces that hold the joints at rest against gravity, Nm or N."""
    inputs = *qpos, *qpos.map(lambda _: 0.0), *mechanism.gravity
    return Vec(rigid_program.evaluate_program(functools.partial(_program, mechanism), inputs)[1])


def step(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, torque: Vec, velocity_gain: Vec | None = None
) -> tuple[Vec, Vec]:
    """Return positions and velocities a time step later, by MuJoCo's integrator implicitfast.
    torque: torques of motors or controller at this state, Nm or N. velocity_gain: decrease of the
    torque for each rad/s or m/s, not negative; None: 0. `torque` already includes this decrease;
    the gain makes the step implicit in it.
    """
    h, program = mechanism.timestep, functools.partial(_program, mechanism)
    rows, bias = rigid_program.evaluate_program(program, (*qpos, *qvel, *mechanism.gravity))
    for k, link in enumerate(mechanism.links):
        rows[k][k] = add(rows[k][k], link.armature)
    springs = mechanism.stiffness.map(mul, minus(qpos, mechanism.rest))
    force = minus(minus(minus(torque, Vec(bias)), springs), mechanism.damping.map(mul, qvel))
    mass = tuple(map(Vec, rows))
    force = plus(force, _constraint_force(mechanism, qpos, qvel, mass, force))
    # The step is implicit: forces that depend on velocity are added to the mass matrix.
    damping = mechanism.damping if velocity_gain is None else plus(mechanism.damping, velocity_gain)
    for k, coefficient in enumerate(damping):
        rows[k][k] = add(rows[k][k], mul(h, coefficient))
    next_qvel = qvel + scale(h, solve_spd(tuple(map(Vec, rows)), force))
    return qpos + scale(h, next_qvel), next_qvel


def step_by_mjx(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, torque: Vec, velocity_gain: Vec
) -> tuple[Vec, Vec]:
    """Return what `step` returns, computed by MuJoCo MJX, which also solves the constraints."""
    # `torque` contains -velocity_gain * qvel. MJX computes this term itself, because it takes the
    # gain as damping. Without the addition the term would count twice.
    applied = plus(torque, velocity_gain.map(mul, qvel))
    damping = jnp.array(plus(mechanism.damping, velocity_gain))
    option = {"timestep": mechanism.timestep}
    next_qpos, next_qvel = advance_by_mjx(
        mechanism.model, qpos, qvel, applied, option, dof_damping=damping
    )
    dtype = jnp.result_type(*qpos)
    return Vec(next_qpos.astype(dtype)), Vec(next_qvel.astype(dtype))


def advance_by_mjx(
    model: mujoco.MjModel, qpos: Vec, qvel: Vec, applied: Any, option: Any, **numbers: Any
) -> tuple[Any, Any]:
    """Return positions and velocities after one `mjx.step`, arrays of the type of `qpos` or wider.
    applied: `qfrc_applied`, Nm or N. option: values that replace fields of `model.opt`. numbers:
    values that replace fields of the model. A model whose integrator is implicit takes damping at
    the end of the step.
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
    """Return the module `mjx`, and the model and its data for JAX. dtype: only part of the cache's
    key, because a result has the type of JAX's numbers.
    """
    # The import takes half a second and prints a line for each optional backend that is missing.
    # Without the lock, two threads that compile would leave sys.stdout redirected.
    with _MJX_IMPORT, contextlib.redirect_stdout(io.StringIO()):
        from mujoco import mjx
    with jax.ensure_compile_time_eval():
        return mjx, mjx.put_model(model), mjx.make_data(model)


def _constraint_force(
    mechanism: Mechanism, qpos: Vec, qvel: Vec, mass: tuple[Vec, ...], force: Vec
) -> Vec:
    """Return the joint forces of friction loss and couplings, by projected Gauss-Seidel. mass: rows
    of the mass matrix. force: other joint forces. Each sweep sets the force of one constraint after
    the other so that acceleration + softness * force is what it aims at.
    """
    # Direction in joint space, acceleration aimed at, and regularisation of each constraint.
    rows: list[tuple[Vec, Scalar, Scalar]] = []
    for constraint in mechanism.constraints:
        direction, position = _deviation(mechanism, constraint, qpos)
        aim = constraint.reference(position, dot(direction, qvel), mechanism.timestep)
        rows.append((direction, *aim))
    if not rows:
        return qpos.map(lambda _: 0.0)
    directions = Vec(direction for direction, _, _ in rows)
    free_acceleration = matvec(directions, solve_spd(mass, force))
    # Joint accelerations by a unit force of each constraint.
    responses = [solve_spd(mass, direction) for direction in directions]
    magnitudes: list[Scalar] = [0.0] * len(rows)
    # A single constraint is solved by the first sweep.
    for _ in range(SWEEPS if len(rows) > 1 else 1):
        for k, (direction, acceleration, softness) in enumerate(rows):
            response = [dot(direction, column) for column in responses]
            residual = (
                free_acceleration[k]
                - acceleration
                + dot(Vec(response), Vec(magnitudes))
                + softness * magnitudes[k]
            )
            magnitude = magnitudes[k] - residual / (response[k] + softness)
            if friction := mechanism.constraints[k].friction:
                magnitude = clamp(magnitude, -friction, friction)
            magnitudes[k] = magnitude
    return matvec(transpose(directions), Vec(magnitudes))


def _deviation(mechanism: Mechanism, constraint: Constraint, qpos: Vec) -> tuple[Vec, Scalar]:
    """Return a constraint's deviation: its derivative by joint positions, and its value. That of a
    coupling is the joint's position minus the polynomial of the leader's. Friction has none (0).
    """
    direction = Vec(float(k == constraint.joint) for k in range(len(qpos)))
    if constraint.friction:
        return direction, 0.0
    # Horner's scheme for the polynomial and its derivative. Without a leader (-1), it is constant.
    target = slope = 0.0
    for coefficient in reversed(constraint.polynomial):
        offset = qpos[constraint.leader] - mechanism.links[constraint.leader].reference
        slope = add(mul(slope, offset), target)
        target = add(mul(target, offset), coefficient)
    if constraint.leader >= 0:
        direction = direction.replace(constraint.leader, -slope)
    position = qpos[constraint.joint] - mechanism.links[constraint.joint].reference - target
    return direction, position
