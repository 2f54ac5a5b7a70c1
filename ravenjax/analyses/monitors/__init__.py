"""Monitors: candidate checks as data, their calibration, and which of them would have detected
faults.
"""
