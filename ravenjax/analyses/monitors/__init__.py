"""Defines monitors: candidate checks as data, their calibration, and a search for checks that would
have detected faults.
"""
