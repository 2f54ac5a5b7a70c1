"""The parameters that a log is asked for: numbers of `LoopParams` with their prior
distributions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import LoopParams
from ravenjax.errors import UserError, suggestion
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.plant import robot

COMMAND_DELAY, SETPOINT_DELAY = "command_delay", "setpoint_delay"
USUAL_DELAY_MS = 1.0
"""Median of the belief: a frame of full-speed USB; with the spread below 90 % of it lie between
0.3 and 3.2 ms.
"""
LONGEST_DELAY_MS = 6


class Unknown(NamedTuple):
    """One number that a log is asked for, normal before the log is seen; of a ratio the
    logarithm is.
    """

    name: str
    fields: tuple[
        str, ...
    ]  # of LoopParams, dots between: plant.actuators.coulomb; a ratio moves all of them alike
    joint: int | None  # of fields with seven; None: fields with one
    spread: float  # standard deviation: of the logarithm of a ratio, else in the field's unit
    ratio: bool  # whether it is estimated as a ratio to the value before

    @property
    def path(self) -> str:
        """`dry_friction.tool_roll`"""
        return self.name if self.joint is None else f"{self.name}.{JOINTS[self.joint]}"


BELIEFS = {  # what may be asked for -> name, fields, spread, whether a ratio; why
    "friction": (
        # two recorded arms differ by factors up to 1.7; how motor and joint share it is not told,
        # and not asked
        ("dry_friction", ("plant.actuators.coulomb", "plant.link_coulomb"), 0.6, True),
        ("viscous_friction", ("plant.actuators.viscous",), 1.0, True),
    ),
    # N m; some 70 counts: the amplifier, and weight not modelled
    "offsets": (("offset", ("plant.actuators.bias",), 0.02, False),),
    # torque a count: published 0.94 to 1 of the controller's, gains 0.8 to 1; widened to both sides
    # by assumption
    "motors": (("motor_constant", ("plant.actuators.gain",), 0.1, True),),
    "cables": (
        (
            "cable_stiffness",
            ("plant.cable_stiffness",),
            0.5,
            True,
        ),  # published sets 1 to 3 times; worn cables: assumed
        ("cable_damping", ("plant.cable_damping",), 0.7, True),  # published sets 0.25 to 3 times
    ),
    "delays": (
        # assumed, as in the study of an uncertain robot: from none to three frames of full-speed
        # USB
        (COMMAND_DELAY, (COMMAND_DELAY,), 0.7, True),
        # ms; assumed: whether a log's desired joints are those of its cycle or of a neighbour's
        (SETPOINT_DELAY, (SETPOINT_DELAY,), 1.0, False),
    ),
}
"""Inertia is not asked for: half a minute of a log leaves it as uncertain as it was."""
ASKS = tuple(BELIEFS)


def unknowns(joints: Sequence[int], asks: Sequence[str] = ASKS) -> tuple[Unknown, ...]:
    """What is asked of a log that has these joints (0 to 6). UserError for an ask that is not of
    ASKS.
    """
    if invalid := [one for one in asks if one not in ASKS]:
        raise UserError(
            f"got {', '.join(invalid)}, expected some of {', '.join(ASKS)}, a comma between"
            f"{suggestion(invalid[0], ASKS)}"
        )
    return tuple(
        Unknown(name, fields, joint, spread, ratio)
        for ask in ASKS
        if ask in asks
        for name, fields, spread, ratio in BELIEFS[ask]
        for joint in ([None] if ask == "delays" else joints)
    )


def believed(plant: robot.PlantParams, wanted: Sequence[Unknown]) -> LoopParams:
    """A robot before the log: with the usual delay where it is asked for, else with none."""
    delayed = any(COMMAND_DELAY in one.fields for one in wanted)
    return replace(position_loop.params(plant), command_delay=USUAL_DELAY_MS if delayed else 0.0)


def before(base: LoopParams, wanted: Sequence[Unknown]) -> np.ndarray:
    """Their values in `base`, of the first field of each, [k]."""
    return np.array([float(_number(base, one.fields[0], one.joint)) for one in wanted])


def apply(base: LoopParams, wanted: Sequence[Unknown], steps: Any) -> LoopParams:
    """`base` with each unknown moved by `steps` [k], in its spreads; may be traced."""
    for k, one in enumerate(wanted):
        for field in one.fields:
            moved = moved_by(_number(base, field, one.joint), one, steps[k])
            base = _with(base, field.split("."), one.joint, moved)
    return base


def values(base: LoopParams, wanted: Sequence[Unknown], steps: np.ndarray) -> dict[str, np.ndarray]:
    """Every number that `steps` [n, k] move, [n] by its path in `LoopParams`:
    `plant.actuators.coulomb.shoulder`.
    """
    return {
        field if one.joint is None else f"{field}.{JOINTS[one.joint]}": np.asarray(
            moved_by(float(_number(base, field, one.joint)), one, steps[:, k]), float
        )
        for k, one in enumerate(wanted)
        for field in one.fields
    }


def moved_by(value, one: Unknown, steps):
    """A value (its unit) that is moved by `steps` spreads."""
    exp = jnp.exp if isinstance(steps, jax.Array) else np.exp
    return value * exp(one.spread * steps) if one.ratio else value + one.spread * steps


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
