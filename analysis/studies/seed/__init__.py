"""Repeats the training simulator's experiments (IROS 2016): bursts on the DAC, and the error
without a fault.
"""
