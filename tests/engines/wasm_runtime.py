"""WebAssembly modules run in this process by wasmtime: an oracle for what a browser computes.

`WasmEngine` is engine `simd` with another target: the same printer, split and buffers, vectors of
four lanes, and no fused multiply-add.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import threading
import weakref
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import wasmtime

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.calls import NAME, POINTERS
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel, lanes_of_block
from ravenjax.engines.wasm import code

PAGE = 2**16
"""Bytes by which a memory grows."""
_MOST_PAGES = 2**16
_LINE = 64  # bytes: buffers begin on a cache line


@cache
def _engine() -> Any:
    return _kept(wasmtime.Engine())


_ALIVE: weakref.WeakSet[Any] = weakref.WeakSet()


def _kept(owner: Any) -> Any:
    """An object of the runtime's, to be closed while Python can still do so: at its end it
    closes them too late.
    """
    if not _ALIVE:
        atexit.register(_close)
    _ALIVE.add(owner)
    return owner


def _close() -> None:
    for owner in list(_ALIVE):
        owner.close()


class WasmModule:
    """A module, and instances of it that are free; see `target.CodeModule`."""

    def __init__(self, binary: bytes) -> None:
        self._module = _kept(wasmtime.Module(_engine(), binary))
        self._free: list[_Instance] = []
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def workspace(self) -> Iterator[_Instance]:
        """An instance with a memory of its own: no two threads share one."""
        with self._lock:
            instance = self._free.pop() if self._free else None
        instance = instance or _Instance(self._module)
        yield instance  # one whose calls failed is not used again
        instance.close()
        with self._lock:
            self._free.append(instance)


class _Instance:
    """A module with its memory, in which buffers stand one after the other; see `target.Workspace`.

    wasmtime reserves all addresses that a memory may ever have, so that growing it moves nothing.
    """

    def __init__(self, module: Any) -> None:
        self._store = _kept(wasmtime.Store(_engine()))
        self._memory = wasmtime.Memory(
            self._store, wasmtime.MemoryType(wasmtime.Limits(1, _MOST_PAGES))
        )
        instance = wasmtime.Instance(self._store, module, [self._memory])
        self._make = instance.exports(self._store)[NAME]
        self._base, self._end = self._start(), _LINE  # address 0 is nobody's
        self._written: list[tuple[np.ndarray, np.ndarray]] = []

    def _start(self) -> int:
        return ctypes.addressof(self._memory.data_ptr(self._store).contents)

    def buffer(self, rows: int, size: int) -> np.ndarray:
        """See `Workspace`."""
        return self._room(rows * size).reshape(rows, size)

    def reads(self, array: np.ndarray) -> np.ndarray:
        """See `Workspace`."""
        here = self._room(array.nbytes).view(array.dtype).reshape(array.shape)
        here[...] = array
        return here

    def writes(self, array: np.ndarray) -> np.ndarray:
        """See `Workspace`."""
        here = self.reads(array)
        self._written.append((array, here))
        return here

    def make(self, calls: np.ndarray) -> None:
        """See `Workspace`."""
        if len(calls):
            addresses = POINTERS[calls[:, 0]]
            there = self.reads(np.where(addresses, calls - self._base, calls))
            self._make(self._store, there.ctypes.data - self._base, len(calls))
            self._end = there.ctypes.data - self._base

    def close(self) -> None:
        """Give back what was written; forget all buffers."""
        for array, here in self._written:
            array[...] = here
        self._written, self._end = [], _LINE

    def _room(self, size: int) -> np.ndarray:
        """So many zeroed bytes."""
        first = -(-self._end // _LINE) * _LINE
        self._end = first + size
        lacking = -(-(self._end - self._memory.data_len(self._store)) // PAGE)
        if lacking > 0:
            self._memory.grow(self._store, lacking)
            assert self._start() == self._base
        if not size:
            return np.zeros(0, np.uint8)
        room = np.frombuffer(self._memory.get_buffer_ptr(self._store, size, first), np.uint8)
        room[:] = 0
        return room


class WasmTarget:
    """A WebAssembly runtime; see `target.CodeTarget`."""

    name = "wasm"
    width = code.WIDTH
    features = code.FEATURES
    text = code.text()

    def compiled(
        self, text: str, names: Sequence[str], objects: jit.Objects | None = None
    ) -> WasmModule:
        """See `target.CodeTarget`."""
        return WasmModule(code.emit(text, names, objects))


class WasmEngine(SimdEngine):
    """Engine `simd` on the WebAssembly runtime."""

    def compile(self, program, runs):
        lanes = lanes_of_block(runs, self.threads, code.WIDTH)
        return SimdKernel(traced.printable(program), lanes, self.objects, target=WasmTarget())
