"""Runs the code of a user's Python file, and collects the files of its folder that the code reads.

Campaigns store a hash of the user's file and of these files.
"""

import builtins
import dataclasses
import hashlib
import io
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError, format_value


@dataclasses.dataclass(eq=False)
class Reader:
    """Runs a user's file, and the modules in its folder that it imports. Only this file can import
    these modules. They are not in `sys.modules` under their plain names, so two campaigns may have
    different modules with the name `filters`.
    """

    name: str  # name of the file's module
    folder: Path
    # Content of files that were read before, perhaps in another process. None: read the folder.
    known: Mapping[str, bytes] | None
    require_allowed: Callable[[Path, bytes], None]  # raises UserError for code that must not run
    taken: dict[str, bytes] = dataclasses.field(default_factory=dict)  # content of files read
    _modules: dict[str, types.ModuleType] = dataclasses.field(default_factory=dict)

    def read(self, text: str, path: Path) -> types.ModuleType:
        """Run the user's file and return its module."""
        self.require_allowed(path, text.encode())
        # `load` and imports of the file use the last reader.
        _READERS.append(self)
        try:
            return self._run(text, path, self.name)
        finally:
            _READERS.remove(self)

    def content(self, name: str) -> bytes:
        """Return the content of a file in the folder, and record it. Raise OSError if missing."""
        # `known` contains the files that the first run of the code read; None: this is the first.
        if self.known is None:
            self.taken[name] = (self.folder / name).read_bytes()
        elif name in self.known:
            self.taken[name] = self.known[name]
        else:
            reason = "no copy is stored, because the code did not read this file in its first run"
            raise FileNotFoundError(2, reason, name)  # 2 is ENOENT
        return self.taken[name]

    def _run(self, code: str | bytes, path: Path, name: str) -> types.ModuleType:
        # Executes a user's file as a module.
        module = types.ModuleType(name)
        module.__file__ = str(path)
        # Only the imports of this module go through `_import`.
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._import}
        # Python finds the annotations of the file's records by the name of its module.
        sys.modules[name] = module
        try:
            exec(compile(code, str(path), "exec"), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
        return module

    def _import(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> types.ModuleType:
        """Replace `__import__` for the user's file: modules in its folder have priority."""
        module = None if level or "." in name else self._import_from_folder(name)
        return module or builtins.__import__(name, globals, locals, fromlist, level)

    def _import_from_folder(self, name: str) -> types.ModuleType | None:
        # Imports a module from the folder of the user's file; None if there is none.
        path = self.folder / f"{name}.py"
        if name in self._modules:
            return self._modules[name]
        # `read` is over, so the top level of the file has run, and this import is in a function.
        if self not in _READERS:
            if path.is_file():
                raise ImportError(
                    f"import {name} at the top of the file, because ravenjax must read all code"
                    " before it runs"
                )
            return None
        try:
            content = self.content(path.name)
        except OSError:
            return None
        self.require_allowed(path, content)
        digest = hashlib.sha256(content).hexdigest()[:16]
        self._modules[name] = self._run(content, path, f"{self.name}_{name}_{digest}")
        return self._modules[name]


_READERS: list[Reader] = []
"""Readers that are active; the innermost is last."""


def load(name: str) -> Any:
    """Return the arrays of a NumPy file (.npy: one array; .npz: a dict) in the folder of the file.
    The hash of the campaign includes this file, so a campaign with other weights is another
    campaign. Call `load` at the top level of your file. Raise UserError if the file is missing.
    """
    if not _READERS:
        raise UserError(
            f"load({name!r}) was called inside a function, or outside of a check's or detector's"
            " file; call load at the top level of the file"
        )
    reader = _READERS[-1]
    try:
        arrays = np.load(io.BytesIO(reader.content(name)), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = getattr(error, "strerror", None)
        reason = reason or f"no NumPy file of numbers: {format_value(str(error))}"
        raise UserError(f"{reader.folder / name}: cannot be loaded ({reason})") from None
    return dict(arrays) if isinstance(arrays, np.lib.npyio.NpzFile) else arrays
