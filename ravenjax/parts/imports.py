"""Modules beside a part's file: what it imports from its own folder counts as its content."""

from __future__ import annotations

import builtins
import hashlib
import sys
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.parts import files


def run(code: Any, module: types.ModuleType, path: Path) -> None:
    """Run the code of the part at `path` in its module; its imports find modules beside it
    first, as a script's do.
    """
    _run(code, module, _Imports(module.__name__, path.parent))


class _Imports:
    """`__import__` of one part, and of the modules beside it.

    No other part has these modules, nor has `sys.modules` by their plain names: two campaigns may
    have two `filters`.
    """

    def __init__(self, part: str, folder: Path) -> None:
        self._part, self._folder = part, folder
        self._modules: dict[str, types.ModuleType] = {}

    def __call__(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> types.ModuleType:
        own = self._modules.get(name) or (None if level or "." in name else self._found(name))
        return own or builtins.__import__(name, globals, locals, fromlist, level)

    def _found(self, name: str) -> types.ModuleType | None:
        """A module beside the part, run now; None where there is none of that name."""
        file = f"{name}.py"
        if not files.reading():
            if (self._folder / file).is_file():
                raise ImportError(
                    f"import {name} at the top of the file, so that its text counts as content"
                )
            return None
        try:
            content = files.content(file)
        except OSError:
            return None
        path = self._folder / file
        code = compile(content, str(path), "exec")
        # a name of its own: annotations of its records are looked up by it
        module = types.ModuleType(f"{self._part}_{name}_{hashlib.sha256(content).hexdigest()[:16]}")
        module.__file__ = str(path)
        self._modules[name] = module
        try:
            _run(code, module, self)
        except BaseException:
            del self._modules[name]
            raise
        return module


def _run(code: Any, module: types.ModuleType, imports: _Imports) -> None:
    """Run code in a module, which is known by its name to those who ask for the names in it."""
    module.__dict__["__builtins__"] = {**vars(builtins), "__import__": imports}
    sys.modules[module.__name__] = module
    try:
        exec(code, module.__dict__)
    except BaseException:
        del sys.modules[module.__name__]
        raise
