"""Runs the code of a part: what it imports and loads from its own folder counts as its content."""

from __future__ import annotations

import builtins
import hashlib
import io
import sys
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown


class Reader:
    """Runs one part, and the modules beside it that it imports.

    No other part has these modules, nor has `sys.modules` by their plain names: two campaigns may
    have two `filters`.
    """

    def __init__(self, name: str, folder: Path, known: Mapping[str, bytes] | None) -> None:
        """name: of the part's module; known: the files of a part that was read before, maybe in
        another process. They are taken as they were; None: from the folder.
        """
        self.folder = folder
        self.taken: dict[str, bytes] = {}
        self._name, self._known = name, known
        self._modules: dict[str, types.ModuleType] = {}

    def read(self, text: str, path: Path) -> types.ModuleType:
        """The module of the part's file."""
        _READERS.append(self)
        try:
            return self._run(text, path, self._name)
        finally:
            _READERS.remove(self)

    def content(self, name: str) -> bytes:
        """What is in a file beside the part, which is part of its content. Raises OSError."""
        if self._known is None:
            self.taken[name] = (self.folder / name).read_bytes()
        elif name in self._known:
            self.taken[name] = self._known[name]
        else:
            raise FileNotFoundError(2, "No such file when the part was first read", name)
        return self.taken[name]

    def _run(self, code: str | bytes, path: Path, name: str) -> types.ModuleType:
        module = types.ModuleType(name)
        module.__file__ = str(path)
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._imported}
        # annotations of its records are looked up by its name
        sys.modules[name] = module
        try:
            exec(compile(code, str(path), "exec"), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
        return module

    def _imported(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> types.ModuleType:
        """`__import__` of the part: finds modules beside it first, as a script's does."""
        beside = None if level or "." in name else self._beside(name)
        return beside or builtins.__import__(name, globals, locals, fromlist, level)

    def _beside(self, name: str) -> types.ModuleType | None:
        """The module of that name beside the part, run once; None without such a file."""
        path = self.folder / f"{name}.py"
        if name in self._modules:
            return self._modules[name]
        if self not in _READERS:
            if path.is_file():
                raise ImportError(
                    f"import {name} at the top of the file, so that its text counts as content"
                )
            return None
        try:
            content = self.content(path.name)
        except OSError:
            return None
        digest = hashlib.sha256(content).hexdigest()[:16]
        self._modules[name] = self._run(content, path, f"{self._name}_{name}_{digest}")
        return self._modules[name]


_READERS: list[Reader] = []
"""Readers of the parts that are being read, the innermost last."""


def load(name: str) -> Any:
    """The arrays of a NumPy file (.npy: one array, .npz: a dict of arrays) in the folder of the
    part that calls.

    Its content counts as the part's own: a campaign with other weights is another campaign. Call it
    at the top of the file. Raises UserError where there is no such file.
    """
    if not _READERS:
        raise UserError(
            f"load({name!r}) was called outside a part's file, or in its functions; call it at"
            " its top"
        )
    reader = _READERS[-1]
    try:
        arrays = np.load(io.BytesIO(reader.content(name)), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = (
            getattr(error, "strerror", None) or f"no NumPy file of numbers: {shown(str(error))}"
        )
        raise UserError(f"{reader.folder / name}: cannot be loaded ({reason})") from None
    return dict(arrays) if isinstance(arrays, np.lib.npyio.NpzFile) else arrays
