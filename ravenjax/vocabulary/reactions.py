"""What an operator who feels the cue does. How, is in `ravenjax.robots.raven2.console.reaction`."""

from __future__ import annotations

NONE, RELEASE, SLOW, CORRECT = 0, 1, 2, 3

ACTIONS = ("none", "release", "slow", "correct")
"""By number."""

MEANINGS = {
    "none": "nobody reacts",
    "release": "lift the pedal",
    "slow": "slow down",
    "correct": "correct by eye",
}
"""Each of ACTIONS."""
