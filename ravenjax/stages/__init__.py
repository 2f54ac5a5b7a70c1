"""Stages that the tick of any robot may have: checks, haptics, detectors, monitor, packets."""
