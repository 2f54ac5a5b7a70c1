"""Explains the words of a verdict in sentences, with the limits in mm that a campaign sets."""

from typing import NamedTuple

from ravenjax import resources
from ravenjax.outcomes.events import Rules, describe_harms
from ravenjax.outcomes.verdict import HALT_MS, HAZARDS
from ravenjax.vocabulary.robot import Robot

OVERLOADED = "overloaded cable"
"""An outcome that only robots with known cable tensions have."""
RESTART = "restart with the foot on the pedal"
"""An outcome that only robots with a dead-man switch have."""


class Definition(NamedTuple):
    """One word and its meaning."""

    kind: str  # response, hazard, cue or other
    word: str
    meaning: str

    def clause(self) -> str:
        """Return the meaning as one clause of a sentence: "a check stopped the robot"."""
        sentences = self.meaning.rstrip(".").split(". ")
        return ", and ".join(sentence[0].lower() + sentence[1:] for sentence in sentences)


def definition_rows(rules: Rules, robot: Robot) -> list[Definition]:
    """Return all words and meanings in the order of definitions.toml: by kind, the strongest word
    of each kind first. The meanings contain the limits of `rules`.
    """
    terms = {
        "limit": f"{rules.limit_mm:g} mm",
        "threshold": f"{rules.threshold_mm:g} mm",
        "halt_ms": HALT_MS,
        "condition": (
            f" while the operator held the {robot.dead_man} down" if robot.dead_man else ""
        ),
        "live": robot.live[:1].upper() + robot.live[1:],
    }
    rows = []
    for kind, meanings in resources.read_tables(__file__, "definitions.toml").items():
        for word, meaning in meanings.items():
            text = meaning.format(**terms)
            # Unintended motion: a campaign may define harms in addition to its limit, or instead.
            if word == HAZARDS[0]:
                text = f"{text if rules.limit_counts else ''} {describe_harms(rules)}".strip()
            if robot.dead_man or word != RESTART:
                rows.append(Definition(kind, word, text))
    return rows
