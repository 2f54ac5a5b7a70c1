"""Computes parts of the tick that any robot may have: checks, haptics, detectors, monitor, packets."""
