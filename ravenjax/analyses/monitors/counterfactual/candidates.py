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
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import validate_tables
from ravenjax.errors import UserError, format_value

MARGINS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 8.0)
"""Thresholds of every detector, as factors on a candidate's scale."""
PROPOSED = MARGINS.index(1.25)
"""Index of the margin with which a set is selected. Afterwards the margin is calibrated."""
CONSECUTIVE = (1, 4)
"""Numbers of ticks in a row above the threshold that raise an alarm. Each is another candidate."""


class Question(NamedTuple):
    """The settings of `ravenjax counterfactual`."""

    false_alarms_per_hour: float = 4.0  # largest rate of the whole set
    # Smallest time between an alarm and the harm for a fault to count as covered.
    lead_ms: int = 10
    hours: float = 2.0  # total hours of fault-free motion
    most: int = 8  # largest number of checks in the set
    groups: tuple[str, ...] = ()  # groups whose faults are used; (): all groups
    seed: int = 0  # seed of the random halves, and of random sets

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
                expected = f"a whole number, {low} or more"
            if not valid:
                raise UserError(
                    f"--{name.replace('_', '-')} is {format_value(value)}, expected {expected}"
                )


SMALLEST_SCALE = 1e-9
"""Scale of a channel that is constant in fault-free motion, in its unit. Any change exceeds it."""
_PREFIX = "what_if_"
"""Prefix of the names of candidate detectors, which distinguishes them from the campaign's."""


class Candidate(NamedTuple):
    """One check that a robot could have."""

    score: Score
    consecutive: int  # number of consecutive ticks above the threshold that raise an alarm

    @property
    def name(self) -> str:
        """Return the name as a word: mvel_rate, mvel_rate_4ticks."""
        return self.score.name + (f"_{self.consecutive}ticks" if self.consecutive > 1 else "")

    @property
    def words(self) -> str:
        """Describe what the check observes."""
        return self.score.words + (
            f", in {self.consecutive} consecutive ticks" if self.consecutive > 1 else ""
        )


def detector_tables(
    parts: Sequence[Candidate], thresholds: Sequence[float], folder: Path
) -> list[dict[str, Any]]:
    """Return the [[detector]] tables of candidates, in order, and write their files to `folder`.

    Neighbouring candidates with the same score share a file and its computation.
    """
    folder.mkdir(exist_ok=True)
    out, number = [], 0
    for score, alike in itertools.groupby(parts, key=lambda part: part.score):
        path, counts = folder / f"{_PREFIX}{number}.py", [part.consecutive for part in alike]
        path.write_text(code.write_part(score.singles), encoding="utf-8")
        table = {"name": path.stem, "file": str(path), "consecutive": counts}
        out.append({**table, "threshold": [float(threshold) for threshold in thresholds]})
        number += len(counts)
    return out


def with_detectors(
    raw: Mapping[str, Any], tables: Sequence[Mapping[str, Any]]
) -> tuple[CampaignConfig, list[str]]:
    """Return a campaign (as JSON values) with additional detectors, and the prefixes of their
    columns in the result table.
    """
    config = validate_tables({**raw, "stop": None, "detector": [*raw.get("detector", ()), *tables]})
    more = sum(len(table["consecutive"]) for table in tables)
    return config, [
        f"detector{number}_"
        for number in range(len(config.detectors) - more, len(config.detectors))
    ]


def single_channels(scores: Sequence[Score]) -> list[Candidate]:
    """Return a candidate for each channel of the scores and each number of CONSECUTIVE."""
    return [
        Candidate(single, count)
        for score in scores
        for single in score.singles
        for count in CONSECUTIVE
    ]


def scale_candidates(scores: Sequence[Score], peaks: np.ndarray) -> list[Candidate]:
    """Return candidates whose scales are the largest values in fault-free motion.

    `peaks`: [channels of all scores * CONSECUTIVE], in the order of `single_channels`.
    """
    rest = np.maximum(peaks, SMALLEST_SCALE).reshape(-1, len(CONSECUTIVE))
    out = []
    for score in scores:
        own, rest = rest[: len(score.scales)], rest[len(score.scales) :]
        out += [
            Candidate(score.scaled(own[:, number].tolist()), count)
            for number, count in enumerate(CONSECUTIVE)
        ]
    return out
