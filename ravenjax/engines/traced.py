"""The tick of one robot traced for a program: beginning, step and end as straight-line programs.

Tracing takes a second of Python, so what this process traced last is kept with the code that was made of it: a campaign
in several steps, or one beside another that needs the same code, traces once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import pickle
import threading
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from ravenjax.engines.interface import Block, TickProgram
from ravenjax.ir import lowering
from ravenjax.ir.builder import contract
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers import paths
from ravenjax.numbers.setup import Setup

KEPT = 4
"""Programs whose code is kept, up to 20 MB each."""


@dataclasses.dataclass(frozen=True)
class TracedTick:
    """The loop of a lane: its inputs are the varied parameters and the faults, its results the outcomes.

    What enters a tick is its number and the golden run's series; what goes out is the own series, then all signals.
    """

    loop: TimeLoop
    outcomes: tuple[str, ...]  # names of the results
    series: int  # numbers of the reference series
    signals: Any  # structure of the signals

    def without_signals(self) -> TimeLoop:
        """The loop that tells nothing but its reference series."""
        step = self.loop.step
        return dataclasses.replace(
            self.loop, step=dataclasses.replace(step, outputs=step.outputs[: self.loop.states + self.series])
        )

    def signals_of(self, out: np.ndarray, typed: Callable[[np.ndarray, np.dtype], np.ndarray]) -> Any:
        """Every signal of the first lane, each leaf [ticks]; `typed` makes numbers of a type of a column of `out`.

        out: what went out, [ticks, numbers, lanes].
        """
        leaves, structure = jax.tree.flatten(self.signals)
        columns = np.ascontiguousarray(out[:, self.series :, 0].T)
        return jax.tree.unflatten(
            structure, [typed(column, np.dtype(leaf.dtype)) for column, leaf in zip(columns, leaves, strict=True)]
        )


class Forms:
    """A traced program and whatever code is made of it, by engine, form and device; from any thread."""

    def __init__(self, traced: TracedTick) -> None:
        self.traced = traced
        self._codes: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def code(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """The code of this key, made by the first who asks."""
        with self._lock:
            if key not in self._codes:
                self._codes[key] = make()
            return self._codes[key]


@dataclasses.dataclass(frozen=True)
class _Asked:
    """What a trace depends on: equal digests, equal code."""

    digest: bytes
    program: TickProgram = dataclasses.field(compare=False)
    block: Block = dataclasses.field(compare=False)  # of no lanes
    motion: tuple[jax.ShapeDtypeStruct, ...] = dataclasses.field(compare=False)


def forms(program: TickProgram, block: Block, motion: Sequence[np.ndarray]) -> Forms:
    """`program` traced for blocks and motions like these, perhaps before."""
    setup, shapes = program.setup, tuple(jax.ShapeDtypeStruct(c.shape, c.dtype) for c in motion)
    none = Block(
        {path: np.zeros(0, np.asarray(block.varied[path]).dtype) for path in program.varied},
        jax.tree.map(lambda leaf: np.zeros(0, np.asarray(leaf).dtype), block.faults),
        None,
    )
    decides = (
        program.module,
        setup,
        program.params,
        program.varied,
        none,
        [(c.shape, c.dtype.str) for c in shapes],
    )
    with _TRACING:
        return _forms(_Asked(hashlib.sha256(pickle.dumps(decides)).digest(), program, none, shapes))


def forget() -> None:
    """Keep nothing of what was traced so far."""
    _forms.cache_clear()


_TRACING = threading.Lock()  # who comes second waits instead of tracing the same


@functools.lru_cache(maxsize=KEPT)
def _forms(asked: _Asked) -> Forms:
    return Forms(trace(asked.program, asked.block, asked.motion))


def unrolled(program: TickProgram) -> TickProgram:
    """`program` with link dynamics of single numbers: printed code has no arrays."""
    return dataclasses.replace(program, setup=dataclasses.replace(program.setup, link_dynamics="unrolled"))


def x64(setup: Setup) -> contextlib.AbstractContextManager[Any]:
    """JAX with 64-bit numbers, where the setup has any."""
    return jax.enable_x64(True) if setup.precision.needs_x64 else contextlib.nullcontext()


def inputs(program: TickProgram, block: Block) -> list[np.ndarray]:
    """A lane's inputs, each [lanes]: varied parameters, then the numbers of its faults."""
    return [np.asarray(block.varied[path]) for path in program.varied] + [
        np.asarray(leaf) for leaf in jax.tree.leaves(block.faults)
    ]


def params(program: TickProgram, varied: Sequence[Any]) -> Any:
    """The parameters of a lane."""
    record = program.params
    for path, value in zip(program.varied, varied, strict=True):
        record = paths.assign(record, program.setup, path, value)
    return record


def jaxprs(
    program: TickProgram, block: Block, motion: Sequence[np.ndarray | jax.ShapeDtypeStruct]
) -> tuple[list[core.ClosedJaxpr], TracedTick]:
    """The three closed jaxprs of `trace`, and what their results are (its loop is empty)."""
    loop, setup, number = program.loop, program.setup, jax.ShapeDtypeStruct
    real = np.dtype(setup.precision.real)
    varied = [number((), np.asarray(block.varied[path]).dtype) for path in program.varied]
    faults = jax.tree.map(lambda leaf: number((), np.asarray(leaf).dtype), block.faults)
    length = loop.series_length(setup)

    def begin(varied: Any, faults: Any) -> Any:
        return loop.init(setup, params(program, varied))

    def step(varied: Any, faults: Any, state: Any, now: Any, reference: Any, motion: Any) -> Any:
        return loop.advance(setup, params(program, varied), faults, state, now, motion, reference)

    def finish(varied: Any, faults: Any, state: Any) -> Any:
        return loop.outcomes(setup, params(program, varied), state)

    with x64(setup):
        first, state = jax.make_jaxpr(begin, return_shape=True)(varied, faults)
        of_tick = (number((), jnp.int32), [number((), real)] * length, tuple(number(c.shape, c.dtype) for c in motion))
        middle, (_, _, signals) = jax.make_jaxpr(step, return_shape=True)(varied, faults, state, *of_tick)
        last, outcomes = jax.make_jaxpr(finish, return_shape=True)(varied, faults, state)
    return [first, middle, last], TracedTick(None, tuple(sorted(outcomes)), length, signals)  # type: ignore[arg-type]


def trace(
    program: TickProgram,
    block: Block,
    motion: Sequence[np.ndarray | jax.ShapeDtypeStruct],
    origin: lowering.Origin | None = None,
) -> TracedTick:
    """Trace the tick for blocks like this one; `origin` as for `lowering.lower`."""
    closed, traced = jaxprs(program, block, motion)
    return dataclasses.replace(traced, loop=TimeLoop(*(contract(lowering.lower(jaxpr, origin)) for jaxpr in closed)))
