"""Definitions of faults, checks and robots that all other packages share. Needs no JAX.

    sites        what a fault site is: its channels, number types, units, layer
    effects      what a fault does to a number, which value it takes, and when it acts
    legal        which values an effect may have at a channel
    checks       what a built-in check is, and what a check does when it trips
    robot        what a robot declares: arms, joints, sites, layers, checks, run levels
    reactions    what an operator does at a cue
    packets      how many control cycles a packet of the console lasts

The outcomes of a run (response, hazard, cue, verdict) are defined in `ravenjax.outcomes`.
"""
