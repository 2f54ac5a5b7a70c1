"""Targeted attacks and the dynamic model (DSN 2016): both scenarios, the detector and its
thresholds, the recording.
"""
