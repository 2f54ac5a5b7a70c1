"""Repeats the targeted attacks and the dynamic model of DSN 2016: both scenarios, the detector and
its thresholds, and the recording.
"""
