"""Bursts on the DAC: the study of every constant, what a burst does, tables and drawings."""
