"""Defines the options of `ravenjax counterfactual`, and converts candidate checks into
detectors."""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.monitors import code
from ravenjax.analyses.monitors.scores import Score
from ravenjax.campaign.file.config import CampaignConfig, validate_tables
from ravenjax.errors import UserError, format_value

MARGINS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 8.0)
"""Factors on the scales at which candidates alarm: the thresholds of every detector."""
PROPOSED = MARGINS.index(1.25)
"""Index of the margin at which a set is selected, before its own margin is calibrated."""
CONSECUTIVE = (1, 4)
"""Milliseconds in a row above the threshold that make an alarm; one candidate each."""


class Question(NamedTuple):
    """The settings of a counterfactual search."""

    false_alarms_per_hour: float = 4.0  # of the whole set, at most
    # A fault is covered by an alarm at least this long before harm.
    lead_ms: int = 10
    hours: float = 2.0  # hours of fault-free motion, over all shares
    most: int = 8  # largest number of checks in the set
    groups: tuple[str, ...] = ()  # groups whose faults are to be covered; (): all
    seed: int = 0  # for the halves, and for random sets

    def require(self) -> None:
        """Raise UserError for invalid settings."""
        least = {"false_alarms_per_hour": None, "hours": None, "lead_ms": 0, "most": 1, "seed": 0}
        for name, low in least.items():
            value = getattr(self, name)
            if low is None:
                valid = isinstance(value, int | float) and math.isfinite(value) and value > 0
                expected = "a number above 0, such as 2"
            else:
                valid = type(value) is int and value >= low
                expected = f"a whole number from {low} on"
            if not valid:
                raise UserError(
                    f"--{name.replace('_', '-')} is {format_value(value)}, expected {expected}"
                )


SMALLEST_SCALE = 1e-9
"""Scale of a channel that never moves in fault-free motion, in its unit. Any change exceeds it."""
_PREFIX = "what_if_"
"""Prefix of the detectors' names. It keeps them apart from the campaign's own detectors."""


class Candidate(NamedTuple):
    """One check that a robot could have."""

    score: Score
    consecutive: int  # consecutive ms above the threshold

    @property
    def name(self) -> str:
        """Return the name as a word: mvel_rate, mvel_rate_4ms."""
        return (
            self.score.name if self.consecutive == 1 else f"{self.score.name}_{self.consecutive}ms"
        )

    @property
    def words(self) -> str:
        """Describe what the check observes."""
        return self.score.words + (
            f", {self.consecutive} ms in a row" if self.consecutive > 1 else ""
        )


def detector_tables(
    parts: Sequence[Candidate], thresholds: Sequence[float], folder: Path
) -> list[dict[str, Any]]:
    """Return the [[detector]] tables of the candidates in order. Their files are written to
    `folder`.

    Consecutive candidates of one score share its file and its computation.
    """
    folder.mkdir(exist_ok=True)
    out, place = [], 0
    for score, alike in itertools.groupby(parts, key=lambda part: part.score):
        path, counts = folder / f"{_PREFIX}{place}.py", [part.consecutive for part in alike]
        path.write_text(code.write_part(score.singles), encoding="utf-8")
        table = {"name": path.stem, "file": str(path), "consecutive": counts}
        out.append({**table, "threshold": [float(threshold) for threshold in thresholds]})
        place += len(counts)
    return out


def with_detectors(
    raw: Mapping[str, Any], tables: Sequence[Mapping[str, Any]]
) -> tuple[CampaignConfig, list[str]]:
    """Return a manifest's campaign with these detectors added, and their columns' prefixes."""
    config = validate_tables({**raw, "stop": None, "detector": [*raw.get("detector", ()), *tables]})
    more = sum(len(table["consecutive"]) for table in tables)
    return config, [
        f"detector{number}_"
        for number in range(len(config.detectors) - more, len(config.detectors))
    ]


def single_channels(scores: Sequence[Score]) -> list[Candidate]:
    """Return every channel of the scores for each of CONSECUTIVE, which varies fastest."""
    return [
        Candidate(single, count)
        for score in scores
        for single in score.singles
        for count in CONSECUTIVE
    ]


def scale_candidates(scores: Sequence[Score], peaks: np.ndarray) -> list[Candidate]:
    """Return candidates whose scales are the values reached in fault-free motion, `peaks`."""
    rest = np.maximum(peaks, SMALLEST_SCALE).reshape(-1, len(CONSECUTIVE))
    out = []
    for score in scores:
        own, rest = rest[: len(score.scales)], rest[len(score.scales) :]
        out += [
            Candidate(score.scaled(own[:, place].tolist()), count)
            for place, count in enumerate(CONSECUTIVE)
        ]
    return out
