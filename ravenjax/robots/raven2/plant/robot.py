"""Simulates one arm of the virtual robot: seven motors, cables, links and encoders, 1 ms per tick.

Each substep is linearly implicit, without iteration. Link inertia and bias forces are evaluated
once, at the start; cable stiffness and damping, viscous and dry friction at the end. Motors are
eliminated one by one, which leaves one symmetric system in the joint accelerations:

    (M/dt + Fv + T^T D T) dv = T^T lambda - bias - Fv v - Coulomb + stops + external

M is the inertia of the links, Fv their viscous friction, T the matrix from joints to motors, D the
damping of the cables, and lambda their torque (`drives`). If the instrument touches something, the
contact force is added to the right side, and its derivative by speed to the left side.

The scheme is unconditionally stable. The insertion cable (an eigenvalue of -1943 /s with published
parameters) and the small masses of the instrument therefore need no small step.

The state is stored relative to the start of the run. Motor angles are whole encoder counts and a
fraction, and cable stretch is stored separately. The links' positions follow from both. No small
difference of large numbers is computed, so float32 is exact enough for every encoder count.
"""

import dataclasses
from collections.abc import Mapping
from functools import partial, reduce
from typing import Any

import numpy as np

from ravenjax.numbers import cast_to_real, counter_random, describe_fields, jnp, tree
from ravenjax.numbers.algebra import add, mul, solve_spd, sub
from ravenjax.numbers.vec import Scalar, Vec, as_int, cast, record, replace
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import contact, drives, kinematic_errors, parameter_sets
from ravenjax.robots.raven2.plant.coupling import Coupling, arm_coupling
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup, map_arms
from ravenjax.vocabulary import TICK_S

N = 7
_ONES = Vec.full(N, 1.0)
POSITIONING = 3
TORQUE_CHANNEL = 8  # noise channels of an arm: 0-6 encoders, 8-14 torques
ARM_CHANNELS = 16


@describe_fields
@record
class PlantParams:
    """Parameters of one arm, which may vary from run to run; quantities.toml has their ranges."""

    actuators: drives.ActuatorParams
    brakes: drives.BrakeParams
    cable_stiffness: Vec  # N/m; ke
    cable_damping: Vec  # N s/m; be
    cable_strength: Vec  # N; only used in stage overload, and if Setup.cables is "break"
    link_coulomb: Vec  # N m; insertion N
    link_viscous: Vec  # N m s/rad; insertion N s/m
    stops: drives.StopParams
    kinematic_errors: kinematic_errors.KinematicErrors
    friction_scale: Scalar = 1.0
    cable_stiffness_scale: Scalar = 1.0
    motor_constant_scale: Scalar = 1.0
    mass_scale: Scalar = 1.0
    gravity: Vec = Vec((-9.81, 0.0, 0.0))  # m/s2; 3; size of Li_DYN, direction of grav_comp.cpp too
    encoder_noise: Scalar = 0.0  # counts rms
    torque_noise: Scalar = 0.0  # N m rms
    noise_key: Scalar = np.uint32(0)  # uint32; a run and its golden run share it


@record
class PlantState:
    motors: tuple[drives.Angle, ...]  # seven, from the reference count
    stretch: Vec  # rad of motor angle, cable stretch m - T q
    mvel: Vec  # rad/s
    jvel: Vec  # rad/s; insertion m/s
    brakes: drives.BrakeState
    intact: Vec | None  # 1: whole, 0: the cable is broken; only if Setup.cables is "break"
    tick: Scalar  # ms, int32: counter of the noise
    jpos_ref: Vec  # rad; insertion m; joints at the reference counts, cables unstretched; constant
    count_ref: Vec  # counts, int32, whole motor counts at the reference; constant in a run
    # Registration of the true arm, constant in a run; None: without errors or not registered
    frame: kinematic_errors.Registration | None


@record
class PlantSignal:
    current_cmd: Vec  # DAC counts as written to USB, int32
    brakes: Scalar  # 1: brakes commanded on, int32 or bool
    # The ones and zeros of a robot without a fault add no operations to the tick.
    torque_scale: Vec = _ONES  # 1, factor on each motor's torque constant
    cable_scale: Vec = _ONES  # 1, factor on stiffness and damping of each cable
    friction_scale: Vec = _ONES  # 1, factor on friction of each motor and link
    external_torque: Vec = Vec.full(N, 0.0)  # N m; insertion N, load on each joint


@record
class PlantOutput:
    enc_val: Vec  # counts, int32, as unpacked from USB
    jpos: Vec  # rad; insertion m, of the links
    jvel: Vec  # rad/s; insertion m/s
    mpos: Vec  # rad, of the motor shafts
    mvel: Vec  # rad/s
    stretch: Vec  # rad of motor angle
    tension: Vec  # N, static tension difference of each cable at this stretch
    carried: Vec  # N, largest magnitude of each cable's tension difference in this tick
    brakes: Scalar  # 1: brakes are engaged, int32
    touch: contact.Touch | None = None  # forces in this tick; only with contact


def params(
    setup: RavenSetup, arm: ArmName, parameter_set: str = parameter_sets.DEFAULT
) -> PlantParams:
    """Return the default values. parameter_set: one of `parameter_sets.Name`."""
    return PlantParams(
        **parameter_sets.parameter_set(parameter_set)._asdict(),
        brakes=drives.BrakeParams(),
        stops=drives.stop_params(_tool(setup, arm)),
        kinematic_errors=kinematic_errors.no_errors(),
        # Sizes of noise are assumed: of encoders 1/sqrt(12) count, the rms error of rounding to a
        # count; of torques one DAC count.
        encoder_noise=12.0**-0.5 if setup.noise else 0.0,
        torque_noise=transmission.TORQUE_PER_COUNT[0] if setup.noise else 0.0,
    )


def init(setup: RavenSetup, arm: ArmName, params: PlantParams, jpos0: Vec) -> PlantState:
    """Return the state at rest with the brakes on. Cables are stretched by the links' weight.
    jpos0: joints that the software reports (rad, m). With kinematic errors, the true joints differ.
    """
    coupling, errors = _coupling(setup, arm, params), params.kinematic_errors
    dtype, jpos0 = setup.precision.real, cast_to_real(setup, jpos0)
    true_jpos = kinematic_errors.true_joints(errors, jpos0)
    no_speed = Vec.full(N, 0.0)
    _, gravity_load = link_dynamics.mass_matrix_and_bias(
        arm, true_jpos, no_speed, params.gravity, params.mass_scale
    )
    zeros = cast_to_real(setup, no_speed)
    torques = coupling.motor_torques(gravity_load)
    stretch = Vec(
        drives.resting_stretch(lever, _stiffness(params, i, scale=1.0), torques[i])
        for i, lever in enumerate(transmission.CABLE_PER_MOTOR)
    )
    # The software computes `jpos0` from motor angles with the nominal coupling.
    angles = _nominal_coupling(setup, arm).to_motors(jpos0) + stretch
    motors = tuple(drives.advance_angle(drives.REFERENCE, angle) for angle in angles)
    fractions = Vec(motor.fraction * transmission.ENCODER_RAD for motor in motors)
    zero = jnp.int32(0)
    # Motor angles count from `count_ref`, the present whole counts. The equation T (joints -
    # jpos_ref) = motor angles - stretch, with the motor matrix T, defines the constant `jpos_ref`.
    # It holds in every tick. Now the joints are `true_jpos`, and the motor angles `fractions`.
    return PlantState(
        motors=tuple(drives.Angle(zero, cast(motor.fraction, dtype)) for motor in motors),
        stretch=cast(stretch, dtype),
        mvel=zeros,
        jvel=zeros,
        brakes=drives.BrakeState(jnp.int32(1), zero),
        intact=cast_to_real(setup, Vec.full(N, 1.0)) if setup.cables == "break" else None,
        tick=zero,
        jpos_ref=cast(true_jpos - coupling.to_joints(fractions - stretch), dtype),
        count_ref=Vec(motor.count for motor in motors),
        frame=cast(kinematic_errors.register_frame(arm, errors), dtype),
    )


def step(
    setup: RavenSetup,
    arm: ArmName,
    params: PlantParams,
    state: PlantState,
    signal: PlantSignal,
    touched: contact.ContactParams | None = None,
) -> tuple[PlantState, PlantOutput]:
    """Compute one tick (1 ms, `setup.substeps` steps) with the DAC command of this tick.
    The next tick reads `PlantOutput`. touched: contact parameters; None: no contact.
    """
    tick = _ArmTick(setup, arm, params, state, signal, touched)
    for _ in range(setup.substeps):
        system, right = tick.equations()
        tick.move(tick.solve(system, right))
    return tick.end()


def step_all(
    setup: RavenSetup,
    params: PerArm[PlantParams],
    states: PerArm[PlantState],
    signals: PerArm[PlantSignal],
    stages: Mapping[str, Any] = {},
) -> PerArm[tuple[PlantState, PlantOutput]]:
    """Compute `step` for every arm, and the contact between the instruments of two arms.

    The force between the instruments is solved with the equations of both arms. stages: parameters
    of the optional stages in the tick.
    """
    arms, touched = setup.arms, stages.get("contact")
    if touched is None or len(arms) < 2:
        return map_arms(setup, partial(step, touched=touched), params, states, signals)
    arm_ticks = map_arms(setup, partial(_ArmTick, touched=touched), params, states, signals)
    left, right = arm_ticks
    for _ in range(setup.substeps):
        jpos, jvel = (left.jpos(), right.jpos()), (left.state.jvel, right.state.jvel)
        touching = contact.find_instrument_contact(arms, touched, jpos, jvel, left.dt)
        rows, present_force = touching.separation_rows, touching.normal.force
        # A row times a force is the load of this force on the joints of its arm.
        systems = [arm.equations(rows[i] * present_force) for i, arm in enumerate(arm_ticks)]
        # The changes of joint speeds are linear in the contact force. Solved with `present_force`,
        # they are speed_gains; each newton more adds gains_per_newton.
        gains_per_newton = [arm.solve(systems[i][0], rows[i]) for i, arm in enumerate(arm_ticks)]
        speed_gains = [arm.solve(*system) for arm, system in zip(arm_ticks, systems, strict=True)]
        force = touching.force(speed_gains, gains_per_newton)
        for i, arm in enumerate(arm_ticks):
            corrected_gains = speed_gains[i] + gains_per_newton[i] * (force - present_force)
            arm.move(corrected_gains, (touching.directions[i], force))
    return left.end(), right.end()


@dataclasses.dataclass
class _ArmTick:
    """A tick of one arm, substep by substep. touched: contact parameters; None: no contact."""

    setup: RavenSetup
    arm: ArmName
    params: PlantParams
    state: PlantState
    signal: PlantSignal
    touched: contact.ContactParams | None

    def __post_init__(self) -> None:
        setup, params, state = self.setup, self.params, self.state
        self.dt = TICK_S / setup.substeps
        brakes, self._holding = drives.step_brakes(params.brakes, state.brakes, self.signal.brakes)
        self._brakes = cast(brakes, "int32")
        self._torques = _commanded_torques(setup, self.arm, params, state, self.signal)
        self._coupling = _coupling(setup, self.arm, params)
        # One entry per substep: magnitudes of the cables' tension differences; contact forces
        self._tensions: list[Vec] = []
        self._touches: list[contact.Touch] = []

    def jpos(self) -> Vec:
        """Joints, rad and m."""
        return _jpos(self._coupling, self.state, self.setup.precision.real)

    def equations(self, pushed: Vec | None = None) -> tuple[tuple[Vec, ...], Vec]:
        """Return a 7x7 system (its lower triangle) and its right side (N m; insertion N).

        The solution contains the speed gains of the joints in the coming substep. pushed: load of
        the other instrument on the joints, N m; insertion N.
        """
        params, state, signal, dt = self.params, self.state, self.signal, self.dt
        motor = params.actuators
        jpos, jvel = self.jpos(), state.jvel
        self._links = jpos, jvel, params.gravity, params.mass_scale
        mass, bias = link_dynamics.mass_matrix_and_bias(self.arm, *self._links)
        friction = signal.friction_scale.map(mul, params.friction_scale)
        # rad/s of motor angle, as the gains of link speed in `move`
        self._link_speed = self._coupling.to_motors(jvel)
        scale = _cable_scale(state, signal.cable_scale)
        self._springs: list[drives.Linear] = []
        for i, lever in enumerate(transmission.CABLE_PER_MOTOR):
            stiffness = _stiffness(params, i, scale[i])
            damping = mul(scale[i], params.cable_damping[i])
            spring = drives.linearise_cable(lever, stiffness, damping, state.stretch[i], dt)
            self._springs.append(spring)
        self._solved: list[drives.EliminatedMotor] = []
        for i in range(N):
            coulomb = motor.coulomb[i] * friction[i]
            self._solved.append(
                drives.eliminate_motor(
                    inertia_rate=motor.inertia[i] * (1.0 / dt),
                    viscous=motor.viscous[i] * friction[i],
                    coulomb=coulomb + self._holding if i < POSITIONING else coulomb,
                    reaction_scale=motor.reaction_scale[i],
                    drive=self._torques[i],
                    speed=state.mvel[i],
                    link_speed=self._link_speed[i],
                    cable=self._springs[i],
                )
            )
        system = self._coupling.congruence(Vec(motor.stiffening for motor in self._solved))
        loads = self._coupling.joint_loads(Vec(motor.force for motor in self._solved))
        self._tips = ()
        if self.touched is not None:
            self._tips = contact.jaw_tips(self.arm, self.touched, jpos, jvel, dt)
            for tip_contact in self._tips:
                tip_contact.add_damping(system)
                loads = loads + tip_contact.tip.project_on_joints(tip_contact.present_force())
        if pushed is not None:
            loads = loads + pushed
        right = []
        for i in range(N):
            for j in range(i + 1):
                system[i][j] = add(system[i][j], mul(1.0 / dt, mass[i][j]))
            viscous = params.link_viscous[i] * friction[i]
            stop, damping = drives.stop_force(params.stops, i, jpos[i], jvel[i], dt)
            system[i][i] = system[i][i] + (viscous + damping)
            load = add(sub(loads[i], bias[i]), signal.external_torque[i])
            force = load - viscous * jvel[i] + stop
            dry_friction = drives.coulomb_damping(
                params.link_coulomb[i] * friction[i], system[i][i] * jvel[i] + force, system[i][i]
            )
            system[i][i] = system[i][i] + dry_friction
            right.append(force - dry_friction * jvel[i])
        return tuple(Vec(row) for row in system), Vec(right)

    def solve(self, system: tuple[Vec, ...], right: Vec) -> Vec:
        """Return the speed gains of the joints. system, right: from `equations`."""
        if self.setup.link_dynamics == "mjx":
            return link_dynamics.solve_by_mjx(self.arm, self.dt, system, right, *self._links)
        return solve_spd(system, right)

    def move(self, speed_gains: Vec, pressed: tuple[Vec, Scalar] | None = None) -> None:
        """Set the state to that at the end of the substep. speed_gains: changes of the joint speeds
        in it, rad/s and m/s. pressed: direction and magnitude (N) of the other instrument's force.
        """
        state = self.state
        if self._tips:
            touch = contact.contact_forces(self._tips, speed_gains)
            if pressed is not None:
                direction, force = pressed
                touch = replace(touch, force=touch.force + direction * force, instrument=force)
            self._touches.append(touch)
        # The changes of the joint speeds in rad/s of motor angle.
        link_gains = self._coupling.to_motors(speed_gains)
        mvel, stretch, motors, tensions = [], [], [], []
        for i, motor in enumerate(self._solved):
            link_speed = self._link_speed[i] + link_gains[i]
            # The motor's speed and the rate of the cable's stretch follow from the link's speed, by
            # the equations of `drives.eliminate_motor`.
            speed = (motor.known_torque + motor.coupling * link_speed) * motor.inverse
            rate = motor.stretch_rate - motor.resistance * motor.inverse * link_gains[i]
            mvel.append(speed)
            stretch.append(state.stretch[i] + self.dt * rate)
            motors.append(drives.advance_angle(state.motors[i], self.dt * speed))
            tensions.append(self._springs[i].tension(transmission.CABLE_PER_MOTOR[i], rate))
        intact = state.intact
        if intact is not None:
            overloaded = Vec(tensions).map(
                lambda tension, strength: jnp.abs(tension) > strength, self.params.cable_strength
            )
            intact = intact.map(lambda whole, over: jnp.where(over, 0.0, whole), overloaded)
        self.state = replace(
            state,
            motors=tuple(motors),
            stretch=Vec(stretch),
            mvel=Vec(mvel),
            jvel=state.jvel + speed_gains,
            intact=intact,
        )
        self._tensions.append(Vec(tensions).map(jnp.abs))

    def end(self) -> tuple[PlantState, PlantOutput]:
        """Return state and outputs: largest tensions and mean contact forces of the substeps."""
        dtype, state = self.setup.precision.real, self.state
        state = replace(
            state,
            stretch=cast(state.stretch, dtype),
            mvel=cast(state.mvel, dtype),
            jvel=cast(state.jvel, dtype),
            brakes=self._brakes,
            intact=cast(state.intact, dtype),
            tick=state.tick + 1,
        )
        out = observe_robot(self.setup, self.arm, self.params, state, self.signal.cable_scale)
        carried = reduce(lambda a, b: a.map(jnp.maximum, b), self._tensions)
        touch = self._touches[0] if self._touches else None
        if len(self._touches) > 1:
            share = 1.0 / len(self._touches)
            touch = tree.map_leaves(lambda *forces: reduce(add, forces) * share, *self._touches)
        return state, replace(out, carried=carried, touch=touch)


def observe_robot(
    setup: RavenSetup, arm: ArmName, params: PlantParams, state: PlantState, scale: Vec = _ONES
) -> PlantOutput:
    """Return the outputs of a state, with encoder noise. scale: factor of each cable's forces."""
    scale = _cable_scale(state, scale)
    tensions = []
    for i, lever in enumerate(transmission.CABLE_PER_MOTOR):
        stiffness, stretch = _stiffness(params, i, scale[i]), lever * state.stretch[i]
        # The static tension has no damping.
        tensions.append(drives.cable_tension(stiffness, 0.0, stretch, 0.0))
    tension, dtype = Vec(tensions), setup.precision.real
    signs = transmission.encoder_signs(arm, _tool(setup, arm), setup.software)
    # `motors` contains angles from the reference, whose whole counts are `count_ref`.
    turned = Vec(drives.angle_in_radians(motor, dtype) for motor in state.motors)
    counts = Vec(motor.count for motor in state.motors) + state.count_ref
    if setup.noise:
        noisy_counts = []
        for i, count in enumerate(counts):
            draw = counter_random.random_normal(params.noise_key, state.tick, _channel(arm, i))
            noisy_counts.append(count + as_int(jnp.floor(params.encoder_noise * draw + 0.5)))
        counts = Vec(noisy_counts)
    return PlantOutput(
        enc_val=counts.map(lambda count, sign: mul(int(sign), count), signs),
        jpos=_jpos(_coupling(setup, arm, params), state, dtype),
        jvel=state.jvel,
        mpos=turned.map(
            lambda turn, count: turn + count.astype(dtype) * transmission.ENCODER_RAD,
            state.count_ref,
        ),
        mvel=state.mvel,
        stretch=state.stretch,
        tension=tension,
        carried=tension.map(jnp.abs),
        brakes=state.brakes.engaged,
    )


def true_tips(
    setup: RavenSetup,
    params: PerArm[PlantParams],
    states: PerArm[PlantState],
    robots: PerArm[PlantOutput],
) -> PerArm[Vec]:
    """Return the true tip of each arm, m in frame 0 of the arm, after the registration
    `PlantState.frame` if there is one. `params`, `states`, `robots`: one entry per arm.
    """
    return tuple(
        kinematic_errors.true_tip(arm, arm_params.kinematic_errors, state.frame, output.jpos)
        for arm, arm_params, state, output in zip(setup.arms, params, states, robots, strict=True)
    )


def _cable_scale(state: PlantState, cable_scale: Vec) -> Vec:
    """Return the remaining share of each cable's stiffness and damping; 0 for a broken cable."""
    return cable_scale if state.intact is None else cable_scale.map(mul, state.intact)


def _stiffness(params: PlantParams, i: int, scale: Scalar) -> Scalar:
    # Returns the stiffness of cable i in N/m. scale: remaining share.
    return mul(scale, params.cable_stiffness[i] * params.cable_stiffness_scale)


def _commanded_torques(
    setup: RavenSetup, arm: ArmName, params: PlantParams, state: PlantState, signal: PlantSignal
) -> Vec:
    """Return the motor torques (7, N m after the gearbox) that the DAC command causes."""
    motor = params.actuators
    signs = transmission.tau_signs(arm, _tool(setup, arm), setup.software)
    torques = []
    for i in range(N):
        per_count = motor.torque_per_count[i] * motor.gain[i] * params.motor_constant_scale
        command = mul(float(signs[i]), signal.current_cmd[i].astype(setup.precision.real))
        torque = mul(signal.torque_scale[i], per_count) * command + motor.bias[i]
        torque = drives.limit_torque(
            torque, state.mvel[i], motor.torque_limit[i], motor.stall_torque[i], motor.back_emf[i]
        )
        if setup.noise:
            channel = _channel(arm, TORQUE_CHANNEL + i)
            draw = counter_random.random_normal(params.noise_key, state.tick, channel)
            torque = torque + params.torque_noise * draw
        torques.append(torque)
    return Vec(torques)


def _jpos(coupling: Coupling, state: PlantState, dtype: str) -> Vec:
    # Returns the joints at the present motor angles and cable stretches.
    turned = Vec(drives.angle_in_radians(motor, dtype) for motor in state.motors)
    return state.jpos_ref + coupling.to_joints(turned - state.stretch)


def _coupling(setup: RavenSetup, arm: ArmName, params: PlantParams) -> Coupling:
    # Returns the coupling of the built arm, whose drums differ from the drawings.
    errors = params.kinematic_errors
    gain = Vec(add(1.0, mul(errors.scale, error)) for error in errors.ratio_error)
    return dataclasses.replace(_nominal_coupling(setup, arm), gain=gain)


def _nominal_coupling(setup: RavenSetup, arm: ArmName) -> Coupling:
    return arm_coupling(arm, _tool(setup, arm), setup.software)


def _tool(setup: RavenSetup, arm: ArmName) -> str:
    return setup.tools[setup.arms.index(arm)]


def _channel(arm: ArmName, channel: int) -> int:
    return channel + (ARM_CHANNELS if arm == "green" else 0)
