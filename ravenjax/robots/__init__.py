"""Robots: one folder for each, which declares arms, joints, sites and checks, and holds the tick.

`find_robot` returns the declaration of a robot by name. Other robots live in any module that
Python can import. Such a module declares ROBOT, and a campaign names the module: `[campaign] robot
= "my_lab.arm"`.
"""

import functools
import importlib
import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path

from ravenjax import consent
from ravenjax.errors import UserError
from ravenjax.vocabulary.robot import Robot

DEFAULT = "raven2"
"""Name of the robot of a campaign that names none."""


@functools.cache
def find_robot(name: str) -> Robot:
    """Return a robot: a folder here, or a module that declares ROBOT.

    Raises UserError, also if the user has not agreed to run that module.
    """
    for module in (f"{__name__}.{name}", name):
        if (file := _source(module)) is None:
            continue
        if module == name and name not in sys.modules:
            consent.require_consent(file, file.read_bytes(), is_robot=True)
        robot = getattr(importlib.import_module(module), "ROBOT", None)
        if not isinstance(robot, Robot):
            raise UserError(
                f"robot {name!r}: the module {module} declares no ROBOT of"
                " ravenjax.vocabulary.robot.Robot"
            )
        return robot
    raise UserError(
        f"robot {name!r} is unknown: expected {DEFAULT!r}, or the name of a module that Python can"
        " import and that declares ROBOT"
    )


def _source(module: str) -> Path | None:
    """Return the file of a module, without importing the packages that hold it."""
    first, *rest = module.split(".")
    try:
        spec = importlib.util.find_spec(first)
        for name in rest:
            places = (spec and spec.submodule_search_locations) or []
            spec = spec and PathFinder.find_spec(f"{spec.name}.{name}", places)
    except (ModuleNotFoundError, ValueError):
        return None
    origin = spec and spec.origin
    return file if origin and (file := Path(origin)).is_file() else None


USUAL = find_robot(DEFAULT)
"""Declaration of the default robot."""
