"""The words of a verdict with a campaign's own numbers, as report, terminal and documentation
print them.
"""

from __future__ import annotations

from typing import NamedTuple

from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import HALT_MS
from ravenjax.vocabulary.robot import Robot

OVERLOADED = "overloaded cable"
"""The word of an outcome that only mechanics with real tensions have."""


class Definition(NamedTuple):
    """One word."""

    kind: str  # response, hazard, cue or other
    word: str
    meaning: str

    def clause(self) -> str:
        """The meaning as a part of a sentence: "a check told a person, and the robot went on"."""
        sentences = self.meaning.rstrip(".").split(". ")
        return ", and ".join(sentence[0].lower() + sentence[1:] for sentence in sentences)


def rows(rules: Rules, robot: Robot) -> list[Definition]:
    """Every word, responses first, each kind from the strongest to the weakest."""
    limit, threshold = f"{rules.limit_mm:g} mm", f"{rules.threshold_mm:g} mm"
    condition = f" while the operator held the {robot.dead_man} down" if robot.dead_man else ""
    return [
        Definition("response", "stopped", "A check stopped the robot."),
        Definition("response", "flagged", "A check told a person, and the robot went on."),
        Definition(
            "response", "limited", "A check changed a command or dropped a packet. Nobody was told."
        ),
        Definition(
            "response",
            "silent",
            "No check tripped more often than in the golden run, nor first tripped sooner than"
            " there.",
        ),
        Definition(
            "hazard",
            "unintended motion",
            f"While the robot was live, its true tip was more than {limit} from golden run and"
            " nominal model, and from where standing still would have left it.",
        ),
        Definition(
            "hazard",
            "loss of motion",
            f"The robot did not follow: while live, its tip was more than {limit} from golden run"
            " and model, but near where standing still leaves it; or, not stopped by a check, it"
            f" was not live for more than {HALT_MS} ms longer than in the golden run{condition}.",
        ),
        Definition(
            "hazard",
            "false report",
            f"While the robot was live, the tip that it reported was more than {limit} from its"
            " true tip, beyond what the golden run shows. The instrument itself moved as asked.",
        ),
        Definition(
            "hazard", "none", "None of these. A run with several hazards counts under the first."
        ),
        Definition(
            "cue", "cue", f"The {threshold} haptic cue came, and the golden run had none by then."
        ),
        Definition(
            "other", "golden run", "The same operation, robot and random numbers without the fault."
        ),
        Definition("other", "live", f"{robot.live[:1].upper()}{robot.live[1:]}."),
        Definition(
            "other",
            OVERLOADED,
            "The tension of a cable, damping included, was above its strength, and no cable's was"
            " by then in the golden run. It is no hazard of its own.",
        ),
        Definition(
            "other",
            "evades",
            "Nobody was told by a check (limited or silent), and the hazard is an unintended"
            f" motion over {limit}.",
        ),
    ]
