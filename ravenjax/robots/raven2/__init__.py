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

from ravenjax.robots.raven2.declaration import ROBOT

__all__ = ["ROBOT"]
