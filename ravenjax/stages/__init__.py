"""Stages that any robot may have in its tick: checks as records, haptics, detectors, the
monitor, packets.
"""
