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

from ravenjax.robots.raven2 import declaration, run_levels
from ravenjax.robots.raven2.arms import ARMS, JOINTS, LEADING, LINEAR
from ravenjax.vocabulary.robot import Robot

ROBOT = Robot(
    package=__name__,
    arms=ARMS,
    joints=JOINTS,
    linear=LINEAR,
    leading_joints=LEADING,
    run_levels=run_levels.NAMES,
    sites=declaration.SITES,
    layers=declaration.LAYERS,
    checks=declaration.CHECKS,
    phases=declaration.PHASES,
    check_seams=declaration.CHECK_SEAMS,
    seams=declaration.SEAMS,
    signals=declaration.SIGNALS,
    **declaration.WORDS,
)
