"""What vector code is compiled for, and where it works: this machine's CPU, or a WebAssembly
runtime on it.
"""

from __future__ import annotations

import contextlib
from collections.abc import MutableMapping, Sequence
from typing import Protocol

import numpy as np


class Workspace(Protocol):
    """The memory in which compiled code works on one group of lanes, and what makes its calls
    there.

    Only arrays that it has made or taken may be pointed at by calls; all are gone when it is
    closed.
    """

    def buffer(self, rows: int, size: int) -> np.ndarray:
        """Zeroed bytes [rows, size], on a cache line."""
        ...

    def reads(self, array: np.ndarray) -> np.ndarray:
        """A contiguous array where calls can read it: itself or a copy."""
        ...

    def writes(self, array: np.ndarray) -> np.ndarray:
        """An array of its shape and type that calls write; `array` has the same once the
        workspace is closed.
        """
        ...

    def make(self, calls: np.ndarray) -> None:
        """Make calls, int64 [calls, numbers] as `calls.CallList` writes them down."""
        ...


class CodeModule(Protocol):
    """Compiled functions of a kernel."""

    def workspace(self) -> contextlib.AbstractContextManager[Workspace]:
        """A new one, for one thread."""
        ...


class CodeTarget(Protocol):
    """What code is printed and compiled for."""

    @property
    def name(self) -> str:
        """Of the engine that runs it."""
        ...

    @property
    def width(self) -> int:
        """float32 lanes of its vectors."""
        ...

    @property
    def features(self) -> frozenset[str]:
        """What it has, as LLVM names it; decides how operations are printed."""
        ...

    @property
    def text(self) -> str:
        """All that decides the printed code, in words."""
        ...

    def compiled(
        self, text: str, names: Sequence[str], objects: MutableMapping[str, bytes] | None = None
    ) -> CodeModule:
        """Functions `names` of a module's text; objects: where compiled code is kept between
        processes.
        """
        ...
