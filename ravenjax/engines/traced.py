"""Traces one robot's tick, written in JAX, into programs without loops: beginning, step and end.

Tracing takes seconds, so the programs are cached together with the code that was generated from
them. The cache in memory serves later campaigns of the same process. The cache on disk serves other
processes, which then need not import JAX.
"""

import contextlib
import dataclasses
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from ravenjax.engines import trace_key
from ravenjax.engines.interface import Block, Motion, TickProgram
from ravenjax.engines.trace_key import Code, Objects
from ravenjax.errors import UserError
from ravenjax.ir import lowering
from ravenjax.ir.builder import contract_to_fma
from ravenjax.ir.program import Program
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.setup import Setup

MAX_PROGRAMS = 4
"""Largest number of programs in the cache of this process, up to 20 MB each."""


@dataclasses.dataclass(frozen=True)
class TracedTick:
    """The time loop of one lane as programs. Inputs of the lane are the varied parameters and the
    faults. Inputs of a tick are its number and the golden run's reference series. Outputs of a tick
    are the lane's reference series, then all signals.
    """

    loop: TimeLoop  # its results are the outcomes
    outcomes: tuple[str, ...]  # names of the results
    series: int  # number of numbers in the reference series
    signals: Any  # structure of the signals, each leaf its dtype

    def without_signals(self) -> TimeLoop:
        """The loop whose only outputs are its reference series."""
        kept = self.loop.step.outputs[: self.loop.states + self.series]
        step = dataclasses.replace(self.loop.step, outputs=kept)
        return dataclasses.replace(self.loop, step=step)


class Forms:
    """A traced program and all code generated from it, by engine, form and device. Thread-safe."""

    def __init__(self, traced: TracedTick, key: str = "", objects: Objects | None = None):
        """key: hash of all inputs of the trace; "": nothing is cached on disk."""
        self.traced = traced
        self._key, self._objects = key, objects
        self._codes: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def code(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """Return the compiled code of this key. The first call makes it with `make`."""
        with self._lock:
            if key not in self._codes:
                self._codes[key] = make()
            return self._codes[key]

    def printed(self, key: Any, make: Callable[[], Code]) -> Code:
        """Return code that `make` prints, or load it from disk. key: inputs beside the trace."""
        disk_key = self._key and trace_key.hash_values("printed", self._key, key)
        return trace_key.load_or_make(self._objects, disk_key, make)


def traced_forms(
    program: TickProgram, block: Block, motion: Sequence[np.ndarray], objects: Objects | None = None
) -> Forms:
    """Return `program`, traced for blocks and motions of these types. objects: cache on disk."""

    def empty(column):
        return np.zeros(0, np.asarray(column).dtype)

    # A trace depends on the types of the lanes' inputs, not on their values or their number.
    varied = {path: empty(block.varied[path]) for path in program.varied}
    empty_block = Block(varied, tree.map_leaves(empty, block.faults), None)
    shapes = varied, empty_block.faults, [(column.shape, column.dtype.str) for column in motion]
    definition = program.module, program.setup, program.params, program.varied, program.ends
    key = trace_key.hash_values(*definition, *shapes)
    # A second caller waits instead of tracing the same program.
    with _TRACING:
        if key not in FORMS:
            # A robot of another package may import unknown files, so it is not cached on disk.
            cacheable = program.module.startswith("ravenjax.") and objects is not None
            disk_key = trace_key.persistent_key("trace", key) if cacheable else ""
            # Only the shapes of the motion count, so zeros that take no memory take its place.
            columns = [np.broadcast_to(np.zeros((), c.dtype), c.shape) for c in motion]
            trace = partial(trace_tick, program, empty_block, columns)
            FORMS[key] = Forms(trace_key.load_or_make(objects, disk_key, trace), disk_key, objects)
            if len(FORMS) > MAX_PROGRAMS:
                del FORMS[next(iter(FORMS))]
        # The most recently used program is last; the first is dropped.
        FORMS[key] = FORMS.pop(key)
        return FORMS[key]


_TRACING = threading.Lock()
FORMS: dict[str, Forms] = {}
"""The cache of this process: hash of a program and its types -> the traced program."""


def x64_context(setup: Setup) -> contextlib.AbstractContextManager[Any]:
    """Return a context in which JAX has 64-bit numbers if the setup has any."""
    return jax.enable_x64(setup.precision.needs_x64)


@contextlib.contextmanager
def refuse_leaked_numbers() -> Iterator[None]:
    """Convert JAX's error about a number that outlived its trace to a UserError with its line."""
    try:
        yield
    except jax.errors.UnexpectedTracerError as error:
        created = re.search(r"created on line (\S+?:\d+)", str(error))
        place = created[1] if created else "a detector, check, controller or operator"
        raise UserError(
            f"{place}: the code uses a jnp number of an earlier call, from a global variable or a"
            " cache. Store plain Python numbers there, or use the state that init returns"
        ) from error


def record_shapes(record: Any) -> Any:
    """Return JAX's shapes of single numbers for a record of dtypes."""
    return tree.map_leaves(lambda dtype: jax.ShapeDtypeStruct((), dtype), record)


def trace_tick(program: TickProgram, block: Block, motion: Sequence[np.ndarray]) -> TracedTick:
    """Trace the tick for blocks and motions of these types. No array is created, so JAX does not
    initialise a device.
    """
    setup = program.setup
    series = program.loop.series_length(setup)
    columns = tuple(jax.ShapeDtypeStruct(column.shape, column.dtype) for column in motion)
    lane = record_shapes(
        (
            [np.asarray(block.varied[path]).dtype for path in program.varied],
            tree.map_leaves(lambda leaf: np.asarray(leaf).dtype, block.faults),
            (np.dtype(np.int32),) if program.ends else (),
        )
    )
    # The number of the tick, and the golden run's reference series.
    tick_inputs = record_shapes((np.int32, [np.dtype(setup.precision.real)] * series))

    with x64_context(setup):
        # `TimeLoop` gives all three programs the same inputs of the lane (varied, faults, end), so
        # `begin` and `finish` have arguments that they do not read.
        begin, state = trace_function(lambda varied, faults, end: program.begin(varied), *lane)
        step, (_, _, signals) = trace_function(program.step, *lane, state, *tick_inputs, columns)
        finish, outcomes = trace_function(
            lambda varied, faults, end, state: program.finish(varied, state), *lane, state
        )
    signals = tree.map_leaves(lambda leaf: np.dtype(leaf.dtype), signals)
    # JAX orders the numbers of a dict by their keys.
    return TracedTick(TimeLoop(begin, step, finish), tuple(sorted(outcomes)), series, signals)


def trace_function(
    function: Callable[..., Any], *arguments: Any, functions: lowering.Functions = "polynomials"
) -> tuple[Program, Any]:
    """Return a function's program for arguments of these shapes, and the shapes of its results.
    With functions = "polynomials", sines and similar functions become polynomials, and a sum with a
    product becomes one fused operation. For "library" see `lowering.lower_jaxpr`.
    """
    with refuse_leaked_numbers():
        jaxpr, results = jax.make_jaxpr(function, return_shape=True)(*arguments)
    program = lowering.lower_jaxpr(jaxpr, functions)
    return (contract_to_fma(program) if functions == "polynomials" else program), results


def printable_program(program: TickProgram) -> TickProgram:
    """Return `program` without ends: printed code itself stops each lane at its end."""
    return dataclasses.replace(program, ends=False)


class PrintedKernel:
    """Base of the kernels of engines `simd` and `cuda`: a traced program and its compiled forms."""

    def __init__(self, program: TickProgram, lanes: int, objects: Objects | None):
        """objects: cache of compiled code between processes."""
        self.program, self.lanes, self.objects = printable_program(program), lanes, objects
        self._forms: Forms | None = None

    def forms(self, block: Block, motion: Motion) -> Forms:
        """Return the program, traced for blocks and motions of these types at the first call."""
        self._forms = self._forms or traced_forms(self.program, block, motion, self.objects)
        return self._forms

    def groups(self, block: Block) -> tuple[list[np.ndarray], np.ndarray]:
        """Return a block's inputs, each [lanes], and the group number of each lane, int [lanes].
        Lanes of a group have the same bits in all varied parameters. If nothing differs between the
        lanes of a block, so that it has no arrays, it has `self.lanes` lanes.
        """
        columns = lane_inputs(self.program, block)
        # Divides the groups further by each parameter in turn, and numbers them anew.
        group = np.zeros(block.lanes or self.lanes, np.int64)
        for column in columns[: len(self.program.varied)]:
            # Bits, because 0.0 and -0.0 are equal numbers that may give different results.
            pattern = np.ascontiguousarray(column).view(f"u{column.dtype.itemsize}")
            _, value_number = np.unique(pattern, return_inverse=True)
            combined = group * (int(value_number.max()) + 1) + value_number
            _, group = np.unique(combined, return_inverse=True)
        return columns, group


def motion_tables(motion: Motion) -> np.ndarray:
    """Return the columns of the motion, concatenated to one 1-D array."""
    return np.concatenate([np.ascontiguousarray(column) for column in motion])


def lane_inputs(program: TickProgram, block: Block) -> list[np.ndarray]:
    """Return the inputs of printed code, each [lanes]: varied parameters, then faults."""
    varied = [block.varied[path] for path in program.varied]
    return [np.asarray(column) for column in (*varied, *tree.tree_leaves(block.faults))]


def lane_ends(program: TickProgram, block: Block) -> tuple[np.ndarray, ...]:
    """Return (the lanes' ends, int32 [lanes],) if lanes end at different ticks, else ()."""
    assert not program.ends or block.ends is not None
    return () if block.ends is None or not program.ends else (block.ends.astype(np.int32),)
