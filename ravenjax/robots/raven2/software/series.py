"""What a caller hands to `ControlSoftware.run`, checked: whole arrays at once, with the errors
of `inputs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.software.inputs import INT32


def counts(what: str, given: Any, arms: int) -> np.ndarray:
    """[cycles, arms, 7] whole numbers of 32 bits."""
    array = _array(what, given, f"expected integers [cycles, arms, 7] = [.., {arms}, 7]")
    if array.ndim != 3 or array.shape[1:] != (arms, 7) or array.dtype.kind not in "iu":
        raise UserError(
            f"{what} has shape {array.shape} of {array.dtype}, expected integers [cycles, arms, 7]"
            f" = [.., {arms}, 7]; give one row of counts per cycle and arm in the order"
            f" {', '.join(JOINTS)}"
        )
    return _within(what, array, *INT32)


def numbers(what: str, given: Any, shape: tuple[int, int], low: int, high: int) -> np.ndarray:
    """Whole numbers: one for all, [cycles] or [cycles, arms] of `shape`."""
    cycles, arms = shape
    expected = f"one number, [cycles] = [{cycles}] or [cycles, arms] = [{cycles}, {arms}]"
    array = _array(what, given, f"expected {expected}")
    kinds = "b" if array.dtype.kind == "b" and high == 1 else "iu"
    if array.dtype.kind not in kinds or array.shape not in ((), (cycles,), shape):
        got = shown(given) if array.ndim == 0 else f"of shape {array.shape} and {array.dtype}"
        raise UserError(f"{what} is {got}, expected {expected} of whole numbers {low}..{high}")
    array = _within(what, array, low, high)
    return array[:, np.newaxis] if array.ndim == 1 else array


def packets(given: Any, cycles: int) -> Sequence[Any]:
    """One entry a cycle."""
    if given is None:
        return (None,) * cycles
    if not isinstance(given, list | tuple) or len(given) != cycles:
        got = (
            f"has {len(given)} entries" if isinstance(given, list | tuple) else f"is {shown(given)}"
        )
        raise UserError(
            f"packets {got}, expected a list with one entry a cycle ({cycles}): a datagram, a"
            " Packet, a list or None"
        )
    return given


def _array(what: str, given: Any, expected: str) -> np.ndarray:
    try:
        return np.asarray(given)
    except ValueError:  # rows of different lengths
        raise UserError(f"{what} is {shown(given)}, {expected}") from None


def _within(what: str, array: np.ndarray, low: int, high: int) -> np.ndarray:
    if array.size and (array.min() < low or array.max() > high):
        place = tuple(int(k) for k in np.argwhere((array < low) | (array > high))[0])
        where = "".join(f"[{k}]" for k in place)
        joint = f" ({JOINTS[place[2]]})" if len(place) == 3 else ""
        size = "a number of 32 bits" if (low, high) == INT32 else f"a whole number {low}..{high}"
        raise UserError(f"{what}{where}{joint} is {array[place]}, expected {size}")
    return array
