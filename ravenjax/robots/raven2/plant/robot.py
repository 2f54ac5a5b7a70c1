"""The virtual robot: one arm's seven motors, cables, links and encoders, one millisecond a tick.

Per substep, linearly implicit and without iteration: link inertia and bias forces once, at the
start; cable stiffness and damping, viscous and dry friction at the end. Motors are eliminated one
by one, which leaves one symmetric system in the joint accelerations:

    (M/dt + Fv + T^T D T) dv = T^T lambda - bias - Fv v - Coulomb + stops + external

Where the instrument touches something (`contact`), that force and its loss with speed are part of
both sides.

It is unconditionally stable: the authors' insertion cable (-1943 /s) and the instrument's grams
need no small step.

State is offsets from where the run began: motor angles as whole encoder counts and a fraction,
cable stretch by itself, and the links follow from both. No small difference of large numbers is
ever formed, so float32 loses nothing that an encoder sees.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.numbers import counter_random, tree
from ravenjax.numbers.algebra import add, mul, sub
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.linear_solve import solve_spd
from ravenjax.numbers.vec import Scalar, Vec, cast, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import (
    actuators,
    brakes,
    cables,
    contact,
    encoders,
    kinematic_errors,
    parameter_sets,
    published,
    stops,
)
from ravenjax.robots.raven2.plant.coupling import BuiltCoupling, Coupling, built, coupling
from ravenjax.robots.raven2.plant.friction import coulomb_damping
from ravenjax.robots.raven2.plant.records import PlantOutput, PlantParams, PlantSignal, PlantState
from ravenjax.robots.raven2.setup import RavenSetup

TICK_S = 1e-3
N = 7
POSITIONING = 3
TORQUE_CHANNEL = 8  # noise channels of an arm: 0-6 encoders, 8-14 torques
ARM_CHANNELS = 16


def nominal_signal(current_cmd: Vec, brakes: Scalar) -> PlantSignal:
    """A signal without any fault; the literal ones and zeros drop out of the traced code."""
    one = Vec.full(N, 1.0)
    return PlantSignal(current_cmd, brakes, one, one, one, Vec.full(N, 0.0))


def params(
    setup: RavenSetup, arm: ArmName, parameter_set: str = parameter_sets.DEFAULT
) -> PlantParams:
    """Documented values; `parameter_set` names one of `parameter_sets.Name`."""
    values = parameter_sets.parameter_set(parameter_set)
    return PlantParams(
        actuators=actuators.ActuatorParams(
            torque_per_count=Vec(values.torque_per_count),
            gain=Vec(values.gain),
            bias=Vec(values.bias),
            inertia=Vec(values.motor_inertia),
            coulomb=Vec(values.motor_coulomb),
            viscous=Vec(values.motor_viscous),
            reaction_scale=Vec(values.reaction_scale),
            torque_limit=Vec(values.torque_limit),
            stall_torque=Vec(values.stall_torque),
            back_emf=Vec(values.back_emf),
        ),
        brakes=brakes.params(setup),
        cable_stiffness=Vec(values.stiffness),
        cable_damping=Vec(values.damping),
        cable_strength=Vec(values.strength),
        link_coulomb=Vec(values.link_coulomb),
        link_viscous=Vec(values.link_viscous),
        stops=stops.params(_tool(setup, arm)),
        kinematic_errors=kinematic_errors.exact(),
        friction_scale=1.0,
        cable_stiffness_scale=1.0,
        motor_constant_scale=1.0,
        mass_scale=1.0,
        gravity=Vec(
            (-9.81, 0.0, 0.0)
        ),  # m/s2; magnitude of Li_DYN, direction of both Li_DYN and grav_comp.cpp
        # Assumed where noise is drawn: an edge's jitter as large as a count's rounding, and one
        # count of the DAC.
        encoder_noise=12.0**-0.5 if setup.noise else 0.0,
        torque_noise=published.CONTROLLER_TORQUE_PER_COUNT if setup.noise else 0.0,
        noise_key=np.uint32(0),
    )


def init(setup: RavenSetup, arm: ArmName, params: PlantParams, jpos0: Vec) -> PlantState:
    """At rest, brakes on, each cable stretched by its share of gravity. The software takes the
    links to be at `jpos0` (rad, m), where they are but for their errors."""
    geometry, errors = _coupling(setup, arm, params), params.kinematic_errors
    dtype = setup.precision.real
    jpos0 = Vec(jnp.asarray(x, dtype) for x in jpos0)
    links = kinematic_errors.true_joints(errors, jpos0)
    at_rest = Vec.full(N, 0.0)
    _, weight = link_dynamics.mass_matrix_and_bias(
        setup, arm, links, at_rest, params.gravity, params.mass_scale
    )
    still = Vec(jnp.asarray(0.0, dtype) for _ in range(N))
    carried = geometry.carried(weight)
    stretch = Vec(
        cables.resting_stretch(
            cables.ARMS_M[i], params.cable_stiffness[i] * params.cable_stiffness_scale, carried[i]
        )
        for i in range(N)
    )
    motors = tuple(
        encoders.at_angle(angle) for angle in _nominal_coupling(setup, arm).motors(jpos0) + stretch
    )
    fractions = Vec(motor.fraction * encoders.RAD_PER_COUNT for motor in motors)
    zero = jnp.int32(0)
    return PlantState(
        motors=tuple(
            encoders.Angle(count=zero, fraction=cast(motor.fraction, dtype)) for motor in motors
        ),
        stretch=cast(stretch, dtype),
        mvel=still,
        jvel=still,
        brakes=brakes.init(setup, params.brakes),
        intact=Vec(jnp.asarray(1.0, dtype) for _ in range(N)) if setup.cables == "break" else None,
        tick=zero,
        jpos_ref=cast(links - geometry.joints(fractions - stretch), dtype),
        count_ref=Vec(motor.count for motor in motors),
        frame=cast(kinematic_errors.register(arm, errors), dtype),
    )


def step(
    setup: RavenSetup,
    arm: ArmName,
    params: PlantParams,
    state: PlantState,
    signal: PlantSignal,
    touched: contact.ContactParams | None = None,
) -> tuple[PlantState, PlantOutput]:
    """One tick (1 ms, `setup.substeps` steps) under the DAC command just written; the next tick
    reads `PlantOutput`.

    touched: of what the instrument touches; None: nothing is there.
    """
    begun = _begin(setup, arm, params, state, signal)
    for _ in range(setup.substeps):
        step_s = TICK_S / setup.substeps
        ready = _prepared(
            setup, arm, params, begun.state, signal, begun.drive, begun.holding, step_s, touched
        )
        gained = solve_spd(ready.system, ready.right)
        touch = None if ready.tips is None else contact.felt(ready.tips, gained)
        begun.take(*_moved(params, begun.state, ready, gained, step_s), touch)
    return _end(setup, arm, params, signal, begun)


def step_all(
    setup: RavenSetup,
    params: tuple[PlantParams, ...],
    states: tuple[PlantState, ...],
    signals: tuple[PlantSignal, ...],
    touched: contact.ContactParams | None,
) -> tuple[tuple[PlantState, PlantOutput], ...]:
    """`step` of every arm."""
    if touched is not None and len(setup.arms) == 2:
        return step_together(setup, params, states, signals, touched)
    return tuple(
        step(setup, arm, params[i], states[i], signals[i], touched)
        for i, arm in enumerate(setup.arms)
    )


def step_together(
    setup: RavenSetup,
    params: tuple[PlantParams, ...],
    states: tuple[PlantState, ...],
    signals: tuple[PlantSignal, ...],
    touched: contact.ContactParams,
) -> tuple[tuple[PlantState, PlantOutput], ...]:
    """`step` of two arms whose instruments touch tissue and each other.

    The force between the two is solved with both arms' equations: it is the same on both, whatever
    each gives way.
    """
    arms = setup.arms
    one, other = begun = [_begin(setup, arms[i], params[i], states[i], signals[i]) for i in (0, 1)]
    step_s = TICK_S / setup.substeps
    for _ in range(setup.substeps):
        jpos = [
            _jpos(_coupling(setup, arms[i], params[i]), begun[i].state, setup.precision.real)
            for i in (0, 1)
        ]
        ends = (one.state.jvel, other.state.jvel)
        pair = contact.meeting((arms[0], arms[1]), touched, (jpos[0], jpos[1]), ends, step_s)
        ready = [
            _prepared(
                setup,
                arms[i],
                params[i],
                begun[i].state,
                signals[i],
                begun[i].drive,
                begun[i].holding,
                step_s,
                touched,
                pair.ways[i] * pair.normal.force,
            )
            for i in (0, 1)
        ]
        yielding = [solve_spd(item.system, way) for item, way in zip(ready, pair.ways, strict=True)]
        gained = [solve_spd(item.system, item.right) for item in ready]
        force = pair.solved((gained[0], gained[1]), (yielding[0], yielding[1]))
        for i in (0, 1):
            speeds = gained[i] + yielding[i] * (force - pair.normal.force)
            tips = ready[i].tips
            assert tips is not None
            touch = contact.felt(tips, speeds)
            touch = replace(touch, force=touch.force + pair.apart[i] * force, instrument=force)
            begun[i].take(*_moved(params[i], begun[i].state, ready[i], speeds, step_s), touch)
    return tuple(_end(setup, arms[i], params[i], signals[i], begun[i]) for i in (0, 1))


class _Begun:
    """A tick under way."""

    def __init__(
        self, state: PlantState, drive: Vec, holding: Scalar, brake_state: brakes.BrakeState
    ) -> None:
        self.state, self.drive, self.holding, self.brakes = state, drive, holding, brake_state
        self.carried: list[Vec] = []
        self.touches: list[contact.Touch | None] = []

    def take(self, state: PlantState, tension: Vec, touch: contact.Touch | None) -> None:
        """A substep's state, what each cable carried in it (N), and what the instrument touched."""
        self.state = state
        self.carried.append(tension.map(jnp.abs))
        self.touches.append(touch)


def _begin(
    setup: RavenSetup, arm: ArmName, params: PlantParams, state: PlantState, signal: PlantSignal
) -> _Begun:
    brake_state, holding = brakes.step(setup, params.brakes, state.brakes, signal.brakes)
    brake_state = cast(brake_state, "int32")
    return _Begun(state, _drive(setup, arm, params, state, signal), holding, brake_state)


def _end(
    setup: RavenSetup, arm: ArmName, params: PlantParams, signal: PlantSignal, done: _Begun
) -> tuple[PlantState, PlantOutput]:
    dtype, state = setup.precision.real, done.state
    state = PlantState(
        motors=state.motors,
        stretch=cast(state.stretch, dtype),
        mvel=cast(state.mvel, dtype),
        jvel=cast(state.jvel, dtype),
        brakes=done.brakes,
        intact=cast(state.intact, dtype),
        tick=state.tick + 1,
        jpos_ref=state.jpos_ref,
        count_ref=state.count_ref,
        frame=state.frame,
    )
    out = observe(setup, arm, params, state, signal.cable_scale)
    carried = functools.reduce(lambda a, b: a.map(jnp.maximum, b), done.carried)
    return state, replace(out, carried=carried, touch=_mean(done.touches))


def _mean(touches: Sequence[contact.Touch | None]) -> contact.Touch | None:
    """Over the substeps."""
    first = touches[0]
    if first is None or len(touches) == 1:
        return first
    share = 1.0 / len(touches)
    return tree.mapped(lambda *parts: functools.reduce(lambda a, b: a + b, parts) * share, *touches)


def observe(
    setup: RavenSetup,
    arm: ArmName,
    params: PlantParams,
    state: PlantState,
    cable_scale: Vec | None = None,
) -> PlantOutput:
    """What can be seen of a state: encoders, and the truth. cable_scale: as in `PlantSignal`;
    None: whole cables.
    """
    scale = _whole(state, Vec.full(N, 1.0) if cable_scale is None else cable_scale)
    tension = Vec(
        cables.tension(
            _stiffness(params, i, scale[i]), 0.0, cables.ARMS_M[i] * state.stretch[i], 0.0
        )
        for i in range(N)
    )
    dtype = setup.precision.real
    signs = transmission.encoder_signs(arm, _tool(setup, arm), setup.software)
    turned = Vec(encoders.radians(motor, dtype) for motor in state.motors)
    counts = [
        motor.count + reference
        for motor, reference in zip(state.motors, state.count_ref, strict=True)
    ]
    if setup.noise:
        counts = [
            count
            + encoders.noise_counts(
                params.encoder_noise, params.noise_key, state.tick, _channel(arm, i)
            )
            for i, count in enumerate(counts)
        ]
    return PlantOutput(
        enc_val=Vec(mul(int(sign), count) for sign, count in zip(signs, counts, strict=True)),
        jpos=_jpos(_coupling(setup, arm, params), state, dtype),
        jvel=state.jvel,
        mpos=Vec(
            turn + reference.astype(dtype) * encoders.RAD_PER_COUNT
            for turn, reference in zip(turned, state.count_ref, strict=True)
        ),
        mvel=state.mvel,
        stretch=state.stretch,
        tension=tension,
        carried=tension.map(jnp.abs),
        brakes=state.brakes.engaged,
    )


def tip(arm: ArmName, params: PlantParams, state: PlantState, jpos: Vec) -> Vec:
    """True tip (3, m, registered frame 0) with the links at `jpos`, as in `PlantOutput`."""
    return kinematic_errors.tip(arm, params.kinematic_errors, state.frame, jpos)


class _Prepared(NamedTuple):
    """One arm's equations of a substep: `system` gained = `right`, and what goes on from what
    the joints gain.
    """

    system: tuple[Vec, ...]  # 7 of 7, lower triangle
    right: Vec  # 7, N m, N
    geometry: Coupling | BuiltCoupling
    link_speed: Vec  # rad/s, in motor angle
    springs: list[cables.Linear]
    solved: list[actuators.Eliminated]
    tips: tuple[contact.TipContact, ...] | None


def _prepared(
    setup: RavenSetup,
    arm: ArmName,
    params: PlantParams,
    state: PlantState,
    signal: PlantSignal,
    drive: Vec,
    holding: Scalar,
    dt: float,
    touched: contact.ContactParams | None,
    pushed: Vec | None = None,
) -> _Prepared:
    """The equations of the coming `dt` (s). pushed: what the other instrument puts on the
    joints, N m, N.
    """
    geometry = _coupling(setup, arm, params)
    motor = params.actuators
    jpos, jvel = _jpos(geometry, state, setup.precision.real), state.jvel
    mass, bias = link_dynamics.mass_matrix_and_bias(
        setup, arm, jpos, jvel, params.gravity, params.mass_scale
    )
    friction = Vec(mul(signal.friction_scale[i], params.friction_scale) for i in range(N))
    link_speed = geometry.motors(jvel)
    scale = _whole(state, signal.cable_scale)
    springs = [
        cables.linearise(
            cables.ARMS_M[i],
            _stiffness(params, i, scale[i]),
            mul(scale[i], params.cable_damping[i]),
            state.stretch[i],
            dt,
        )
        for i in range(N)
    ]

    solved = []
    for i in range(N):
        coulomb = motor.coulomb[i] * friction[i]
        solved.append(
            actuators.eliminate(
                inertia_rate=motor.inertia[i] * (1.0 / dt),
                viscous=motor.viscous[i] * friction[i],
                coulomb=coulomb + holding if i < POSITIONING else coulomb,
                reaction_scale=motor.reaction_scale[i],
                drive=drive[i],
                speed=state.mvel[i],
                link_speed=link_speed[i],
                cable=springs[i],
            )
        )

    system = geometry.congruence(Vec(item.stiffening for item in solved))
    loads = geometry.loads(Vec(item.force for item in solved))
    tips = None
    if touched is not None:
        tips = contact.tips(arm, touched, jpos, jvel, dt)
        for one in tips:
            one.stiffen(system)
            loads = loads + one.tip.along(one.force())
    if pushed is not None:
        loads = loads + pushed
    right: list[Scalar] = []
    for i in range(N):
        for j in range(i + 1):
            system[i][j] = add(system[i][j], mul(1.0 / dt, mass[i][j]))
        viscous = params.link_viscous[i] * friction[i]
        stop = stops.contact(params.stops, i, jpos[i], jvel[i], dt)
        system[i][i] = system[i][i] + (viscous + stop.damping)
        force = (
            add(sub(loads[i], bias[i]), signal.external_torque[i]) - viscous * jvel[i] + stop.force
        )
        stick = coulomb_damping(
            params.link_coulomb[i] * friction[i], system[i][i] * jvel[i] + force, system[i][i]
        )
        system[i][i] = system[i][i] + stick
        right.append(force - stick * jvel[i])

    return _Prepared(
        tuple(Vec(row) for row in system), Vec(right), geometry, link_speed, springs, solved, tips
    )


def _moved(
    params: PlantParams, state: PlantState, ready: _Prepared, gained: Vec, dt: float
) -> tuple[PlantState, Vec]:
    """The state after `dt` (s), and what each cable carried in it, N. gained: speed of the
    joints, rad/s and m/s.
    """
    pulled = ready.geometry.motors(gained)
    mvel, stretch, motors, carried = [], [], [], []
    for i, item in enumerate(ready.solved):
        speed = (item.momentum + item.coupling * (ready.link_speed[i] + pulled[i])) * item.inverse
        rate = item.stretch_rate - item.resistance * item.inverse * pulled[i]
        mvel.append(speed)
        stretch.append(state.stretch[i] + dt * rate)
        motors.append(encoders.advance(state.motors[i], dt * speed))
        carried.append(ready.springs[i].carried(cables.ARMS_M[i], rate))
    after = PlantState(
        motors=tuple(motors),
        stretch=Vec(stretch),
        mvel=Vec(mvel),
        jvel=state.jvel + gained,
        brakes=state.brakes,
        intact=_parted(params, state.intact, carried),
        tick=state.tick,
        jpos_ref=state.jpos_ref,
        count_ref=state.count_ref,
        frame=state.frame,
    )
    return after, Vec(carried)


def _parted(params: PlantParams, intact: Vec | None, carried: Sequence[Scalar]) -> Vec | None:
    """Which cables are whole after they carried that, N; None where none can part."""
    if intact is None:
        return None
    overloaded = Vec(carried).map(
        lambda force, strength: jnp.abs(force) > strength, params.cable_strength
    )
    return intact.map(lambda whole, over: jnp.where(over, 0.0, whole), overloaded)


def _whole(state: PlantState, cable_scale: Vec) -> Vec:
    """Share of each cable's stiffness and damping that is there; none of one that has parted."""
    return cable_scale if state.intact is None else cable_scale.map(mul, state.intact)


def _stiffness(params: PlantParams, i: int, scale: Scalar) -> Scalar:
    """Of cable i, N/m; a cut one has none."""
    return mul(scale, params.cable_stiffness[i] * params.cable_stiffness_scale)


def _drive(
    setup: RavenSetup, arm: ArmName, params: PlantParams, state: PlantState, signal: PlantSignal
) -> Vec:
    """Motor torques (N m after gearbox, positive motor direction) of the DAC command, constant
    over the tick.
    """
    motor = params.actuators
    signs = transmission.tau_signs(arm, _tool(setup, arm), setup.software)
    drive = []
    for i in range(N):
        per_count = motor.torque_per_count[i] * motor.gain[i] * params.motor_constant_scale
        command = mul(float(signs[i]), signal.current_cmd[i].astype(setup.precision.real))
        torque = mul(signal.torque_scale[i], per_count) * command + motor.bias[i]
        torque = actuators.limited(
            torque, state.mvel[i], motor.torque_limit[i], motor.stall_torque[i], motor.back_emf[i]
        )
        if setup.noise:
            channel = _channel(arm, TORQUE_CHANNEL + i)
            torque = torque + params.torque_noise * counter_random.normal(
                params.noise_key, state.tick, channel
            )
        drive.append(torque)
    return Vec(drive)


def _jpos(geometry: Coupling | BuiltCoupling, state: PlantState, dtype: str) -> Vec:
    turned = Vec(encoders.radians(motor, dtype) for motor in state.motors)
    return state.jpos_ref + geometry.joints(turned - state.stretch)


def _coupling(setup: RavenSetup, arm: ArmName, params: PlantParams) -> Coupling | BuiltCoupling:
    return built(_nominal_coupling(setup, arm), kinematic_errors.gain(params.kinematic_errors))


def _nominal_coupling(setup: RavenSetup, arm: ArmName) -> Coupling:
    """As the software believes it."""
    return coupling(arm, _tool(setup, arm), setup.software)


def _tool(setup: RavenSetup, arm: ArmName) -> str:
    return setup.tools[setup.arms.index(arm)]


def _channel(arm: ArmName, channel: int) -> int:
    return channel + (ARM_CHANNELS if arm == "green" else 0)
