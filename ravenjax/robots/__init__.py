"""The robots. The folder of a robot declares arms, joints, sites and checks, and contains the tick.

`find_robot` returns the declaration of a robot by name. A user's robot is a module beside the
campaign, in the current folder, or on Python's path. Such a module declares ROBOT, and a campaign
names the module: `[campaign] robot = "my_lab.arm"`.
"""

import ast
import functools
import importlib
import importlib.util
import sys
import traceback
import types
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from typing import Any

from ravenjax import consent
from ravenjax.errors import UserError
from ravenjax.vocabulary.robot import Robot

DEFAULT = "raven2"
"""Name of the robot of a campaign that does not name a robot."""
MJCF = ".xml"
"""Ending of the name of a robot that is an MJCF file."""


def find_robot(name: str, folder: Path | None = None) -> Robot:
    """Return the robot with this name: a bundled robot, a module with ROBOT, or an MJCF file.

    folder: folder of the campaign, where the module or file may be. Raises UserError, also if the
    user has not agreed to run the module.
    """
    if not name.endswith(MJCF):
        return _find_declared(name, folder)
    candidates = dict.fromkeys((place / name).resolve() for place in (folder or Path(), Path()))
    for file in candidates:
        if file.is_file():
            # Imported only here, because MuJoCo is slow to import.
            return importlib.import_module(f"{__name__}.mjcf").read_robot(file)
    searched = ", ".join(map(str, candidates))
    raise UserError(f"robot {name!r}: no file was found at {searched}")


@functools.cache
def _find_declared(name: str, folder: Path | None) -> Robot:
    # Imports the module of a bundled or a user's robot. Returns its ROBOT.
    places = () if name == DEFAULT else (folder or Path(), Path())
    places = list(dict.fromkeys(str(place.resolve()) for place in places))
    for module in (f"{__name__}.{name}", name):
        top, file = _find_module(module, places)
        if top is None or file is None or not file.is_file():
            continue
        try:
            # A bundled robot needs no agreement. A module that was imported before has run already.
            if module == name and name not in sys.modules:
                _require_agreement(top, file)
            robot = getattr(importlib.import_module(module), "ROBOT", None)
        except UserError:
            raise
        # The user's code may raise anything.
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            raise UserError(
                f"robot {name!r}: {file} cannot be imported: {type(error).__name__}: {error}"
                f" ({frame.filename}:{frame.lineno})"
            ) from error
        if not isinstance(robot, Robot):
            raise UserError(
                f"robot {name!r}: the module {module} has no variable ROBOT, expected a"
                " ravenjax.vocabulary.robot.Robot"
            )
        return robot
    searched = ", ".join(dict.fromkeys([*places, *filter(None, sys.path)]))
    raise UserError(
        f"robot {name!r} is unknown: expected {DEFAULT!r}, a file {MJCF}, or a module that declares"
        f" ROBOT. No such module is in {searched}"
    )


def _find_module(module: str, places: list[str]) -> tuple[ModuleSpec | None, Path | None]:
    """Return a module's top package and the module's file, without importing any package. places:
    folders that are searched after Python's path.
    """
    first, *rest = module.split(".")
    try:
        top = spec = importlib.util.find_spec(first) or PathFinder.find_spec(first, places)
        for name in rest:
            inner = (spec and spec.submodule_search_locations) or []
            spec = spec and PathFinder.find_spec(f"{spec.name}.{name}", inner)
    except (ModuleNotFoundError, ValueError):
        return None, None
    return top, Path(spec.origin) if spec and spec.origin else None


def _require_agreement(top: ModuleSpec, file: Path):
    """Raise UserError unless the user agrees to run a module. The agreement includes all Python
    files of the module's top package or, for a module without a package, the files of its folder
    that it imports.
    """
    folders = top.submodule_search_locations
    files = [path for folder in folders or () for path in Path(folder).rglob("*.py")]
    files = sorted(files or imported_beside(file))
    content = b"".join(f"{path}\0".encode() + path.read_bytes() for path in files)
    consent.require_consent(file, content, robot=files)
    # A module that is not on Python's path needs a finder, to be imported from its folder.
    if importlib.util.find_spec(top.name) is None:
        agreed = {top.name} if folders else {path.stem for path in files}
        folder = str((Path(folders[0]) if folders else file).parent)

        def find_spec(name: str, path=None, _: object = None) -> ModuleSpec | None:
            # Finds only modules and packages of this folder that the user agreed to run.
            is_agreed = name.partition(".")[0] in agreed
            spec = PathFinder.find_spec(name, path or [folder]) if is_agreed else None
            if spec is not None and spec.origin is not None:
                if not isinstance(spec.loader, SourceFileLoader):
                    raise ImportError(f"expected the Python source of {name}, got {spec.origin}")
                spec.loader = _Source(name, spec.origin)
            return spec

        finder: Any = types.SimpleNamespace(find_spec=find_spec)
        sys.meta_path.insert(0, finder)


class _Source(SourceFileLoader):
    def get_code(self, fullname: str) -> types.CodeType:
        # Bytecode beside the source may be that of other code.
        return self.source_to_code(self.get_data(self.path), self.path)


def imported_beside(module: Path) -> set[Path]:
    """Return a module's file and the files of its folder that it imports, also indirectly."""
    files, waiting = set[Path](), [module]
    while waiting:
        path = waiting.pop()
        if path in files or not path.is_file():
            continue
        files.add(path)
        for node in ast.walk(ast.parse(path.read_bytes())):
            # `from a.b import c` may import a.py, b.py or c.py of the folder.
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
                waiting += [
                    path.with_name(f"{part}.py") for name in names for part in name.split(".")
                ]
    return files


USUAL = find_robot(DEFAULT)
"""Declaration of the default robot."""
