"""Defines the reactions to the haptic cue that a robot's simulated operator may implement."""

NONE, RELEASE, SLOW, CORRECT = 0, 1, 2, 3

MEANINGS = {
    "none": "nobody reacts",
    "release": "lift the pedal",
    "slow": "slow down",
    "correct": "correct by eye",
}
"""Meaning of each of ACTIONS."""

ACTIONS = tuple(MEANINGS)
"""Names of the reactions, by number."""
