"""Computes the stages of the control software and the PLC, one file per stage, with the robot's
names.
"""
