"""The words that every other floor is written in, each with its meaning; without JAX, for readers
of results.

sites        what a fault site is: its channels, number types, units, layer effects      what a
fault does to a number, which value it takes, and when it does so legal        which values an
effect may have at a channel checks       what a built-in check is, and what one does when it trips
robot        what a robot declares of itself: arms, joints, its own sites, layers, checks, run
levels reactions    what an operator does at a cue packets      how long a packet of the console
lasts

What became of a run (response, hazard, cue, verdict) is defined in `ravenjax.outcomes`.
"""
