"""The Raven-II: one folder that declares arms, joints, sites and checks, and holds its tick.

arms, run_levels, declaration   its declaration as data, without JAX
setup        static choices that select the code of the tick
geometry     kinematics, transmission, limits, tools, gravity, and the operating scene
original     the same quantities by the operations of the original software, in their order
dynamics     the links as rigid bodies
campaign     its sections of a campaign file, and what a campaign needs from it
console      the operator: motion, packets, reaction to the cue
stages       the control software and the PLC, one stage per file
plant        motors, cables, links, encoders of the virtual robot; the nominal model
loop         one cycle of the control software, and the tick: everything in one millisecond
software     the control software alone, driven from Python
"""

from __future__ import annotations

from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ARMS, JOINTS, LEADING, LINEAR
from ravenjax.robots.raven2.declaration import (
    CHECK_SEAMS,
    CHECKS,
    FILE,
    LAYERS,
    PHASES,
    SEAMS,
    SIGNALS,
    SITES,
)
from ravenjax.vocabulary.robot import Robot

ROBOT = Robot(
    name="raven2",
    title="Raven-II",
    package=__name__,
    arms=ARMS,
    joints=JOINTS,
    linear=LINEAR,
    sites=SITES,
    layers=LAYERS,
    checks=CHECKS,
    run_levels=run_levels.NAMES,
    live="run level pedal-down without a software E-stop",
    leading_joints=LEADING,
    noise=("plant.encoder_noise", "plant.torque_noise"),
    packet_cycles="network.cycles_per_packet",
    dead_man="pedal",
    validation=(
        "Its model was compared with recordings of two arms and with published experiments: four"
        " targets are met, two are not met, and one is not judged. No run was compared with a"
        " complete robot."
    ),
    tissue=True,
    phases=PHASES,
    check_seams=CHECK_SEAMS,
    seams=SEAMS,
    signals=SIGNALS,
    files=("raven2/raven2.xml", "raven2/mechanics.toml", "raven2/tools.toml", FILE),
)
