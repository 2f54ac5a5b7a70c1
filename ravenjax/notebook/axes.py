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
    """A number from low to high, each as likely; whole numbers include both ends."""
    return {"uniform": [low, high]}


def loguniform(low: float, high: float) -> Form:
    """A number from low to high, both above 0, each magnitude as likely."""
    return {"loguniform": [low, high]}


def normal(mean: float, standard_deviation: float) -> Form:
    """A normally distributed number."""
    return {"normal": [mean, standard_deviation]}


def choice(values: Sequence[Any]) -> Form:
    """One of some values, each as likely."""
    return {"choice": list(values)}


def together(values: Sequence[float]) -> Form:
    """One of some values, drawn in one with all parameters that say together: the n-th value of
    each.
    """
    return {"together": list(values)}


def phase(name: str, share: float | Sequence[float] | None = None) -> Form:
    """A place in a phase of the operation, for `start_ms`: 0 is its first millisecond, 1 its last;
    several in turn.

    Without a share each millisecond of the phase is as likely.
    """
    if share is None:
        return {"phase": name}
    return {"phase": name, "share": list(share) if isinstance(share, Sequence) else share}
