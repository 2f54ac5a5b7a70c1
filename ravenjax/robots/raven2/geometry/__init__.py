"""Geometry of an arm: kinematics, transmission, limits, instruments, and the operating scene."""
