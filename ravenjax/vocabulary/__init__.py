"""Definitions of faults, checks and robots that all other packages share. They need no JAX.

`ravenjax.outcomes` defines the outcomes of a run: response, hazard, cue and verdict.
"""
