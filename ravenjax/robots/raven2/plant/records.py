"""Records of one arm's plant: what a campaign may vary, what goes on from tick to tick, what
goes in and comes out.
"""

from __future__ import annotations

from typing import Annotated

from ravenjax.numbers.quantity import Quantity, Reserved
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.plant import (
    actuators,
    brakes,
    contact,
    encoders,
    kinematic_errors,
    stops,
)
from ravenjax.robots.raven2.plant.friction import OPPOSES
from ravenjax.robots.raven2.plant.registration import Registration


@record
class PlantParams:
    """Of one arm. Every number may vary from run to run."""

    actuators: actuators.ActuatorParams
    brakes: brakes.BrakeParams
    cable_stiffness: Annotated[  # ke
        Vec,
        Quantity(
            "N/m",
            100,
            1e8,
            "stiffness of each cable",
            why="an unbroken cable holds the arm at rest; break it by a fault",
        ),
    ]
    cable_damping: Annotated[  # be
        Vec, Quantity("N s/m", 0, 1e6, "damping of each cable", why="damping takes energy")
    ]
    cable_strength: Annotated[  # see `cables`; read where Setup.cables is not "unwatched"
        Vec,
        Quantity(
            "N",
            1,
            1e7,
            "tension above which each cable is overloaded",
            why="a cable carries something",
            read_when=("parameter_set", "power_consistent"),
        ),
    ]
    link_coulomb: Annotated[
        Vec, Quantity("N m; insertion N", 0, 1e3, "dry friction of the joint", why=OPPOSES)
    ]
    link_viscous: Annotated[
        Vec,
        Quantity(
            "N m s/rad; insertion N s/m", 0, 1e3, "viscous friction of the joint", why=OPPOSES
        ),
    ]
    stops: stops.StopParams
    kinematic_errors: kinematic_errors.KinematicErrors
    friction_scale: Annotated[
        Scalar, Quantity("", 0, 100, "times all friction of motors and joints", why=OPPOSES)
    ]
    cable_stiffness_scale: Annotated[
        Scalar,
        Quantity(
            "",
            0.05,
            100,
            "times the stiffness of every cable",
            why="an unbroken cable holds the arm; break one by a fault",
        ),
    ]
    motor_constant_scale: Annotated[
        Scalar, Quantity("", 0, 100, "times torque per count of every motor")
    ]
    mass_scale: Annotated[
        Scalar,
        Quantity(
            "", 0.01, 100, "times masses and inertias of the links", why="masses are positive"
        ),
    ]
    gravity: Annotated[
        Vec, Quantity("m/s2", -100, 100, "acceleration of gravity in frame 0 of the arm")
    ]  # 3
    encoder_noise: Annotated[
        Scalar,
        Quantity(
            "counts rms",
            0,
            1e4,
            "noise of the encoders; read where campaign.noise is on",
            why="a standard deviation",
        ),
    ]
    torque_noise: Annotated[
        Scalar,
        Quantity(
            "N m rms",
            0,
            100,
            "noise of the motor torques after the gearbox; read where campaign.noise is on",
            why="a standard deviation",
        ),
    ]
    noise_key: Annotated[  # uint32; a run and its golden run share it
        Scalar,
        Reserved(
            "it is derived from each run's id, so that no two runs draw the same noise; set"
            " campaign.noise = true, and campaign.seed or repeats for other draws"
        ),
    ]


@record
class PlantState:
    motors: tuple[encoders.Angle, ...]  # seven, from the reference count
    stretch: Vec  # rad of motor angle, cable stretch m - T q
    mvel: Vec  # rad/s
    jvel: Vec  # rad/s; insertion m/s
    brakes: brakes.BrakeState
    intact: Vec | None  # 1: whole, 0: the cable has parted; where Setup.cables is "break"
    tick: Scalar  # ms, int32: counter of the noise
    # joints at the reference counts with unstretched cables, rad; insertion m; constant in a run
    jpos_ref: Vec
    count_ref: Vec  # counts, int32, whole motor counts at the reference; constant in a run
    frame: Registration | None  # of the true arm; constant in a run; None: as its software believes


@record
class PlantSignal:
    current_cmd: Vec  # DAC counts as written to USB, int32
    brakes: Scalar  # 1: brakes commanded on, int32 or bool
    torque_scale: Vec  # 1, nominally 1.0: times each motor's constant
    cable_scale: Vec  # 1, nominally 1.0: times stiffness and damping of each cable
    friction_scale: Vec  # 1, nominally 1.0: times friction of each motor and link
    external_torque: Vec  # N m; insertion N, nominally 0.0: load on each joint


@record
class PlantOutput:
    enc_val: Vec  # counts, int32, as unpacked from USB
    jpos: Vec  # rad; insertion m, of the links
    jvel: Vec  # rad/s; insertion m/s
    mpos: Vec  # rad, of the motor shafts
    mvel: Vec  # rad/s
    stretch: Vec  # rad of motor angle
    tension: Vec  # N, tension difference of each cable at rest in this stretch
    # N, largest magnitude of each cable's tension difference in this tick, its damping included
    carried: Vec
    brakes: Scalar  # 1: brakes grip, int32
    touch: contact.Touch | None = None  # in this tick; where there is contact
