"""What an operator who feels the haptic cue does.

`ravenjax.robots.raven2.console.reaction` implements the reactions.
"""

NONE, RELEASE, SLOW, CORRECT = 0, 1, 2, 3

ACTIONS = ("none", "release", "slow", "correct")
"""Names of the reactions, by number."""

MEANINGS = {
    "none": "nobody reacts",
    "release": "lift the pedal",
    "slow": "slow down",
    "correct": "correct by eye",
}
"""Meaning of each of ACTIONS."""
