"""Robots: one folder for each, which declares arms, joints, sites and checks, and holds the tick.

`find` returns the declaration of a robot by name. Other robots live in any module that Python can
import. Such a module declares ROBOT, and a campaign names the module: `[campaign] robot =
"my_lab.arm"`.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util

from ravenjax.errors import UserError
from ravenjax.vocabulary.robot import Robot

DEFAULT = "raven2"
"""Name of the robot of a campaign that names none."""


@functools.cache
def find(name: str) -> Robot:
    """Return a robot: a folder here, or a module that declares ROBOT. Raises UserError."""
    for module in (f"{__name__}.{name}", name):
        try:
            if importlib.util.find_spec(module) is None:
                continue
        except (ModuleNotFoundError, ValueError):
            continue
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


USUAL = find(DEFAULT)
"""Declaration of the default robot."""
