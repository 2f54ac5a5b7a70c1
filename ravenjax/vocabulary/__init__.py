"""Definitions of faults, checks and robots that all other packages share. They need no JAX.

`ravenjax.outcomes` defines the outcomes of a run: response, hazard, cue and verdict.
"""

TICK_S = 1e-3
"""Time from one row of a motion to the next, and length of a control cycle of the Raven-II, s."""
