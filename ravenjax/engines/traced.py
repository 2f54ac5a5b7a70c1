"""The tick of one robot traced for a program: beginning, step and end as straight-line programs.

Tracing takes seconds of Python, so what was traced is kept with the code that was made of it: in
this process, where a campaign in several steps, or one beside another that needs the same code,
traces once; and on disk, where the next process finds it and imports no JAX.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import threading
import zlib
from collections.abc import Callable, MutableMapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ravenjax import interruption
from ravenjax.engines import sources, trace_key, traced_tick
from ravenjax.engines.interface import Block, TickProgram
from ravenjax.engines.traced_tick import TracedTick
from ravenjax.numbers import tree

if TYPE_CHECKING:
    from ravenjax.ir.lowering import Origin

KEPT = 4
"""Programs whose code this process keeps, up to 20 MB each."""

Objects = MutableMapping[str, bytes]
"""What outlives the process, by the hash of what it was made from."""
Printed = TypeVar("Printed")


class Forms:
    """A traced program and whatever code is made of it, by engine, form and device; from any
    thread.
    """

    def __init__(self, traced: TracedTick, key: str = "", objects: Objects | None = None) -> None:
        """key: hash of all that decides the trace; "": nothing of it is to outlive the process."""
        self.traced = traced
        self._key, self._objects = key, objects if key else None
        self._codes: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def code(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """The code of this key, made by the first who asks."""
        with self._lock:
            if key not in self._codes:
                self._codes[key] = make()
            return self._codes[key]

    def holds(self, key: tuple[Any, ...]) -> bool:
        """Whether the code of this key is there."""
        return key in self._codes

    def keeps(self, kind: type, key: Any) -> bool:
        """Whether disk has what `printed` would print."""
        return self._objects is not None and self._own_key(kind, key) in self._objects

    def _own_key(self, kind: type, key: Any) -> str:
        return trace_key.of("printed", self._key, kind.__qualname__, key)

    def printed(self, kind: type[Printed], key: Any, make: Callable[[], Printed]) -> Printed:
        """Printed code, a dataclass of texts and numbers, from disk where it was printed before.

        key: everything besides the trace that decides it.
        """
        if self._objects is None:
            return make()
        own, adapter = self._own_key(kind, key), TypeAdapter(kind)
        if (content := self._objects.get(own)) is not None:
            with contextlib.suppress(
                zlib.error, ValidationError
            ):  # of another version: printed anew
                return adapter.validate_json(zlib.decompress(content))
        interruption.point()
        result = make()
        interruption.point()
        self._objects[own] = zlib.compress(adapter.dump_json(result), 1)
        return result


@dataclasses.dataclass(frozen=True)
class _Wanted:
    """What a trace depends on: equal keys, equal code."""

    key: str
    program: TickProgram = dataclasses.field(compare=False)
    block: Block = dataclasses.field(compare=False)  # of no lanes
    motion: tuple[np.ndarray, ...] = dataclasses.field(
        compare=False
    )  # of zeros that take no memory
    objects: Objects | None = dataclasses.field(compare=False)


def forms(
    program: TickProgram, block: Block, motion: Sequence[np.ndarray], objects: Objects | None = None
) -> Forms:
    """`program` traced for blocks and motions like these, perhaps before, perhaps by another
    process.

    objects: where that is kept between processes; None keeps it in this one.
    """
    none = Block(
        {path: np.zeros(0, np.asarray(block.varied[path]).dtype) for path in program.varied},
        tree.mapped(lambda leaf: np.zeros(0, np.asarray(leaf).dtype), block.faults),
        None,
    )
    decides = (
        program.module,
        program.setup,
        program.params,
        program.varied,
        program.ends,
        none.varied,
        none.faults,
        [(column.shape, column.dtype.str) for column in motion],
    )
    with _TRACING:
        return _forms(
            _Wanted(trace_key.of(*decides), program, none, tuple(map(_shape, motion)), objects)
        )


def _shape(column: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.zeros((), column.dtype), column.shape)


def forget() -> None:
    """Keep nothing in this process of what was traced so far."""
    _forms.cache_clear()


_TRACING = threading.Lock()  # who comes second waits instead of tracing the same


@functools.lru_cache(maxsize=KEPT)
def _forms(wanted: _Wanted) -> Forms:
    key = _lasting(wanted)
    objects = wanted.objects if key else None
    if objects is not None and (content := objects.get(key)) is not None:
        _ = wanted.program.loop  # imports the records of its signals
        with contextlib.suppress(
            ValueError, KeyError, zlib.error
        ):  # of another version: traced anew
            return Forms(traced_tick.from_bytes(content), key, objects)
    result = trace(wanted.program, wanted.block, wanted.motion)
    if objects is not None and sources.unchanged():
        with contextlib.suppress(TypeError):  # signals that have no bytes
            objects[key] = result.to_bytes()
    return Forms(result, key, objects)


def _lasting(wanted: _Wanted) -> str:
    """Key of what may outlive the process: with the code and all versions; "" where the code is not
    known by files.

    A robot of another package may take code from anywhere, so what is traced of it stays in this
    process.
    """
    if not _ours(wanted.program) or wanted.objects is None or not sources.unchanged():
        return ""
    return trace_key.of("trace", wanted.key, sources.AT_IMPORT, trace_key.versions())


def trace(
    program: TickProgram, block: Block, motion: Sequence[np.ndarray], origin: Origin | None = None
) -> TracedTick:
    """Trace the tick for blocks like this one; `origin` as for `lowering.lower`."""
    # Imports JAX, which a process that finds its traces on disk does without.
    from ravenjax.engines import tracing

    return tracing.trace(program, block, motion, origin)


def _ours(program: TickProgram) -> bool:
    return program.module.startswith("ravenjax.")


def printable(program: TickProgram) -> TickProgram:
    """`program` as it is printed: with link dynamics of single numbers, and lanes that are
    stopped from outside.
    """
    return dataclasses.replace(
        program, setup=dataclasses.replace(program.setup, link_dynamics="unrolled"), ends=False
    )


def inputs(program: TickProgram, block: Block) -> list[np.ndarray]:
    """A lane's inputs, each [lanes]: varied parameters, the numbers of its faults, its end where
    each has its own.
    """
    varied = [np.asarray(block.varied[path]) for path in program.varied]
    return [*varied, *map(np.asarray, tree.leaves(block.faults)), *own_ends(program, block)]


def own_ends(program: TickProgram, block: Block) -> tuple[np.ndarray, ...]:
    """The lanes' ends, int32 [lanes], if they have their own."""
    assert not program.ends or block.ends is not None
    return () if block.ends is None or not program.ends else (block.ends.astype(np.int32),)
