"""The words that every other floor is written in, each with its meaning; without JAX, for readers of results.

arms         arms and joints
sites        where a fault can strike: sites, their channels, number types, units, layers
effects      what a fault does to a number, which value it takes, and when it does so
legal        which values an effect may have at a channel
checks       the robot's built-in checks, and what each does when it trips
run_levels   the robot's run levels
reactions    what an operator does at a cue

What became of a run (response, hazard, cue, verdict) is defined in `ravenjax.outcomes`.
"""
