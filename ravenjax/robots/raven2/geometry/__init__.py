"""Where an arm's joints, motors and tip are: kinematics, transmission, limits, instruments, the
scene.
"""
