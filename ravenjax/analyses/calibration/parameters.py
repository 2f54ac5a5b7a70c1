"""Defines the robot parameters that a calibration can estimate from a log, with their prior
distributions.

The module also writes a calibrated robot as a TOML file. A campaign reads the file by `[parameters]
from`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import LoopParams
from ravenjax.bundled import resources
from ravenjax.errors import UserError, suggest_name
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec, replace
from ravenjax.report import wording
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.robots.raven2.plant import robot

COMMAND_DELAY, SETPOINT_DELAY = "command_delay", "setpoint_delay"
USUAL_DELAY_MS = 1.0
"""Median of the prior: one frame of full-speed USB. With the spread below, 90 % of it lies between
0.3 and 3.2 ms.
"""
LONGEST_DELAY_MS = 6


class Unknown(NamedTuple):
    """One number that is estimated from a log. Its prior is normal; for a ratio, the prior of its
    logarithm is.
    """

    name: str
    # Fields of LoopParams, separated by dots: plant.actuators.coulomb. A ratio changes all of them
    # by the same factor.
    fields: tuple[str, ...]
    joint: int | None  # joint of fields with seven values; None: fields with one
    # Standard deviation: of the logarithm of a ratio, else in the field's unit.
    spread: float
    # True if it is estimated as a ratio to the value before.
    ratio: bool

    @property
    def path(self) -> str:
        """Return the name with its joint, such as `dry_friction.tool_roll`."""
        return self.name if self.joint is None else f"{self.name}.{JOINTS[self.joint]}"


BELIEFS = resources.read_tables(__file__, "beliefs.toml")
ASKS = tuple(BELIEFS)


def select_unknowns(joints: Sequence[int], asks: Sequence[str] = ASKS) -> tuple[Unknown, ...]:
    """Return the unknowns to estimate from a log that has these joints (0 to 6). Raises UserError
    for a name that is not in ASKS.
    """
    if invalid := [one for one in asks if one not in ASKS]:
        raise UserError(
            f"got {', '.join(invalid)}, expected some of {', '.join(ASKS)}, separated by commas"
            f"{suggest_name(invalid[0], ASKS)}"
        )
    return tuple(
        Unknown(name, tuple(belief["fields"]), joint, belief["spread"], belief["ratio"])
        for ask in ASKS
        if ask in asks
        for name, belief in BELIEFS[ask].items()
        for joint in ([None] if ask == "delays" else joints)
    )


def prior_robot(plant: robot.PlantParams, wanted: Sequence[Unknown]) -> LoopParams:
    """Return a robot with prior parameters, and the usual delay if it is estimated."""
    delayed = any(COMMAND_DELAY in one.fields for one in wanted)
    return replace(position_loop.params(plant), command_delay=USUAL_DELAY_MS if delayed else 0.0)


def prior_values(base: LoopParams, wanted: Sequence[Unknown]) -> np.ndarray:
    """Return the values of the unknowns in `base`, from the first field of each, [k]."""
    return np.array([float(_number(base, one.fields[0], one.joint)) for one in wanted])


def apply_steps(base: LoopParams, wanted: Sequence[Unknown], steps: Any) -> LoopParams:
    """Return `base` with each unknown moved by `steps` [k], in spreads. May be traced by JAX."""
    for k, one in enumerate(wanted):
        for field in one.fields:
            moved = moved_by(_number(base, field, one.joint), one, steps[k])
            base = _with(base, field.split("."), one.joint, moved)
    return base


def values_by_path(
    base: LoopParams, wanted: Sequence[Unknown], steps: np.ndarray
) -> dict[str, np.ndarray]:
    """Return every number that `steps` [n, k] move, [n], by its path in `LoopParams`."""
    return {
        field if one.joint is None else f"{field}.{JOINTS[one.joint]}": np.asarray(
            moved_by(float(_number(base, field, one.joint)), one, steps[:, k]), float
        )
        for k, one in enumerate(wanted)
        for field in one.fields
    }


def moved_by(value, one: Unknown, steps):
    """Return a value (in its unit) after it is moved by `steps` spreads."""
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


DELAY = "usb.command_delay"
"""Name of COMMAND_DELAY in a campaign, where it is in whole cycles."""


def format_robot_file(
    values: Mapping[str, np.ndarray], arm: ArmName, parameter_set: str, log: Path
) -> str:
    """Return TOML of numbers [n] by path in `LoopParams`. The n-th numbers together are one robot.

    SETPOINT_DELAY belongs to the log and is left out.
    """
    listed = {
        f"plant.{arm}.{path.removeprefix('plant.')}": [float(f"{value:.6g}") for value in draws]
        for path, draws in values.items()
        if path not in (COMMAND_DELAY, SETPOINT_DELAY)
    }
    if COMMAND_DELAY in values:
        cycles = np.clip(np.round(values[COMMAND_DELAY]), 0, LONGEST_DELAY_MS)
        listed[DELAY] = cycles.astype(int).tolist()
    template = wording.text_templates(__package__).get_template("robots.toml.j2")
    number = len(next(iter(values.values())))
    return template.render(number=number, log=log, parameter_set=parameter_set, values=listed)
