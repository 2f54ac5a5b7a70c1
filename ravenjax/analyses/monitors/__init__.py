"""Defines monitors: checks as data, their calibration, and a search for missing checks."""
