"""What the tables of evidence have in common: how a rate and the runs behind a number are told."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ravenjax.stats.intervals import Rate

EXAMPLES = 3
"""Runs that are named for a number: the first in the order of the fault table."""
SAMPLED, ENUMERATED = "Wilson, 95 %", "none: not all of the faults were drawn"


def interval_in_words(rate: Rate) -> str:
    """How the interval of a rate was made."""
    return ENUMERATED if math.isnan(rate.low) else SAMPLED


def some(column: str) -> str:
    """SQL: the first few values of a column of a group of rows."""
    return f"arg_min({column}, f.row, {EXAMPLES})"


def ids(values: Iterable[object]) -> str:
    """Run ids in one cell."""
    return " ".join(map(str, values))
