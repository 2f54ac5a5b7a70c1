"""Fault injection at the seams of a tick, independent of the robot: fault effects, sites and
windows.
"""
