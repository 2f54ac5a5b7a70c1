"""Functions for the values of a campaign's keys: distributions to draw from, and positions in a
phase.

Each function returns the table that a campaign file would hold: `uniform(0, 1)` is `{ uniform = [0,
1] }`. The numbers are checked with the campaign, by the same rules as in a file. A plain list is a
list of values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

Form: TypeAlias = dict[str, Any]
"""A table in place of a value, as in a campaign file."""


def uniform(low: float, high: float) -> Form:
    """Draw a number from low to high, uniformly; integers include both ends."""
    return {"uniform": [low, high]}


def loguniform(low: float, high: float) -> Form:
    """Draw a number from low to high, both above 0, uniformly in its logarithm."""
    return {"loguniform": [low, high]}


def normal(mean: float, standard_deviation: float) -> Form:
    """Draw a normally distributed number."""
    return {"normal": [mean, standard_deviation]}


def choice(values: Sequence[Any]) -> Form:
    """Draw one of some values, each equally likely."""
    return {"choice": list(values)}


def together(values: Sequence[float]) -> Form:
    """Draw one of some values, jointly with all other parameters that use `together`.

    All take their n-th value in the same run.
    """
    return {"together": list(values)}


def phase(name: str, share: float | Sequence[float] | None = None) -> Form:
    """Return a position in a phase of the operation, for `start_ms`: 0 is its first millisecond, 1
    its last.

    share: one or several positions; several are a list of levels. None: draw each millisecond of
    the phase with equal probability.
    """
    if share is None:
        return {"phase": name}
    return {"phase": name, "share": list(share) if isinstance(share, Sequence) else share}
