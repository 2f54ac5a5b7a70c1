"""Defines the options of `ravenjax counterfactual`. Converts candidate checks into detectors."""

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
SELECTION_MARGIN_INDEX = MARGINS.index(1.25)
"""Index of the margin with which a set is selected. Afterwards the margin is calibrated."""
CONSECUTIVE_TICKS = (1, 4)
"""Numbers of ticks in a row above the threshold that raise an alarm. Each is another candidate."""


class Question(NamedTuple):
    """The settings of `ravenjax counterfactual`."""

    false_alarms_per_hour: float = 4.0  # largest rate of the whole set
    lead_ms: int = 10  # least time between an alarm and the harm for a fault to count as covered
    hours: float = 2.0  # total hours of fault-free motion
    most: int = 8  # largest number of checks in the set
    groups: tuple[str, ...] = ()  # groups whose faults are used; (): all groups
    seed: int = 0  # seed of the random halves, and of random sets

    def require(self) -> None:
        """Raise UserError for a number that is too small, infinite or of a wrong type."""
        # Settings that are whole numbers, with their smallest values. The others are real numbers.
        min_values = {"lead_ms": 0, "most": 1, "seed": 0}
        for name in ("false_alarms_per_hour", "hours", *min_values):
            value = getattr(self, name)
            if name in min_values:
                # A Boolean is an int for isinstance, so the type is compared.
                valid = type(value) is int and value >= min_values[name]
                expected = f"a whole number, {min_values[name]} or more"
            else:
                valid = isinstance(value, int | float) and math.isfinite(value) and value > 0
                expected = "a number above 0, such as 2"
            if not valid:
                raise UserError(
                    f"--{name.replace('_', '-')} is {format_value(value)}, expected {expected}"
                )


SMALLEST_SCALE = 1e-9
"""Scale of a channel that is constant in fault-free motion, in its unit. Any change exceeds it."""
_PREFIX = "what_if_"
"""Prefix of the names of candidate detectors, which distinguishes them from the campaign's."""


class Candidate(NamedTuple):
    """A check that the robot does not have, but could have."""

    score: Score
    consecutive: int  # number of consecutive ticks above the threshold that raise an alarm

    @property
    def name(self) -> str:
        """The score's name, with the number of ticks if it is not 1: mvel_rate_4ticks."""
        if self.consecutive == 1:
            return self.score.name
        return f"{self.score.name}_{self.consecutive}ticks"

    @property
    def words(self) -> str:
        """Words that say what the check observes."""
        if self.consecutive == 1:
            return self.score.words
        return f"{self.score.words}, in {self.consecutive} consecutive ticks"


def detector_tables(
    candidates: Sequence[Candidate], thresholds: Sequence[float], folder: Path
) -> list[dict[str, Any]]:
    """Return candidates as [[detector]] tables of a campaign, in order, and write the Python files
    of the detectors to `folder`. Each detector has all `thresholds`.

    Neighbouring candidates with the same score share one table, whose score is computed once.
    """
    folder.mkdir(exist_ok=True)
    tables, first_index = [], 0
    for score, same_score in itertools.groupby(candidates, key=lambda candidate: candidate.score):
        consecutive = [candidate.consecutive for candidate in same_score]
        path = folder / f"{_PREFIX}{first_index}.py"
        path.write_text(code.write_part(score.channel_scores), encoding="utf-8")
        table = {"name": path.stem, "file": str(path), "consecutive": consecutive}
        tables.append(table | {"threshold": [float(threshold) for threshold in thresholds]})
        first_index += len(consecutive)
    return tables


def add_detectors(
    raw: Mapping[str, Any], tables: Sequence[Mapping[str, Any]]
) -> tuple[CampaignConfig, list[str]]:
    """Return a campaign (as JSON values) with additional [[detector]] tables, and for each new
    detector the prefix of its columns in the result table, such as `detector3_`.

    The campaign loses its table [stop], so that it computes all runs.
    """
    config = validate_tables({**raw, "stop": None, "detector": [*raw.get("detector", ()), *tables]})
    # Each number of consecutive ticks in a table is a detector. New detectors follow the others.
    added_count = sum(len(table["consecutive"]) for table in tables)
    detector_count = len(config.detectors)
    added = range(detector_count - added_count, detector_count)
    return config, [f"detector{number}_" for number in added]


def list_single_channels(scores: Sequence[Score]) -> list[Candidate]:
    """Return a candidate for each channel of each score and each number of CONSECUTIVE_TICKS."""
    return [
        Candidate(channel, consecutive)
        for score in scores
        for channel in score.channel_scores
        for consecutive in CONSECUTIVE_TICKS
    ]


def scale_candidates(scores: Sequence[Score], peaks: np.ndarray) -> list[Candidate]:
    """Return a candidate for each score and each number of CONSECUTIVE_TICKS. The scale of a
    channel is the channel's largest value in fault-free motion. `peaks`: these values in the order
    of `list_single_channels`: for each channel, one value per number of CONSECUTIVE_TICKS.
    """
    channel_peaks = np.maximum(peaks, SMALLEST_SCALE).reshape(-1, len(CONSECUTIVE_TICKS))
    candidates, first = [], 0
    for score in scores:
        end = first + len(score.scales)
        for column, consecutive in enumerate(CONSECUTIVE_TICKS):
            scales = channel_peaks[first:end, column].tolist()
            candidates.append(Candidate(score.scaled(scales), consecutive))
        first = end
    return candidates
