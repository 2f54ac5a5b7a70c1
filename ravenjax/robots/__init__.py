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
            files = _package_files(name, file)
            content = b"".join(f"{path}\0".encode() + path.read_bytes() for path in files)
            consent.require_consent(file, content, robot=files)
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


def _package_files(module: str, file: Path) -> list[Path]:
    """Return all Python files of the top package of a module; of a module alone, its file."""
    spec = importlib.util.find_spec(module.partition(".")[0])
    places = (spec and spec.submodule_search_locations) or []
    return sorted(path for place in places for path in Path(place).rglob("*.py")) or [file]


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
