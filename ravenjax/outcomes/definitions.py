"""Explains the words of a verdict in sentences that contain the limits of a campaign."""

from typing import NamedTuple

from ravenjax.bundled import resources
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
        """Return the meaning as a part of a sentence: "a check stopped the robot"."""
        sentences = self.meaning.rstrip(".").split(". ")
        return ", and ".join(sentence[0].lower() + sentence[1:] for sentence in sentences)


def definition_rows(rules: Rules, robot: Robot) -> list[Definition]:
    """Return all words and meanings: responses first, and the strongest of each kind first."""
    terms = {
        "limit": f"{rules.limit_mm:g} mm",
        "threshold": f"{rules.threshold_mm:g} mm",
        "halt_ms": HALT_MS,
        "condition": f" while the operator held the {robot.dead_man} down" * bool(robot.dead_man),
        "live": robot.live[:1].upper() + robot.live[1:],
    }
    kinds = resources.read_tables(__file__, "definitions.toml")
    return [
        Definition(
            kind,
            word,
            f"{meaning.format(**terms) * (word != HAZARDS[0] or rules.limit_counts)}"
            f" {describe_harms(rules) * (word == HAZARDS[0])}".strip(),
        )
        for kind, words in kinds.items()
        for word, meaning in words.items()
        if robot.dead_man or word != RESTART
    ]
