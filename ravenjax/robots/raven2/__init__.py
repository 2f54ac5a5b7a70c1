"""The Raven-II: its arms, joints, fault sites and checks as data, and the code of its tick.

arms, run_levels, declaration   the robot as data, without JAX
setup          static choices that select the code of the tick
geometry       kinematics, transmission, limits, tools, gravity, and the operating scene
original       geometry with the operations of the original software, in their order
dynamics       the links as rigid bodies
campaign       the robot's sections of a campaign file, and the functions that a campaign calls
console        the operator: motion, packets, reaction to the cue
stages         the control software and the PLC, one stage per file
plant          motors, cables, links, encoders of the virtual robot; the nominal model
loop           one cycle of the control software, and the tick: everything in one millisecond
software       the control software alone, called from Python
virtual_robot  the virtual robot alone, called from Python
c_library      both as a C library
"""

from ravenjax.robots.raven2.declaration import ROBOT

__all__ = ["ROBOT"]
