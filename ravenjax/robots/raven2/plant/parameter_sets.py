"""Lists the sets of mechanical parameters that a campaign can choose by name.

models/raven2/mechanics.toml has their numbers, with units and sources.
"""

import dataclasses
import functools
import tomllib
from typing import Literal, NamedTuple, get_args

from ravenjax import resources
from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.numbers import Vec
from ravenjax.robots.raven2.plant.drives import ActuatorParams

Name = Literal["power_consistent", "traj3", "A", "B", "C", "D", "E", "matlab_main", "matlab_global"]

DEFAULT: Name = "power_consistent"
"""Default parameter set of a campaign's robot."""
PUBLISHED = get_args(Name)[1:]
"""Parameter sets of the published dynamic models."""


class ParameterSet(NamedTuple):
    """Seven motors with their cables and joints; `robot.PlantParams` has the units."""

    actuators: ActuatorParams
    cable_stiffness: Vec
    cable_damping: Vec
    cable_strength: Vec
    link_coulomb: Vec
    link_viscous: Vec


@functools.cache
def parameter_set(name: str) -> ParameterSet:
    """Return the parameter set of that name. Raises UserError, which lists the names."""
    if name not in get_args(Name):
        raise UserError(describe_unknown_name("parameter set", name, get_args(Name)))
    file = tomllib.loads(resources.find_model("raven2/mechanics.toml").read_text(encoding="utf-8"))
    rows = dict(file["published" if name in PUBLISHED else name])
    if name in PUBLISHED:
        # A published set differs from the table `published` in shoulder, elbow and insertion only:
        # `factors` multiply their values, `inputs` replace them.
        for key, factors in file["factors"][name].items():
            positioning = [x * factor for x, factor in zip(rows[key][:3], factors, strict=True)]
            rows[key] = positioning + rows[key][3:]
        for key, positioning in file["inputs"].get(name, {}).items():
            rows[key] = positioning + rows[key][3:]
    numbers = {key: Vec(row) for key, row in rows.items()}
    motors = [numbers.pop(field.name) for field in dataclasses.fields(ActuatorParams)]
    return ParameterSet(ActuatorParams(*motors), **numbers)
