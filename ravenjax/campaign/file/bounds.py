"""What each parameter of a campaign may be, as the records of its robot say, and the check of an
axis against it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

from ravenjax.campaign.file.axis import Axis
from ravenjax.errors import shown
from ravenjax.numbers import paths, quantity
from ravenjax.numbers.quantity import Quantity
from ravenjax.vocabulary.robot import Robot

TAIL = 7.04
"""Standard deviations: `Axis.at` of a normal distribution never goes farther (quantiles from
1e-12).
"""


@functools.cache
def rows(robot: Robot) -> tuple[tuple[str, Quantity], ...]:
    """(path as `plain` gives it, what it may be) of each parameter, in order; two where joints
    are unlike.
    """
    return tuple(quantity.quantities(robot.part("campaign").Params))


@functools.cache
def names(robot: Robot) -> frozenset[str]:
    """Every word of a parameter's path but arms and numbers."""
    return paths.components(robot.joints).union(*(path.split(".") for path, _ in rows(robot)))


@functools.cache
def _reserved(robot: Robot) -> tuple[tuple[str, str], ...]:
    """(path, why) of parameters, or all that begin so, that a campaign must leave alone; longer
    paths first.
    """
    rows_of = quantity.reserved(robot.part("campaign").Params)
    return tuple(sorted(rows_of, key=lambda row: len(row[0]), reverse=True))


def plain(robot: Robot, path: str) -> str:
    """A parameter's path without arm, number of a set, joint or axis."""
    return paths.plain(path, robot.arms, robot.joints)


Ranges = tuple[tuple[str, Quantity], ...]
"""(path as `plain` gives it, what it may be) of parameters."""


def of(robot: Robot, path: str, more: Ranges = ()) -> list[Quantity]:
    """What `path` may be: one for a single number, more where it names a whole vector of unlike
    ones.

    more: parameters that a campaign has beside those of its robot.
    """
    kind, last = plain(robot, path), path.rpartition(".")[2]
    matches = [row for name, row in (*rows(robot), *more) if name == kind]
    return [
        row for row in matches if last in row.joints or not row.joints or last not in robot.joints
    ]


def reserved(robot: Robot, path: str) -> str:
    """Why a campaign must leave a parameter alone, and what to write instead; "" for one that it
    may vary.
    """
    kind = plain(robot, path)
    return next(
        (why for name, why in _reserved(robot) if kind == name or kind.startswith(f"{name}.")), ""
    )


def complaints(robot: Robot, path: str, axis: Axis, more: Ranges = ()) -> Iterator[str]:
    """What is wrong with the values that a parameter would take; nothing for a path that no
    record knows.
    """
    if why := reserved(robot, path):
        yield f"cannot be set: {why}"
    for row in of(robot, path, more):
        if row.whole and axis.drawn and not axis.listed:
            yield f"{axis.kind} draws fractions, expected {row}; write {{choice = [..]}}"
            continue
        for got, value in _extremes(axis):
            if not row.low <= value <= row.high:
                yield f"got {got}, expected {row}{_hint(row, axis)}"
                break
            if row.whole and value != int(value):
                yield f"got {got}, expected {row}"
                break


def extent(axis: Axis) -> tuple[float, float]:
    """Least and greatest number that a distribution may draw."""
    low, high = axis.values
    return (low - TAIL * high, low + TAIL * high) if axis.kind == "normal" else (low, high)


def _extremes(axis: Axis) -> Iterator[tuple[str, float]]:
    """(as it is told, value) of each listed value, or of the ends of what can be drawn."""
    if axis.listed:
        yield from ((shown(value), value) for value in axis.values)
        return
    for end, value in zip(("as low as", "as high as"), extent(axis), strict=True):
        yield f"{axis.kind} = {shown(list(axis.values))}, which may draw {end} {value:.6g}", value


def _hint(row: Quantity, axis: Axis) -> str:
    if axis.kind != "normal":
        return ""
    room = min(axis.values[0] - row.low, row.high - axis.values[0]) / TAIL
    smaller = f" up to {math.floor(room * 1e4) / 1e4:g}" if room >= 1e-4 else ""
    return (
        f"; take a standard deviation{smaller} that cannot leave it, or {{uniform = [low, high]}}"
    )
