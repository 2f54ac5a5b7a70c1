"""Faults at the seams of a tick: what they do to a number, where, and when. Knows nothing of any
robot.
"""
