"""Computes alarm thresholds with a guaranteed false-alarm rate, by conformal prediction.

The package also tests whether new fault-free operations still resemble those of the calibration.
"""
