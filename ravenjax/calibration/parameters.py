"""What a log may tell of a robot: numbers of `robot.PlantParams`, each with what is believed of it before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.plant import robot


class Unknown(NamedTuple):
    """One number that a log is asked for, normal before the log is seen; of a ratio the logarithm is."""

    name: str
    fields: tuple[str, ...]  # of PlantParams, dots between: actuators.coulomb; a ratio moves all of them alike
    joint: int | None  # of fields with seven; None: fields with one
    spread: float  # standard deviation: of the logarithm of a ratio, else in the field's unit
    ratio: bool  # whether it is estimated as a ratio to the value before

    @property
    def path(self) -> str:
        """`dry_friction.tool_roll`"""
        return self.name if self.joint is None else f"{self.name}.{JOINTS[self.joint]}"


BELIEFS = (  # name, fields, spread, whether a ratio; why
    # two recorded arms differ by factors up to 1.7; how motor and joint share it is not told, and not asked
    ("dry_friction", ("actuators.coulomb", "link_coulomb"), 0.6, True),
    ("viscous_friction", ("actuators.viscous",), 1.0, True),
    ("offset", ("actuators.bias",), 0.02, False),  # N m; some 70 counts: the amplifier, and weight not modelled
)
"""Inertia and cables are not asked for: half a minute of a log leaves them as uncertain as they were."""


def unknowns(joints: Sequence[int]) -> tuple[Unknown, ...]:
    """What is asked of a log that has these joints (0 to 6)."""
    return tuple(
        Unknown(name, fields, joint, spread, ratio) for name, fields, spread, ratio in BELIEFS for joint in joints
    )


def before(base: robot.PlantParams, wanted: Sequence[Unknown]) -> np.ndarray:
    """Their values in `base`, of the first field of each, [k]."""
    return np.array([float(_number(base, one.fields[0], one.joint)) for one in wanted])


def apply(base: robot.PlantParams, wanted: Sequence[Unknown], steps: jax.Array) -> robot.PlantParams:
    """`base` with each unknown moved by `steps` [k], in its spreads; to be traced."""
    for k, one in enumerate(wanted):
        for field in one.fields:
            moved = moved_by(_number(base, field, one.joint), one, steps[k])
            base = _with(base, field.split("."), one.joint, moved)
    return base


def values(base: robot.PlantParams, wanted: Sequence[Unknown], steps: np.ndarray) -> dict[str, np.ndarray]:
    """Every number that `steps` [n, k] move, [n] by its path in `PlantParams`: `actuators.coulomb.shoulder`."""
    return {
        field if one.joint is None else f"{field}.{JOINTS[one.joint]}": np.asarray(
            moved_by(float(_number(base, field, one.joint)), one, steps[:, k]), float
        )
        for k, one in enumerate(wanted)
        for field in one.fields
    }


def moved_by(value, one: Unknown, steps):
    """A value (its unit) that is moved by `steps` spreads."""
    return value * jnp.exp(one.spread * steps) if one.ratio else value + one.spread * steps


def _number(params: Any, field: str, joint: int | None) -> Any:
    for name in field.split("."):
        params = getattr(params, name)
    return params if joint is None else params[joint]


def _with(params: Any, names: list[str], joint: int | None, value):
    name, *rest = names
    inner = getattr(params, name)
    if rest:
        return replace(params, **{name: _with(inner, rest, joint, value)})
    return replace(params, **{name: value if joint is None else Vec(inner).replace(joint, value)})
