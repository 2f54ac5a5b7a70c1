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

**Time step.** Forces are implicit: one Newton step of backward Euler, which is stable for any
stiffness, with an error of second order. To this end, a force F(d, d') is linearised about the
depth that is predicted for the end of the time step from the present speed of the tip.
"""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, clamp, describe_fields, jnp, record, where
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


class NormalForce(NamedTuple):
    """A normal force in the coming step, as a linear function of the closing speed."""

    force: Scalar  # N, at the present closing speed
    rate: Scalar  # N s/m, derivative by the closing speed


def damped_spring(
    spring: Scalar, stiffness: Scalar, damping: Scalar, closing: Scalar, dt: float
) -> NormalForce:
    """Return the force `spring * (1 + damping * closing)`, at least 0, linearised for a step.
    closing: present closing speed, m/s. spring, stiffness: undamped force (N) and its derivative by
    depth (N/m), at the depth that this speed causes at the end of the step `dt` (s). damping: s/m.
    `rate` of the result, the derivative by the closing speed, has two terms, because the speed
    changes both the depth, by closing dt, and the damping factor.
    """
    damping_factor = 1.0 + damping * closing
    rate = jnp.where(damping_factor > 0.0, stiffness * dt * damping_factor + damping * spring, 0.0)
    return NormalForce(spring * jnp.maximum(damping_factor, 0.0), rate)


class TipContact(NamedTuple):
    """The contact of a jaw tip with the tissue in the coming step."""

    tip: instrument.InstrumentPoint
    rise: Vec  # 3, direction of the force: `scene.Surface`
    vessel: Scalar  # bool, the tip is over the vessel
    normal: NormalForce  # as a factor of `rise`
    drag: Scalar  # N s/m, friction per sliding speed
    inverse_square: Scalar  # 1 / |rise|^2
    velocity: Vec  # m/s, at the start of the step

    def present_force(self) -> Vec:
        """Return the force (3, N) in the step if the tip's speed does not change."""
        return self.rise * self.normal.force - self._sliding(self.velocity) * self.drag

    def force(self, speed_gains: Vec) -> Vec:
        """Return the force (3, N) in the step. speed_gains: changes of joint speeds, rad/s, m/s."""
        change = self.tip.velocity(speed_gains)
        normal = jnp.maximum(self.normal.force - self.normal.rate * dot(self.rise, change), 0.0)
        # Friction is `drag` times the sliding velocity.
        return self.rise * normal - self._sliding(self.velocity + change) * self.drag

    def add_damping(self, system: list[list[Scalar]]) -> None:
        """Add J^T A J to `system`, the lower triangle of the equations of the joints.
        J: Jacobian of the tip. A: loss of contact force per gain of tip speed, N s/m. With r =
        `rise`, A = normal.rate r r^T + drag (I - r r^T / |r|^2), because friction acts along the
        surface. The code adds the terms with r r^T, whose factor is `normal_rate`, and drag I.
        """
        columns, rise_speeds = self.tip.columns, self.tip.project_on_joints(self.rise)
        normal_rate = self.normal.rate - self.drag * self.inverse_square
        for i, column in enumerate(columns):
            normal_part = mul(normal_rate, rise_speeds[i])
            friction_part = column.map(lambda x: mul(self.drag, x))
            for j in range(i + 1):
                damping = add(mul(normal_part, rise_speeds[j]), dot(friction_part, columns[j]))
                system[i][j] = add(system[i][j], damping)

    def _sliding(self, velocity: Vec) -> Vec:
        # Returns the part of the velocity along the surface.
        return velocity - self.rise * (dot(self.rise, velocity) * self.inverse_square)


def jaw_tips(
    arm: ArmName, params: ContactParams, jpos: Vec, jvel: Vec, dt: float
) -> tuple[TipContact, ...]:
    """Return the contacts of both jaw tips with the tissue in the coming `dt` (s)."""

    def find_contact(tip: instrument.InstrumentPoint) -> TipContact:
        # Computes the contact of one tip: dry friction, and the damped force k depth^1.5 of Hertz.
        surface, velocity = scene.tissue_surface(arm, tip.position), tip.velocity(jvel)
        # The normal (-dh/dx, -dh/dy, 1) of the surface of height h. Its length |rise| is not 1.
        rise = surface.rise
        closing = -dot(rise, velocity)
        depth = jnp.maximum(surface.depth + closing * dt, 0.0)
        root = jnp.sqrt(depth)
        k = (_HERTZ * params.tissue_modulus) * jnp.sqrt(params.tip_radius)  # N/m^1.5
        normal = damped_spring(k * depth * root, 1.5 * k * root, params.damping, closing, dt)
        square = dot(rise, rise)
        inverse_square = 1.0 / square
        # Squares of speeds: sliding^2 = speed^2 - normal^2. The normal speed is closing / |rise|.
        sliding2 = jnp.maximum(dot(velocity, velocity) - closing * closing * inverse_square, 0.0)
        # The force of friction is params.friction |rise| normal.force. `drag` is this force divided
        # by the sliding speed, which CREEP_M_S keeps from being 0.
        coulomb = params.friction * normal.force
        drag = coulomb * jnp.sqrt(square / (sliding2 + CREEP_M_S**2))
        return TipContact(tip, rise, surface.vessel, normal, drag, inverse_square, velocity)

    return tuple(map(find_contact, instrument.jaw_tips(arm, jpos)))


def contact_forces(contacts: tuple[TipContact, ...], speed_gains: Vec) -> Touch:
    """Return the forces of tissue and vessel. speed_gains: changes of joint speeds, rad/s, m/s."""
    forces = [tip.force(speed_gains) for tip in contacts]
    total = forces[0] + forces[1]
    on_vessel = [
        force.map(lambda x, tip=tip: jnp.where(tip.vessel, x, 0.0))
        for tip, force in zip(contacts, forces, strict=True)
    ]
    tissue, vessel = norm(total), norm(on_vessel[0] + on_vessel[1])
    # `_ArmTick.move` adds the force of the other instrument. Here it is a 0 of the same type.
    return Touch(force=total, tissue=tissue, vessel=vessel, instrument=total[0] * 0.0)


class InstrumentContact(NamedTuple):
    """The contact of two instruments at their nearest points, in the coming step."""

    separation_rows: Sequence[Vec]  # 7 per arm: separation speed of the points per joint speed
    normal: NormalForce
    directions: Sequence[Vec]  # unit vector of the force on each arm, in frame 0 of this arm

    def force(self, speed_gains: Sequence[Vec], gains_per_newton: Sequence[Vec]) -> Scalar:
        """Return the force in the step in N, at least 0.
        speed_gains: changes of each arm's joint speeds under `normal.force`. gains_per_newton:
        additional changes for each newton of additional force. The result solves force =
        normal.force - rate (separation + yielding (force - normal.force)). separation: gain of the
        points' separation speed under `normal.force`. yielding: gain for each additional newton.
        """
        first, second = self.separation_rows
        separation = dot(first, speed_gains[0]) + dot(second, speed_gains[1])
        yielding = dot(first, gains_per_newton[0]) + dot(second, gains_per_newton[1])
        rate = self.normal.rate
        return jnp.maximum(self.normal.force - rate * separation / (1.0 + rate * yielding), 0.0)


def find_instrument_contact(
    arms: Sequence[ArmName], params: ContactParams, jpos: PerArm[Vec], jvel: PerArm[Vec], dt: float
) -> InstrumentContact:
    """Return the contact of two instruments where they overlap most, in the coming `dt` (s)."""
    lines = tuple(map(instrument.instrument_line, arms, jpos))
    pairs = itertools.starmap(_nearest_points, itertools.product(*map(_pieces, arms, lines)))
    pair = functools.reduce(lambda a, b: where(b.depth > a.depth, b, a), pairs)
    # The lower bound avoids a division by zero if the axes intersect.
    unit_separation = pair.separation * (1.0 / jnp.maximum(pair.distance, 1e-9))
    separation_rows, directions = [], []
    # `separation` points toward the first instrument: the second is pushed in the other direction
    for i, sign in enumerate((1.0, -1.0)):
        origin, rotation = scene.frame0_in_world(arms[i])
        inverse_rotation = transpose(rotation)
        position = matvec(inverse_rotation, pair.points[i] - origin)
        direction = matvec(inverse_rotation, unit_separation * sign)
        # A row contains the speed of separation per unit speed of each joint.
        point = instrument.line_point(arms[i], lines[i], position, pair.jaw_shares[i])
        separation_rows.append(point.project_on_joints(direction))
        directions.append(direction)
    closing = -(dot(separation_rows[0], jvel[0]) + dot(separation_rows[1], jvel[1]))
    depth = jnp.maximum(pair.depth + closing * dt, 0.0)
    k = params.instrument_stiffness
    stiffness = jnp.where(depth > 0.0, k, 0.0)
    normal = damped_spring(k * depth, stiffness, params.instrument_damping, closing, dt)
    return InstrumentContact(separation_rows, normal, directions)


class _Piece(NamedTuple):
    """A straight piece of an instrument, in the world."""

    begin: Vec  # m
    axis: Vec  # m, vector from begin to end
    radius: float  # m
    is_jaws: bool  # False: the piece is the shaft


class _Pair(NamedTuple):
    """The nearest points of two pieces."""

    depth: Scalar  # m, overlap of the pieces; negative: their distance
    distance: Scalar  # m, distance between their axes
    separation: Vec  # m, vector from the axis of the second to the axis of the first
    points: tuple[Vec, Vec]  # m, the point on each axis, world
    jaw_shares: tuple[Scalar, Scalar]  # of each point, from wrist (0) to end (1); 0 on a shaft


def _pieces(arm: ArmName, line: instrument.InstrumentLine) -> tuple[_Piece, _Piece]:
    # Returns shaft and jaws of an instrument as straight pieces in the world.
    origin, _ = scene.frame0_in_world(arm)
    wrist, end = scene.to_world(arm, line.wrist), scene.to_world(arm, line.end)
    return (
        _Piece(origin, wrist - origin, instrument.SHAFT_RADIUS, False),
        _Piece(wrist, end - wrist, instrument.JAW_RADIUS, True),
    )


def _nearest_points(first: _Piece, second: _Piece) -> _Pair:
    """Return the nearest points of two axes: begin + s axis of the first piece, begin + t axis of
    the second. The names are those of C. Ericson, Real-Time Collision Detection, 5.1.9.
    """
    r = first.begin - second.begin
    d1, d2 = first.axis, second.axis
    a, b, e = dot(d1, d1), dot(d1, d2), dot(d2, d2)
    c, f = dot(d1, r), dot(d2, r)
    # The lower bound avoids a division by zero if the axes are parallel.
    s = clamp((b * f - c * e) / jnp.maximum(a * e - b * b, 1e-12), 0.0, 1.0)
    t = clamp((b * s + f) / e, 0.0, 1.0)
    # If t was clamped, another s is nearest.
    s = clamp((b * t - c) / a, 0.0, 1.0)
    points = first.begin + d1 * s, second.begin + d2 * t
    separation = points[0] - points[1]
    distance = norm(separation)
    # Jaws begin at the wrist, so s and t are also the shares of the way from wrist to end.
    jaw_shares = (s if first.is_jaws else s * 0.0), (t if second.is_jaws else t * 0.0)
    return _Pair(first.radius + second.radius - distance, distance, separation, points, jaw_shares)
