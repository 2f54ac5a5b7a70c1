"""Computes parts of the tick that any robot may have, such as detectors and the haptic cue."""
