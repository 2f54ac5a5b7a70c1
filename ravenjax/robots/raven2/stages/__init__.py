"""Computes the stages of the control software and the PLC, one file per stage. Signals have the
names of raven2's source code.
"""
