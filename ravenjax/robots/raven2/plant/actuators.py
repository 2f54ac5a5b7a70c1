"""Motors: from DAC counts to torque, and the shaft's equation of motion solved for one step.

`Im w' = drive - tau_c sgn(w) - tau_v w - reaction_scale * lambda`, with torques after the gearbox,
inertia and speed of the shaft (the authors' units, see `published`). Dry friction, and a brake as
more of it, is decided with the joint's speed of the last step; the rest is implicit, so that the
motor's speed at the end of the step is affine in the link's: `w = (momentum + coupling * T q') *
inverse`, and it can be eliminated from the links' equations.
"""

from __future__ import annotations

from typing import Annotated

from ravenjax.numbers.algebra import add, mul
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.plant.cables import Linear
from ravenjax.robots.raven2.plant.friction import OPPOSES, coulomb_damping


@record
class ActuatorParams:
    """Of seven motors."""

    torque_per_count: Annotated[
        Vec,
        Quantity(
            "N m per count",
            0,
            1,
            "motor torque after the gearbox per DAC count, magnitude",
            why="its sign is the wiring's",
        ),
    ]
    gain: Annotated[Vec, Quantity("", 0, 100, "gain error of the amplifier, times the torque")]
    bias: Annotated[
        Vec,
        Quantity(
            "N m", -100, 100, "torque of the amplifier at any command, in positive motor direction"
        ),
    ]
    inertia: Annotated[
        Vec, Quantity("kg m2", 1e-7, 1, "of rotor and gearbox", why="a rotor has some")
    ]  # Im
    coulomb: Annotated[Vec, Quantity("N m", 0, 1e3, "dry friction of the motor", why=OPPOSES)]
    viscous: Annotated[
        Vec, Quantity("N m s/rad", 0, 1e3, "viscous friction of the motor", why=OPPOSES)
    ]
    reaction_scale: Annotated[
        Vec,
        Quantity(
            "",
            0,
            100,
            "share of the cable's torque that the motor feels; 1 as published, the gearbox ratio by"
            " statics",
        ),
    ]
    torque_limit: Annotated[
        Vec,
        Quantity(
            "N m",
            0,
            1e6,
            "torque after the gearbox at the amplifier's largest current",
            why="a magnitude",
        ),
    ]
    stall_torque: Annotated[
        Vec,
        Quantity(
            "N m",
            0,
            1e6,
            "torque after the gearbox of a blocked motor at the supply voltage",
            why="a magnitude",
        ),
    ]
    back_emf: Annotated[
        Vec,
        Quantity(
            "N m s/rad",
            0,
            1e3,
            "loss of that torque with the motor's speed",
            why="a generator brakes",
        ),
    ]


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


def limited(
    torque: Scalar, speed: Scalar, torque_limit: Scalar, stall_torque: Scalar, back_emf: Scalar
) -> Scalar:
    """What amplifier and supply let a motor at `speed` (rad/s) have of a commanded `torque` (both N
    m).

    The amplifier is a current source until its current or the voltage `R i + k w` ends at a limit.
    The largest current holds, too, for a motor that is driven faster than the supply could turn it.
    """
    induced = back_emf * speed
    torque = jnp.minimum(jnp.maximum(torque, -stall_torque - induced), stall_torque - induced)
    return jnp.minimum(jnp.maximum(torque, -torque_limit), torque_limit)


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

    `inertia_rate` is Im/dt; `speed`, `link_speed` (rad/s, both in motor angle) are those at the
    start of the step.
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
