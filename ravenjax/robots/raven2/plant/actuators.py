"""Motors: from DAC counts to torque, and the shaft's equation of motion solved for one step.

`Im w' = drive - tau_c sgn(w) - tau_v w - reaction_scale * lambda`, with torques after the gearbox, inertia and speed
of the shaft (the authors' units, see `published`). Dry friction, and a brake as more of it, is decided with the
joint's speed of the last step; the rest is implicit, so that the motor's speed at the end of the step is affine in
the link's: `w = (momentum + coupling * T q') * inverse`, and it can be eliminated from the links' equations.
"""

from __future__ import annotations

from ravenjax.numbers.algebra import add, mul
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.plant.cables import Linear
from ravenjax.robots.raven2.plant.friction import coulomb_damping


@record
class Params:
    """Of seven motors."""

    torque_per_count: Vec  # N m after gearbox per DAC count, magnitude
    gain: Vec  # 1, amplifier gain error
    bias: Vec  # N m in positive motor direction, at any command
    inertia: Vec  # kg m2, Im
    coulomb: Vec  # N m
    viscous: Vec  # N m s/rad
    reaction_scale: Vec  # 1, cable torque that the motor feels: 1 as the authors have it, the gearbox ratio by statics


@record
class Eliminated:
    """One motor with its cable, as the links see it in this step."""

    momentum: Scalar  # N m, drive and inertia over the step
    coupling: Scalar  # N m s/rad, reaction per link speed
    inverse: Scalar  # rad/s per N m
    resistance: Scalar  # N m s/rad, all but the cable
    force: Scalar  # N m on the joints (motor coordinates) if the links keep their speed
    stretch_rate: Scalar  # rad/s if the links keep their speed
    stiffening: Scalar  # N m s/rad, loss of that force per gain of link speed


def eliminate(
    inertia_rate: Scalar,
    viscous: Scalar,
    coulomb: Scalar,
    reaction_scale: Scalar,
    drive: Scalar,
    speed: Scalar,
    link_speed: Scalar,
    cable: Linear,
) -> Eliminated:
    """Solve one motor's step for its link's speed.

    `inertia_rate` is Im/dt; `speed`, `link_speed` (rad/s, both in motor angle) are those at the start of the step.
    """
    coupling = mul(reaction_scale, cable.damping)
    push = inertia_rate * speed + drive - mul(reaction_scale, cable.force)
    rate = add(inertia_rate, viscous)
    stick = coulomb_damping(coulomb, push + coupling * link_speed, rate + coupling)
    resistance = rate + stick
    inverse = 1.0 / (resistance + coupling)
    stretch_rate = (push - resistance * link_speed) * inverse
    return Eliminated(
        momentum=push,
        coupling=coupling,
        inverse=inverse,
        resistance=resistance,
        force=cable.force + cable.damping * stretch_rate,
        stretch_rate=stretch_rate,
        stiffening=cable.damping * resistance * inverse,
    )
