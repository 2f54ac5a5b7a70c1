"""What consoles say about hands and pedal, read from messages that may be anything: see
`trainer.protocol.messages`.

Every function raises `RefusedCommand` for what it cannot take.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.robots.raven2.arms import ARMS

STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Speeds of a hand at rest: move 3, turn 3, grasp."""
LEVEL = (0.0, 0.0, 0.0, 1.0)
"""No turn."""
_NUMBER, _LIST = (int, float), (list, tuple)


class RefusedCommand(Exception):
    """What is wrong with a message, in words that do not depend on its numbers."""


class Increment(NamedTuple):
    """Of one arm since the last message, ITP frame, as the robot would take it."""

    delta_um: tuple[float, float, float]
    quat: tuple[float, float, float, float]
    grasp_mrad: float

    @staticmethod
    def read(given: Mapping[str, Any]) -> Increment:
        """An arm's table of a message "increments"; turn and grasp may be left out."""
        x, y, z = _numbers(given, "delta_um", 3)
        qx, qy, qz, qw = _numbers(given, "quat", 4) if "quat" in given else LEVEL
        norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        if not 1e-6 < norm < 1e6:
            raise RefusedCommand("quat is no rotation")
        return Increment((x, y, z), (qx, qy, qz, qw), _number(given, "grasp_mrad"))


def pedal(message: Mapping[str, Any]) -> bool:
    """Whether a message "input" or "increments" holds the pedal down."""
    if not isinstance(message, dict):
        raise RefusedCommand("no table")
    if message.get("type") not in ("input", "increments"):
        raise RefusedCommand("type is neither input nor increments")
    down = message.get("pedal")
    if not isinstance(down, bool):
        raise RefusedCommand("pedal is neither true nor false")
    return down


def each_arm(message: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
    """The tables of the arms that a message names."""
    tables = message.get("arms", {})
    if not isinstance(tables, dict):
        raise RefusedCommand("arms is no table of tables")
    for arm, each in tables.items():
        if not isinstance(each, dict):
            raise RefusedCommand("arms is no table of tables")
        if arm not in ARMS:
            raise RefusedCommand("unknown arm")
    return tables


def speeds(given: Mapping[str, Any]) -> tuple[float, ...]:
    """An arm's table of a message "input", as STILL: move and turn cut to length 1, grasp to -1
    .. 1.
    """
    move = _at_most_one(_numbers(given, "move", 3)) if "move" in given else (0.0, 0.0, 0.0)
    turn = _at_most_one(_numbers(given, "turn", 3)) if "turn" in given else (0.0, 0.0, 0.0)
    return *move, *turn, min(max(_number(given, "grasp"), -1.0), 1.0)


def _at_most_one(v: Sequence[float]) -> Sequence[float]:
    length = math.hypot(*v)
    return v if length <= 1.0 else tuple(x / length for x in v)


def _numbers(given: Mapping[str, Any], name: str, count: int) -> Sequence[float]:
    values = given.get(name)
    if not isinstance(values, _LIST) or len(values) != count:
        raise RefusedCommand(f"{name} is not {count} finite numbers")
    for value in values:
        if not _is_number(value):
            raise RefusedCommand(f"{name} is not {count} finite numbers")
    return values


def _number(given: Mapping[str, Any], name: str) -> float:
    value = given.get(name, 0.0)
    if not _is_number(value):
        raise RefusedCommand(f"{name} is no finite number")
    return value


def _is_number(value: Any) -> bool:
    # 1e9 keeps whole numbers exact and squares finite
    return (
        isinstance(value, _NUMBER)
        and value is not True
        and value is not False
        and -1e9 <= value <= 1e9
    )
