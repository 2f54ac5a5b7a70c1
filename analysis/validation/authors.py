"""Implements the authors' dynamic model of the gold arm's first three joints, exactly as published,
for regression tests.

Source: CSLDepend/raven2_sim, Li_DYN/two_arm_dyn.cpp. The model has 12 states, explicit Euler or
Runge-Kutta 4 at 1 ms, no cable coupling between joints, joint zeros at m/TR - pi, and `sgn(0) = 0`.
Its third motor uses the cable tension of the *first* (a bug, enabled by `tension_bug`, off by
default). It is not part of the virtual robot: see `robot`.
"""

import math
from collections.abc import Callable, Sequence

from ravenjax.numbers.algebra import solve_spd
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.plant import parameter_sets

GEARBOX = 12.25
PI = 3.141592654  # value in the source's cable law
CAPSTAN_M = 5.675e-3  # m
LINK_RADIUS = (63.095e-3, 56.298e-3, 1.0)  # m, m, 1
JOINT_PER_MOTOR = (
    0.007342345766264,
    0.008228805750159,
    0.000463265306122,
)  # rad/rad, rad/rad, m/rad at start-up
GRAVITY_TERMS = (
    0.03541124607,
    -0.02971000684,
    1.223025927,
    3.146266896,
)  # coefficients of cos q1: 1, c2, s2, d s2
GRAVITY_TERMS_SIN = (
    -2.144340615,
    -2.374374248,
    0.3165424025,
    0.8143137936,
    0.0076895156,
)  # coefficients of sin q1: 1 d c2 d*c2 s2

# Coefficients of 1, d, d^2 that multiply 1, cos q2, sin q2, cos^2 q2 and sin q2 cos q2 in M11, and
# of the first three
# in M12 and M13. The same numbers as the source's long expressions, collected (equal to 1e-14).
M11 = (
    (0.153290462213, -0.000903448411537, 0.39666594362),
    (0.00474290752, -0.000819170043606, -0.09872759015),
    (2.92972132002e-5, 1.88590928356e-5, 0.0),
    (-0.05326253228, 0.0071349309426, -0.2358013319),
    (0.000352661280003, 9.00862504959e-5, 0.0),
)
M12 = (
    (0.016308701908, -0.00197923995, 0.06541162346),
    (0.009162593725, -0.001582515003, -0.1907270582),
    (5.65978698199e-5, 3.64329696702e-5, 0.0),
)
M13 = (-1.249502675e-5, 3.643296967e-5, -0.007353578204)
M22 = (0.06301198548, -0.007647195937, 0.2527311058)
M23 = -4.827707615e-5
M33 = 0.407


@record
class AuthorsState:
    """Link and motor states of the gold arm, in the authors' joint convention."""

    q: Vec  # rad, rad, m
    qd: Vec  # rad/s, rad/s, m/s
    m: Vec  # rad
    md: Vec  # rad/s


@record
class Detail:
    """Intermediate results of the equations."""

    tension: Vec  # N, gamma
    reaction: Vec  # N m
    motor_friction: Vec  # N m
    motor_torque: Vec  # N m, u
    link_torque: Vec  # N m, N m, N
    bias: Vec  # N m, N m, N: Coriolis and gravity


@record
class Rates:
    """Time derivative of `AuthorsState`."""

    q: Vec
    qd: Vec
    m: Vec
    md: Vec


def mass_matrix(q: Vec) -> tuple[Vec, ...]:
    """Return M(q), 3 x 3, kg m2 (insertion kg)."""
    c2, s2, d = jnp.cos(q[1]), jnp.sin(q[1]), q[2]
    m11 = _sum(
        _poly(row, d) * shape
        for row, shape in zip(M11, (1.0, c2, s2, c2 * c2, s2 * c2), strict=True)
    )
    m12 = _sum(_poly(row, d) * shape for row, shape in zip(M12, (1.0, c2, s2), strict=True))
    m13 = M13[0] + M13[1] * c2 + M13[2] * s2
    return (Vec((m11, m12, m13)), Vec((m12, _poly(M22, d), M23)), Vec((m13, M23, M33)))


def bias_forces(q: Vec, qd: Vec) -> Vec:
    """Return Coriolis (Christoffel symbols of M) and gravity forces, N m and N."""
    c2, s2, d = jnp.cos(q[1]), jnp.sin(q[1]), q[2]
    d11_2 = _sum(
        _poly(row, d) * slope
        for row, slope in zip(M11, (0.0, -s2, c2, -2.0 * c2 * s2, c2 * c2 - s2 * s2), strict=True)
    )
    d11_3 = _sum(
        _slope(row, d) * shape
        for row, shape in zip(M11, (1.0, c2, s2, c2 * c2, s2 * c2), strict=True)
    )
    d12_2 = _sum(_poly(row, d) * slope for row, slope in zip(M12, (0.0, -s2, c2), strict=True))
    d12_3 = _sum(_slope(row, d) * shape for row, shape in zip(M12, (1.0, c2, s2), strict=True))
    d13_2 = -M13[1] * s2 + M13[2] * c2
    d22_3 = _slope(M22, d)
    v1, v2, v3 = qd
    coriolis = (
        d11_2 * v1 * v2 + d11_3 * v1 * v3 + d12_2 * v2 * v2 + (d12_3 + d13_2) * v2 * v3,
        -0.5 * d11_2 * v1 * v1 + (d12_3 - d13_2) * v1 * v3 + d22_3 * v2 * v3,
        -0.5 * d11_3 * v1 * v1 + (d13_2 - d12_3) * v1 * v2 - 0.5 * d22_3 * v2 * v2,
    )
    return Vec(coriolis) + gravity_forces(q)


def gravity_forces(q: Vec) -> Vec:
    """Return the gradient of the potential, N m and N, for gravity of 9.81 m/s2 along -x of frame
    0.
    """
    c1, s1, c2, s2, d = jnp.cos(q[0]), jnp.sin(q[0]), jnp.cos(q[1]), jnp.sin(q[1]), q[2]
    a, b = GRAVITY_TERMS, GRAVITY_TERMS_SIN
    of_cos = a[0] + a[1] * c2 + a[2] * s2 + a[3] * d * s2
    of_sin = b[0] + b[1] * d + b[2] * c2 + b[3] * d * c2 + b[4] * s2
    return Vec(
        (
            -s1 * of_cos + c1 * of_sin,
            c1 * (-a[1] * s2 + a[2] * c2 + a[3] * d * c2)
            + s1 * (-b[2] * s2 - b[3] * d * s2 + b[4] * c2),
            c1 * a[3] * s2 + s1 * (b[1] + b[3] * c2),
        )
    )


def initial(mpos: Vec, mvel: Vec) -> AuthorsState:
    """Return the state at the first message: links from measured motors (rad, rad/s), cables
    unstretched, no coupling.
    """
    q = mpos.map(lambda m, ratio: m * ratio, Vec(JOINT_PER_MOTOR)) - Vec((math.pi, math.pi, 0.0))
    return AuthorsState(
        q=q, qd=mvel.map(lambda m, ratio: m * ratio, Vec(JOINT_PER_MOTOR)), m=mpos, md=mvel
    )


def rates(
    state: AuthorsState, dac: Vec, tension_bug: bool = False, parameter_set: str = "traj3"
) -> tuple[Rates, Detail]:
    """Return the right-hand side for DAC counts in the gold arm's sign (positive drives a motor
    backwards).
    """
    values = parameter_sets.parameter_set(parameter_set)
    motor = values.actuators
    zero = (PI, PI, 0.0)
    tension, friction, torque = [], [], []
    for i in range(3):
        radius = LINK_RADIUS[i]
        delta = (state.m[i] / GEARBOX) * CAPSTAN_M - (state.q[i] + zero[i]) * radius
        stretch_rate = (state.md[i] / GEARBOX) * CAPSTAN_M - state.qd[i] * radius
        spring = values.cable_stiffness[i] * (jnp.exp(delta) - jnp.exp(-delta))
        tension.append(spring + 2.0 * values.cable_damping[i] * stretch_rate)
        friction.append(motor.coulomb[i] * jnp.sign(state.md[i]) + motor.viscous[i] * state.md[i])
        torque.append(motor.torque_per_count[i] * dac[i] * motor.gain[i] - motor.bias[i])
    reaction = Vec(CAPSTAN_M * gamma / GEARBOX for gamma in tension)
    if tension_bug:
        reaction = reaction.replace(2, CAPSTAN_M * tension[0] / GEARBOX)
    link_torque = Vec(gamma * radius for gamma, radius in zip(tension, LINK_RADIUS, strict=True))
    bias = bias_forces(state.q, state.qd)
    link_friction = Vec(
        values.link_viscous[i] * state.qd[i] + values.link_coulomb[i] * jnp.sign(state.qd[i])
        for i in range(3)
    )
    qdd = solve_spd(mass_matrix(state.q), link_torque - link_friction - bias)
    mdd = Vec((-torque[i] - friction[i] - reaction[i]) / motor.inertia[i] for i in range(3))
    detail = Detail(Vec(tension), reaction, Vec(friction), Vec(torque), link_torque, bias)
    return Rates(q=state.qd, qd=qdd, m=state.md, md=mdd), detail


def list_steps(steps: int) -> tuple[Callable[[AuthorsState], AuthorsState], AuthorsState]:
    """Return a function that makes this many Euler steps at 1 ms, as published, and a start."""
    from jax import lax

    command = Vec.full(3, jnp.float64(0.0))
    rest = Vec(jnp.float64(m) for m in (50.0, 100.0, 800.0)), Vec.full(3, jnp.float64(0.0))

    def advance(start: AuthorsState) -> AuthorsState:
        return lax.fori_loop(0, steps, lambda _, now: euler(now, command, tension_bug=True), start)

    return advance, initial(*rest)


def euler(
    state: AuthorsState, dac: Vec, dt: float = 1e-3, tension_bug: bool = False
) -> AuthorsState:
    """Compute one explicit Euler step."""
    slope, _ = rates(state, dac, tension_bug)
    return _along(state, slope, dt)


def _along(state: AuthorsState, slope: Rates, dt: float) -> AuthorsState:
    return AuthorsState(
        q=state.q + slope.q * dt,
        qd=state.qd + slope.qd * dt,
        m=state.m + slope.m * dt,
        md=state.md + slope.md * dt,
    )


def _poly(coefficients: Sequence[float], d: Scalar) -> Scalar:
    return coefficients[0] + d * (coefficients[1] + d * coefficients[2])


def _slope(coefficients: Sequence[float], d: Scalar) -> Scalar:
    return coefficients[1] + (2.0 * coefficients[2]) * d


def _sum(terms) -> Scalar:
    total, *rest = terms
    for term in rest:
        total = total + term
    return total
