"""Stages that the tick of any robot may have: check records, haptics, detectors, the monitor,
packets.
"""
