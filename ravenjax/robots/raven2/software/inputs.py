"""What a caller hands to `ControlSoftware`, checked: each error names the argument, what was got
and what is expected.

Numbers come back as Python numbers; the printed code gives them their types.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown, suggestion
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS, LINEAR
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry import limits
from ravenjax.robots.raven2.geometry.tools import find_tool
from ravenjax.robots.raven2.setup import RavenSetup

INT32 = (-(2**31), 2**31 - 1)
WORD = (-(2**31), 2**32 - 1)
"""32 bits, read as signed or as unsigned."""


def known(what: str, word: Any, words: Iterable[str]) -> Any:
    """The word, if it is one of `words`."""
    words = list(words)
    if not isinstance(word, str) or word not in words:
        raise UserError(
            f"{what} is {shown(word)}, expected one of"
            f" {', '.join(words)}{suggestion(str(word), words)}"
        )
    return word


def arm_names(given: Any) -> tuple[Any, ...]:
    """The arms, each once, in mechanism order."""
    expected = f"expected a list of {' and '.join(ARMS)}, each at most once, {ARMS[0]} first"
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise UserError(f"arms is {shown(given)}, {expected}; write arms=['{ARMS[0]}'] for one arm")
    arms = tuple(known("arm", arm, ARMS) for arm in given)
    if not arms or list(arms) != [arm for arm in ARMS if arm in arms]:
        raise UserError(f"arms is {shown(list(arms))}, {expected}")
    return arms


def tool_names(given: Any, arms: Sequence[str]) -> tuple[str, ...]:
    """One tool per arm."""
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise UserError(
            f"tools is {shown(given)}, expected a list with one tool per arm {list(arms)}"
        )
    tools = tuple(given)
    if len(tools) != len(arms):
        raise UserError(f"tools has {len(tools)} entries, expected one tool per arm {list(arms)}")
    for tool in tools:
        if not isinstance(tool, str):
            raise UserError(f"tool is {shown(tool)}, expected the name of a tool")
        find_tool(tool)
    return tools


def counts(what: str, given: Any, arms: int, repeated: bool = False) -> list[list[int]]:
    """[arms, 7] whole numbers of 32 bits; `repeated`: or one number, or 7, for all of them."""
    order = f"in the order {', '.join(JOINTS)}"
    try:
        array = np.asarray(given)
        if repeated and array.shape in ((), (7,)):
            array = np.broadcast_to(array, (arms, 7))
    except ValueError:  # rows of different lengths
        raise UserError(
            f"{what} is {shown(given)}, expected one row of 7 counts per arm ({arms}) {order}"
        ) from None
    if array.shape != (arms, 7) or array.dtype.kind not in "iu":
        raise UserError(
            f"{what} has shape {array.shape} of {array.dtype}, expected integers [arms, 7] ="
            f" [{arms}, 7]; give one row of counts per arm {order}"
        )
    rows: list[list[int]] = array.tolist()
    for arm, row in enumerate(rows):
        if max(row) > INT32[1] or min(row) < INT32[0]:
            joint = next(i for i, count in enumerate(row) if not INT32[0] <= count <= INT32[1])
            raise UserError(
                f"{what}[{arm}][{joint}] ({JOINTS[joint]}) is {row[joint]}, expected a number of 32"
                " bits"
            )
    return rows


def whole(what: str, given: Any, low: int, high: int) -> int:
    """A whole number from `low` to `high`; a truth value is none."""
    try:
        number = operator.index(given)
    except TypeError:
        number = None
    if number is None or isinstance(given, bool | np.bool_) or not low <= number <= high:
        raise UserError(f"{what} is {shown(given)}, expected a whole number {low}..{high}")
    return number


def flag(what: str, given: Any) -> int:
    """0 or 1."""
    if isinstance(given, bool | np.bool_):
        return int(given)
    if not isinstance(given, int | np.integer) or given not in (0, 1):
        raise UserError(f"{what} is {shown(given)}, expected True or False")
    return int(given)


def each(what: str, entries: Any, arms: int) -> tuple[Any, ...]:
    """One entry an arm; a single one stands for all."""
    if isinstance(entries, np.ndarray):
        entries = entries.tolist()
    values = tuple(entries) if isinstance(entries, list | tuple) else (entries,) * arms
    if len(values) != arms:
        raise UserError(
            f"{what} has {len(values)} entries, expected one number or one per arm ({arms})"
        )
    return values


def pins(given: Any, arms: int) -> list[int]:
    """One byte a board."""
    return [whole("pins", byte, 0, 255) for byte in each("pins", given, arms)]


def flags(what: str, given: Any, arms: int) -> list[int]:
    """0 or 1, one an arm."""
    return [flag(what, one) for one in each(what, given, arms)]


def packet(setup: RavenSetup, given: Packet) -> Packet:
    """A packet's numbers; quaternions may hold any number, NaN among them, as a datagram may."""
    arms = len(setup.arms)
    deltas, quats = (
        _rows(f"packet.{name}", getattr(given, name), arms, n)
        for name, n in (("delta", 3), ("quat", 4))
    )
    openings = _row("packet.grasp", given.grasp, arms, "numbers, one an arm")
    return Packet(
        received=flag("packet.received", given.received),
        size=whole("packet.size", given.size, 0, INT32[1]),
        sequence=whole("packet.sequence", given.sequence, *WORD),
        delta=tuple(Vec(whole("packet.delta", x, *INT32) for x in row) for row in deltas),
        quat=tuple(Vec(_number("packet.quat", x) for x in row) for row in quats),
        grasp=tuple(whole("packet.grasp", x, *INT32) for x in openings),
        surgeon_mode=whole("packet.surgeon_mode", given.surgeon_mode, *INT32),
    )


def _rows(what: str, given: Any, arms: int, length: int) -> list[Any]:
    rows = _row(what, given, arms, "rows, one an arm")
    return [_row(f"{what}[{i}]", row, length, "numbers") for i, row in enumerate(rows)]


def _row(what: str, given: Any, length: int, entries: str) -> Any:
    if not isinstance(given, list | tuple | np.ndarray) or len(given) != length:
        got = (
            f"has {len(given)} entries" if isinstance(given, list | tuple) else f"is {shown(given)}"
        )
        raise UserError(f"{what} {got}, expected a list of {length} {entries}")
    return given


def _number(what: str, given: Any) -> float:
    try:
        if isinstance(given, str | bytes):
            raise TypeError
        return float(given)
    except (TypeError, ValueError, OverflowError):
        raise UserError(f"{what} holds {shown(given)}, expected numbers") from None


def joints(what: str, given: Any, arms: int) -> list[list[float]]:
    """[arms, 7] joint positions, rad and m, anywhere within a turn and within a metre."""
    order = f"in rad and m in the order {', '.join(JOINTS)}"
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        raise UserError(
            f"{what} is {shown(given)}, expected one row of 7 joints per arm ({arms}) {order}"
        ) from None
    if array.shape != (arms, 7) or array.dtype.kind not in "iuf":
        raise UserError(
            f"{what} has shape {array.shape} of {array.dtype}, expected numbers [arms, 7] ="
            f" [{arms}, 7]; give one row of joints per arm {order}"
        )
    rows: list[list[float]] = array.astype(np.float64).tolist()
    angle, travel = limits.position("position of the joint")
    for arm, row in enumerate(rows):
        for joint, value in zip(JOINTS, row, strict=True):
            quantity, hint = (travel, "millimetres") if joint in LINEAR else (angle, "degrees")
            if not quantity.low <= value <= quantity.high:
                raise UserError(
                    f"{what}[{arm}] ({joint}) is {value}, expected"
                    f" {quantity.low:g}..{quantity.high:g} {quantity.unit}; give"
                    f" {'m' if joint in LINEAR else 'rad'}, not {hint}"
                )
    return rows
