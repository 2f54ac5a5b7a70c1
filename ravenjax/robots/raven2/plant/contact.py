"""Computes contact forces of jaw tips on tissue and vessel, and of the instruments on each other.

**Tissue.** Each jaw tip is a sphere of radius R that presses into a half space (Hertz; K. L.
Johnson, Contact Mechanics, 1985, section 4.2), with the damping of Hunt and Crossley (J. Appl.
Mech. 42, 1975; for soft tissue Diolaiti, Melchiorri, Stramigioli, IEEE T-RO 21, 2005):

    F = k d^1.5 (1 + a d'),  k = 4/3 E / (1 - nu^2) sqrt(R),  nu = 0.5: soft tissue keeps its volume

d is the depth below the surface along the world's z. The force vector is F times (-dh/dx, -dh/dy,
1), where h is the surface's height. This vector is the gradient of a potential, so no path through
the tissue and back gains energy. If the tip leaves faster than 1/a, the force is 0 and never pulls.
Friction is Coulomb's, regularised below `CREEP_M_S`.

**Instruments.** An instrument is a line of two pieces, shaft and jaws, with a radius. At the point
where the two instruments are nearest, a spring and the same kind of damping push them apart. There
is no friction (*assumed*: wet polished steel). quantities.toml has the sources of the numbers.

A force F(d, d') is linearised about the depth that the present speed would reach at the end of the
step. The linear force is solved together with the other implicit forces of the step, which is the
first Newton step of backward Euler. It is stable for any stiffness, with an error of second order.
"""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, describe_fields, jnp, record, where
from ravenjax.numbers.algebra import add, dot, matvec, mul, norm, transpose
from ravenjax.robots.raven2.geometry import instrument, scene
from ravenjax.robots.raven2.setup import ArmName, PerArm

CREEP_M_S = 1e-3
"""Sliding speed (m/s) at which friction is 0.71 of Coulomb's; below it is smaller; *assumed*."""
_HERTZ = 16.0 / 9.0  # 4/3 / (1 - nu^2) with nu = 0.5


@describe_fields
@record
class ContactParams:
    """Parameters of the contact with tissue and vessel and between instruments, for all arms."""

    tissue_modulus: Scalar = 12.5e3  # Pa
    tip_radius: Scalar = 2e-3  # m
    damping: Scalar = 15.0  # s/m
    friction: Scalar = 0.2
    instrument_stiffness: Scalar = 1e4  # N/m
    instrument_damping: Scalar = 1.0  # s/m


@record
class Touch:
    """Contact forces on an instrument in a tick."""

    force: Vec  # 3, N in frame 0 of its arm, sum of all contact forces
    tissue: Scalar  # N, force of tissue and vessel
    vessel: Scalar  # N, force of the vessel alone
    instrument: Scalar  # N, force of the other instrument


class Law(NamedTuple):
    """A normal force in the coming step, and its derivative by the closing speed."""

    force: Scalar  # N
    rate: Scalar  # N s/m


def spring_law(spring: Scalar, slope: Scalar, damping: Scalar, closing: Scalar, dt: float) -> Law:
    """Return the force of a damped spring, linearised about the coming step.

    spring, slope: force (N) and stiffness (N/m) at the end of the step `dt` (s), if the closing
    speed (m/s) is constant. damping: s/m, as in F (1 + damping closing).
    """
    damping_factor = 1.0 + damping * closing
    in_contact = damping_factor > 0.0
    rate = jnp.where(in_contact, slope * dt * damping_factor + damping * spring, 0.0)
    return Law(spring * jnp.maximum(damping_factor, 0.0), rate)


class TipContact(NamedTuple):
    """The contact of a jaw tip with the tissue in the coming step."""

    tip: instrument.InstrumentPoint
    rise: Vec  # 3, direction of the force: `scene.Surface`
    vessel: Scalar  # bool, the tip is over the vessel
    normal: Law  # normal force, as a factor of `rise`
    drag: Scalar  # N s/m, friction per sliding speed
    inverse: Scalar  # 1 / |rise|^2
    velocity: Vec  # m/s, at the start of the step

    def force(self) -> Vec:
        """Return the force in N if the tip's speed does not change."""
        return self.rise * self.normal.force - self._sliding(self.velocity) * self.drag

    def after(self, gained: Vec) -> Vec:
        """Return the force (N) in the step. gained: speed gains of the joints, rad/s and m/s."""
        change = self.tip.velocity(gained)
        normal = jnp.maximum(self.normal.force - self.normal.rate * dot(self.rise, change), 0.0)
        return self.rise * normal - self._sliding(self.velocity + change) * self.drag

    def stiffen(self, system: list[list[Scalar]]) -> None:
        """Add J^T A J to the lower triangle. A: loss of force per gain of tip speed, N s/m."""
        columns, along = self.tip.columns, self.tip.project_on_joints(self.rise)
        normal_rate = self.normal.rate - self.drag * self.inverse
        for i, column in enumerate(columns):
            normal_part = mul(normal_rate, along[i])
            friction_part = column.map(lambda x: mul(self.drag, x))
            for j in range(i + 1):
                added = add(mul(normal_part, along[j]), dot(friction_part, columns[j]))
                system[i][j] = add(system[i][j], added)

    def _sliding(self, velocity: Vec) -> Vec:
        return velocity - self.rise * (dot(self.rise, velocity) * self.inverse)


def jaw_tips(
    arm: ArmName, params: ContactParams, jpos: Vec, jvel: Vec, dt: float
) -> tuple[TipContact, ...]:
    """Return both jaw tips at `jpos` (7, rad and m) and `jvel` over the coming `dt` (s)."""

    def touch(tip: instrument.InstrumentPoint) -> TipContact:
        # Computes the contact of one tip: a damped Hertz contact with dry friction.
        surface, velocity = scene.tissue_surface(arm, tip.position), tip.velocity(jvel)
        rise = surface.rise
        closing = -dot(rise, velocity)
        depth = jnp.maximum(surface.depth + closing * dt, 0.0)
        root = jnp.sqrt(depth)
        k = (_HERTZ * params.tissue_modulus) * jnp.sqrt(params.tip_radius)  # N/m^1.5
        normal = spring_law(k * depth * root, 1.5 * k * root, params.damping, closing, dt)
        steep = dot(rise, rise)
        inverse = 1.0 / steep
        sliding = jnp.maximum(dot(velocity, velocity) - closing * closing * inverse, 0.0)
        level = params.friction * normal.force
        drag = level * jnp.sqrt(steep / (sliding + CREEP_M_S**2))
        return TipContact(tip, rise, surface.vessel, normal, drag, inverse, velocity)

    return tuple(map(touch, instrument.jaw_tips(arm, jpos)))


def contact_forces(contacts: tuple[TipContact, ...], gained: Vec) -> Touch:
    """Return the forces of the tissue in a step. gained: speed gains of the joints, rad/s, m/s."""
    forces = [tip.after(gained) for tip in contacts]
    total = forces[0] + forces[1]
    on_vessel = [
        force.map(lambda x, tip=tip: jnp.where(tip.vessel, x, 0.0))
        for tip, force in zip(contacts, forces, strict=True)
    ]
    return Touch(total, norm(total), norm(on_vessel[0] + on_vessel[1]), total[0] * 0.0)


# --- instruments against each other ---


class Meeting(NamedTuple):
    """The contact of two instruments at their nearest points, in the coming step."""

    ways: Sequence[Vec]  # 7 per arm: separation speed of the points per unit speed of each joint
    normal: Law
    apart: Sequence[Vec]  # 3 each, direction of the force in frame 0 of each arm, a unit vector

    def solved(self, gained: Sequence[Vec], yielding: Sequence[Vec]) -> Scalar:
        """Return the force in the step in N, at least 0.

        gained: speed gains of each arm's joints under `normal.force`. yielding: gains per N.
        """
        gain = dot(self.ways[0], gained[0]) + dot(self.ways[1], gained[1])
        yield_speed = dot(self.ways[0], yielding[0]) + dot(self.ways[1], yielding[1])
        rate = self.normal.rate
        return jnp.maximum(self.normal.force - rate * gain / (1.0 + rate * yield_speed), 0.0)


def instruments_meeting(
    arms: Sequence[ArmName], params: ContactParams, jpos: PerArm[Vec], jvel: PerArm[Vec], dt: float
) -> Meeting:
    """Return the contact of two instruments in the coming `dt` (s). jpos, jvel: 7 per arm."""
    lines = tuple(map(instrument.instrument_line, arms, jpos))
    pairs = itertools.starmap(_nearest, itertools.product(*map(_pieces, arms, lines)))
    best = functools.reduce(lambda a, b: where(b.depth > a.depth, b, a), pairs)
    apart = best.away * (1.0 / jnp.maximum(best.distance, 1e-9))
    joint_speeds, directions = [], []
    for i, sign in enumerate((1.0, -1.0)):
        origin, rotation = scene.frame0_in_world(arms[i])
        inverse_rotation = transpose(rotation)
        at = matvec(inverse_rotation, best.at[i] - origin)
        direction = matvec(inverse_rotation, apart * sign)
        point = instrument.line_point(arms[i], lines[i], at, best.beyond[i])
        joint_speeds.append(point.project_on_joints(direction))
        directions.append(direction)
    closing = -(dot(joint_speeds[0], jvel[0]) + dot(joint_speeds[1], jvel[1]))
    depth = jnp.maximum(best.depth + closing * dt, 0.0)
    k = params.instrument_stiffness
    slope = jnp.where(depth > 0.0, k, 0.0)
    normal = spring_law(k * depth, slope, params.instrument_damping, closing, dt)
    return Meeting(joint_speeds, normal, directions)


class _Piece(NamedTuple):
    """A straight piece of an instrument, in the world."""

    begin: Vec  # m
    way: Vec  # m, vector to its end
    radius: float  # m
    jaws: bool


class _Pair(NamedTuple):
    """The nearest points of two pieces."""

    depth: Scalar  # m, overlap of the pieces; negative: their distance
    distance: Scalar  # m, distance between their axes
    away: Vec  # m, vector from the axis of the second to the axis of the first
    at: tuple[Vec, Vec]  # m, the point on each axis, world
    beyond: tuple[Scalar, Scalar]  # for each, 0 on a shaft; on jaws the fraction from wrist to end


def _pieces(arm: ArmName, line: instrument.InstrumentLine) -> tuple[_Piece, _Piece]:
    # Returns shaft and jaws of an instrument as straight pieces in the world.
    origin, _ = scene.frame0_in_world(arm)
    wrist, end = scene.to_world(arm, line.wrist), scene.to_world(arm, line.end)
    return (
        _Piece(origin, wrist - origin, instrument.SHAFT_RADIUS, False),
        _Piece(wrist, end - wrist, instrument.JAW_RADIUS, True),
    )


def _nearest(first: _Piece, second: _Piece) -> _Pair:
    """Return the nearest points (C. Ericson, Real-Time Collision Detection, 2005, 5.1.9)."""
    between = first.begin - second.begin
    a, b, e = dot(first.way, first.way), dot(first.way, second.way), dot(second.way, second.way)
    c, f = dot(first.way, between), dot(second.way, between)
    s = _clamp_share((b * f - c * e) / jnp.maximum(a * e - b * b, 1e-12))
    t = _clamp_share((b * s + f) / e)
    s = _clamp_share((b * t - c) / a)
    points = first.begin + first.way * s, second.begin + second.way * t
    away = points[0] - points[1]
    distance = norm(away)
    beyond = s if first.jaws else s * 0.0, t if second.jaws else t * 0.0
    return _Pair(first.radius + second.radius - distance, distance, away, points, beyond)


def _clamp_share(x: Scalar) -> Scalar:
    return jnp.minimum(jnp.maximum(x, 0.0), 1.0)
