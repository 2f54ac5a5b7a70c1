"""Defines the robot parameters that a calibration can estimate from a log, and their priors.

The module also writes a calibrated robot as a TOML file, for the key `from` of [parameters].
"""

import operator
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import resources
from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import LoopParams
from ravenjax.errors import UserError, suggest_name
from ravenjax.numbers import paths, tree
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import replace
from ravenjax.report import wording
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

COMMAND_DELAY, SETPOINT_DELAY = "command_delay", "setpoint_delay"
USUAL_DELAY_MS = 1.0
"""Median of the prior of the command delay: one frame of full-speed USB. With the spread in
beliefs.toml, 90 % of the prior lies between 0.3 and 3.2 ms.
"""
LONGEST_DELAY_MS = 6


class Unknown(NamedTuple):
    """A parameter to estimate from a log. Its prior, or that of a ratio's logarithm, is normal."""

    name: str
    # Fields of LoopParams, separated by dots: plant.actuators.coulomb. A ratio is a factor on all.
    fields: tuple[str, ...]
    joint: int | None  # index of the joint, for fields with seven values; None for one value
    spread: float  # standard deviation of the prior, in the field's unit or of the log ratio
    ratio: bool  # True if the parameter is estimated as a ratio to its value before

    @property
    def path(self) -> str:
        """Return the name with its joint, such as `dry_friction.tool_roll`."""
        return self.name if self.joint is None else f"{self.name}.{JOINTS[self.joint]}"


BELIEFS = resources.read_tables(__file__, "beliefs.toml")
ASKS = tuple(BELIEFS)


def select_unknowns(joints: Sequence[int], asks: Sequence[str] = ASKS) -> tuple[Unknown, ...]:
    """Return the unknowns to estimate from a log that has these joints (0 to 6).

    `asks`: names of groups of parameters. Raise UserError for a name that is not in ASKS.
    """
    if invalid := [ask for ask in asks if ask not in ASKS]:
        raise UserError(
            f"--ask {', '.join(invalid)}: unknown, expected some of {', '.join(ASKS)}, separated by"
            f" commas{suggest_name(invalid[0], ASKS)}"
        )
    # A delay is one number for all joints; every other parameter has a number for each joint.
    return tuple(
        Unknown(name, tuple(belief["fields"]), joint, belief["spread"], belief["ratio"])
        for ask in ASKS
        if ask in asks
        for name, belief in BELIEFS[ask].items()
        for joint in ([None] if ask == "delays" else joints)
    )


def prior_robot(plant: robot.PlantParams, wanted: Sequence[Unknown]) -> LoopParams:
    """Return a robot with the prior parameters. A command delay that is not in `wanted` is 0."""
    delayed = any(COMMAND_DELAY in one.fields for one in wanted)
    return replace(position_loop.params(plant), command_delay=USUAL_DELAY_MS if delayed else 0.0)


def prior_values(base: LoopParams, wanted: Sequence[Unknown]) -> np.ndarray:
    """Return the values [k] of the unknowns in the robot `base`, each from its first field."""
    return np.array([_number(base, one.fields[0], one.joint) for one in wanted])


def apply_steps(base: LoopParams, wanted: Sequence[Unknown], steps: Any) -> LoopParams:
    """Return `base` with each unknown changed by `steps` [k], in prior standard deviations."""
    # JAX may trace this function. values_by_path takes the steps of n robots. Here n is 1.
    moved = {path: values[0] for path, values in values_by_path(base, wanted, steps[None]).items()}
    leaves = paths.path_leaves(base, RavenSetup())
    return tree.fill_tree(base, [moved.get(path, value) for path, value in leaves])


def values_by_path(
    base: LoopParams, wanted: Sequence[Unknown], steps: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the values [n] of every changed number, by its path in `LoopParams`. `steps`: [n, k],
    changes of the k unknowns for n robots, in prior standard deviations.
    """
    exp = jnp.exp if isinstance(steps, jax.Array) else np.exp
    moved = {}
    for unknown, change in zip(wanted, steps.T, strict=True):
        # The change in the unit of the parameter, or of the logarithm of a ratio.
        shift = unknown.spread * change
        for field in unknown.fields:
            path = field if unknown.joint is None else f"{field}.{JOINTS[unknown.joint]}"
            value = _number(base, field, unknown.joint)
            moved[path] = value * exp(shift) if unknown.ratio else value + shift
    return moved


def _number(params: LoopParams, field: str, joint: int | None) -> float:
    number = operator.attrgetter(field)(params)
    return float(number if joint is None else number[joint])


DELAY = "usb.command_delay"
"""Path of the command delay in a campaign, where the delay is in whole cycles."""


def format_robot_file(
    values: Mapping[str, np.ndarray], arm: ArmName, parameter_set: str, log: Path
) -> str:
    """Return the text of a robot file in TOML. `values`: numbers [n] for n robots, by path in
    `LoopParams`. SETPOINT_DELAY is left out, because it is a property of the log.
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
