"""Functions that declare how a key of a campaign varies, for campaigns in Python.

For example, a value is drawn from a distribution, or a fault starts in a phase of the operation.
Each function returns the table that a campaign file contains: `uniform(0, 1)` returns the table
`{ uniform = [0, 1] }`. `Campaign` checks the numbers. Several values of a key are a plain list.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

Form: TypeAlias = dict[str, Any]
"""A table that replaces a value, with the form of a campaign file."""


def uniform(low: float, high: float) -> Form:
    """Draw a number uniformly from low to high. Integers include both ends."""
    return {"uniform": [low, high]}


def loguniform(low: float, high: float) -> Form:
    """Draw a number whose logarithm is uniform from log(low) to log(high). Both must be above 0."""
    return {"loguniform": [low, high]}


def normal(mean: float, standard_deviation: float) -> Form:
    """Draw a normally distributed number."""
    return {"normal": [mean, standard_deviation]}


def choice(values: Sequence[Any]) -> Form:
    """Draw one of the values with equal probability."""
    return {"choice": list(values)}


def together(values: Sequence[float]) -> Form:
    """Draw an index of the list. In each run, all lists of `together` use the same index."""
    return {"together": list(values)}


def phase(name: str, share: float | Sequence[float] | None = None) -> Form:
    """Return a time within a phase of the operation, for `start_ms`.

    share: position in the phase, from 0 (its first millisecond) to 1 (its last), or a list of
    positions. None: draw a millisecond of the phase with equal probability.
    """
    if share is None:
        return {"phase": name}
    return {"phase": name, "share": list(share) if isinstance(share, Sequence) else share}
