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

    field: str  # of PlantParams, dots between: actuators.coulomb
    joint: int | None  # of a field with seven; None: a field with one
    spread: float  # standard deviation: of the logarithm of a ratio, else in the field's unit
    ratio: bool  # whether it is estimated as a ratio to the value before

    @property
    def path(self) -> str:
        """As a campaign's file names it below the arm: `actuators.coulomb.tool_roll`."""
        return self.field if self.joint is None else f"{self.field}.{JOINTS[self.joint]}"


BELIEFS = (  # field, spread, whether a ratio; why
    ("actuators.coulomb", 1.0, True),  # friction differs between robots by factors
    ("actuators.viscous", 2.0, True),  # of the tool it was an assumption
    ("link_coulomb", 1.0, True),
    ("actuators.bias", 0.02, False),  # N m; some 70 counts: the amplifier's offset, and gravity that is not modelled
)
"""Inertia and cables are not asked for: half a minute of a log leaves them as uncertain as they were."""


def unknowns(joints: Sequence[int]) -> tuple[Unknown, ...]:
    """What is asked of a log that has these joints (0 to 6)."""
    return tuple(Unknown(field, joint, spread, ratio) for field, spread, ratio in BELIEFS for joint in joints)


def before(base: robot.PlantParams, wanted: Sequence[Unknown]) -> np.ndarray:
    """Their values in `base`, [k]."""
    return np.array([float(_number(base, one)) for one in wanted])


def apply(base: robot.PlantParams, wanted: Sequence[Unknown], steps: jax.Array) -> robot.PlantParams:
    """`base` with each unknown moved by `steps` [k], in its spreads; to be traced."""
    for k, one in enumerate(wanted):
        moved = moved_by(_number(base, one), one, steps[k])
        base = _with(base, one.field.split("."), one.joint, moved)
    return base


def moved_by(value, one: Unknown, steps):
    """A value (its unit) that is moved by `steps` spreads."""
    return value * jnp.exp(one.spread * steps) if one.ratio else value + one.spread * steps


def _number(params: Any, one: Unknown) -> Any:
    for name in one.field.split("."):
        params = getattr(params, name)
    return params if one.joint is None else params[one.joint]


def _with(params: Any, names: list[str], joint: int | None, value):
    name, *rest = names
    inner = getattr(params, name)
    if rest:
        return replace(params, **{name: _with(inner, rest, joint, value)})
    return replace(params, **{name: value if joint is None else Vec(inner).replace(joint, value)})
