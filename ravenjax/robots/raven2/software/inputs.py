"""Checks the arguments of `ControlSoftware` and `VirtualRobot`.

Each error names the argument, the value that was passed, and what is expected.
"""

import dataclasses
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ravenjax.errors import UserError, format_value, suggest_name
from ravenjax.numbers import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS, SLIDING_JOINTS
from ravenjax.robots.raven2.console.packet import Packet, empty_packet
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS, find_tool
from ravenjax.robots.raven2.setup import RavenSetup

INT32 = (-(2**31), 2**31 - 1)
Shape = tuple[int | None, ...]
_POSITIONS = (-6.3, 6.3, "rad", "degrees"), (0.0, 1.0, "m", "millimetres")
"""Range and unit of rotating and sliding joints (quantities.toml), and a unit used by mistake."""


def parse_word(name: str, word: Any, words: Iterable[str]) -> Any:
    """Return the word if it is one of `words`. Raises UserError, which names the argument."""
    words = list(words)
    if not isinstance(word, str) or word not in words:
        raise UserError(
            f"{name} is {format_value(word)}, expected one of"
            f" {', '.join(words)}{suggest_name(str(word), words)}"
        )
    return word


def arm_names(given: Any) -> tuple[Any, ...]:
    """Return the arms as a tuple. Raises UserError unless they are in the order of ARMS."""
    expected = f"expected a list of {' and '.join(ARMS)}, each at most once, {ARMS[0]} first"
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        remedy = f"For one arm write arms=['{ARMS[0]}']"
        raise UserError(f"arms is {format_value(given)}, {expected}. {remedy}")
    arms = tuple(parse_word("arm", arm, ARMS) for arm in given)
    if not arms or list(arms) != [arm for arm in ARMS if arm in arms]:
        raise UserError(f"arms is {format_value(list(arms))}, {expected}")
    return arms


def tool_names(given: Any, arms: Sequence[str], software: str) -> tuple[str, ...]:
    """Return one tool per arm. given: names; None: the tools of the software."""
    if given is None:
        return tuple(DEFAULT_TOOLS[software][arm] for arm in arms)
    tools = require_list("tools", given, len(arms), f"a list with one tool per arm {list(arms)}")
    return tuple(find_tool(tool).name for tool in tools)


def require_list(name: str, given: Any, count: int, expected: str) -> Any:
    """Return the list, tuple or array if it has `count` entries. expected: text for the error."""
    if not isinstance(given, list | tuple | np.ndarray):
        raise UserError(f"{name} is {format_value(given)}, expected {expected}")
    if len(given) != count:
        raise UserError(f"{name} has {len(given)} entries, expected {expected}")
    return given


def parse_whole_number(name: str, given: Any, low: int, high: int) -> int:
    """Return a whole number from `low` to `high`; truth values are refused."""
    try:
        number = operator.index(given)
    except TypeError:
        number = None
    if number is None or isinstance(given, bool | np.bool_) or not low <= number <= high:
        raise UserError(f"{name} is {format_value(given)}, expected a whole number {low}..{high}")
    return number


def parse_flag(name: str, given: Any) -> int:
    """Return 0 or 1 for a truth value, 0 or 1."""
    if not isinstance(given, bool | np.bool_ | int | np.integer) or given not in (0, 1):
        raise UserError(f"{name} is {format_value(given)}, expected True or False")
    return int(given)


def parse_counts(name: str, given: Any, *shapes: Shape) -> np.ndarray:
    """Return an array of 32-bit integers with one of these shapes. None in a shape: any length."""
    # This usual case must be fast, because a real robot waits for the result.
    if type(given) is np.ndarray and given.dtype == np.int32 and given.shape == shapes[0]:
        return given
    return _integers(name, given, shapes, INT32)


def per_board(name: str, given: Any, highest: int, *shapes: Shape) -> np.ndarray:
    """Return the input of each board: one whole number 0 to `highest`, or an array of these shapes.

    If `highest` is 1, truth values are allowed. shapes: ([arms],) for one cycle, ([cycles],
    [cycles, arms]) for several. An array [cycles] is returned as [cycles, 1].
    """
    # The usual case must be fast.
    kinds = (int, bool) if highest == 1 else (int,)
    if type(given) in kinds and 0 <= given <= highest:
        return np.asarray(given, np.int32)
    array = _integers(name, given, ((), *shapes), (0, highest))
    return array[:, np.newaxis] if len(shapes) > 1 and array.ndim == 1 else array


def _integers(name: str, given, shapes: Sequence[Shape], limits: tuple[int, int]) -> np.ndarray:
    # Returns an array of integers within limits; for the limits 0 and 1, also of truth values.
    array = _array(name, given, shapes, "iub" if limits == (0, 1) else "iu", "integers")
    low, high = limits
    if array.size and (array.min() < low or array.max() > high):
        place = tuple(int(k) for k in np.argwhere((array < low) | (array > high))[0])
        expected = "a 32-bit integer" if limits == INT32 else f"a whole number {low}..{high}"
        raise UserError(f"{name}{_index(place)} is {array[place]}, expected {expected}")
    return array


def _index(place: Sequence[int]) -> str:
    """Return the text `[0][6] (grasp2)` for place (0, 6): indices, and the name of the joint."""
    joint = f" ({JOINTS[place[-1]]})" if len(place) > 1 else ""
    return "".join(f"[{k}]" for k in place) + joint


def _array(name: str, given, shapes: Sequence[Shape], kinds: str, numbers: str) -> np.ndarray:
    """Return an array with one of the shapes, and a dtype of these `kinds` (letters of NumPy).
    numbers: what the numbers are called in the message, such as "integers".
    """
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        array = None
    if array is not None and array.dtype.kind in kinds:
        for shape in shapes:
            fits = (n in (None, length) for n, length in zip(shape, array.shape, strict=False))
            if len(shape) == array.ndim and all(fits):
                return array
    got = f"is {format_value(given)}"
    if array is not None and array.ndim:
        got = f"has shape {array.shape} of {array.dtype}"
    texts = [
        f"[{', '.join('..' if n is None else str(n) for n in shape)}]" if shape else "one number"
        for shape in shapes
    ]
    order = f" in the order {', '.join(JOINTS)}" if 7 in shapes[0] else ""
    raise UserError(f"{name} {got}, expected {numbers} {' or '.join(texts)}{order}")


def parse_joints(given: Any, arms: int) -> list[list[float]]:
    """Return joints [arms, 7]: angles of at most one revolution, rad; travel of at most 1 m."""
    array = _array("jpos", given, [(arms, 7)], "iuf", "numbers in rad and m")
    for place, value in np.ndenumerate(array):
        slides = JOINTS[place[1]] in SLIDING_JOINTS  # False is index 0, True is index 1
        low, high, unit, wrong_unit = _POSITIONS[slides]
        if not low <= value <= high:
            raise UserError(
                f"jpos{_index(place)} is {value}, expected {low:g}..{high:g} {unit}."
                f" Write {unit}, not {wrong_unit}"
            )
    return array.astype(np.float64).tolist()


def parse_packet(setup: RavenSetup, given: Packet) -> Packet:
    """Return a packet with checked numbers; quaternions may have any number, even NaN."""
    # A sequence number is unsigned in datagrams. The software compares the int32 with these bits.
    sequence = parse_whole_number("packet.sequence", given.sequence, INT32[0], 2**32 - 1)
    plain = dataclasses.replace(
        given,
        received=parse_flag("packet.received", given.received),
        size=parse_whole_number("packet.size", given.size, 0, INT32[1]),
        sequence=(sequence + 2**31) % 2**32 - 2**31,
    )
    return record_like("packet", plain, empty_packet(setup))


def record_like(name: str, given: Any, example: Any, finite: bool = False) -> Any:
    """Return `given` in the structure and types of `example`. finite: floats must be finite."""
    if dataclasses.is_dataclass(example):
        kind: Any = type(example)
        if type(given) is not kind:
            raise UserError(f"{name} is {format_value(given)}, expected a {kind.__name__}")
        return kind(
            *(
                record_like(f"{name}.{field}", getattr(given, field), example_value, finite)
                for field, example_value in vars(example).items()
            )
        )
    if isinstance(example, tuple):
        given = require_list(name, given, len(example), str(len(example)))
        items = [
            record_like(f"{name}[{k}]", *pair, finite)
            for k, pair in enumerate(zip(given, example, strict=True))
        ]
        return Vec(items) if isinstance(example, Vec) else tuple(items)
    if example is None and given is None:
        return None
    dtype = np.asarray(example).dtype
    if dtype.kind != "f":
        return dtype.type(parse_whole_number(name, given, *INT32))
    is_number = isinstance(given, int | float | np.number) and not isinstance(given, bool)
    if not is_number or (finite and not abs(given) <= float(np.finfo(dtype).max)):
        raise UserError(f"{name} is {format_value(given)}, expected a {'finite ' * finite}number")
    return dtype.type(given)
