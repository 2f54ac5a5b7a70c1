"""Engines `xla` and `mjx`: the tick under `vmap`, its time loop a `lax.scan`, compiled by `jit`.

A kernel advances one block by one *segment* of ticks and is called again for the next, so that one
compile serves any duration and memory does not grow with it. The first segment makes the initial
state; each returns the outcomes so far. Blocks run side by side in threads: XLA's CPU code for so
many small loops keeps one core busy and leaves the GIL alone.
"""

from __future__ import annotations

import dataclasses
import os
import threading
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.interface import Block, BlockResult, Progress, TickProgram, Tracer
from ravenjax.numbers.lazy import jax, jnp, lax

MAX_SEGMENT = 1000
"""Ticks of a segment, at most."""
MAX_LANES = 256
"""Lanes of a block: the state of a block then fits the second-level cache of a core."""
LANE_MULTIPLE = 16
"""Lanes come in multiples of the widest float32 vector, so that every lane takes the vector
path.
"""


def segment_ticks(ticks: int) -> int:
    """Ticks of each of the equal segments that cover a run; the last may overshoot a little."""
    return -(-ticks // -(-ticks // MAX_SEGMENT))


def _segment_function(program: TickProgram, length: int, keep_signals: bool) -> tuple[Any, Any]:
    """The segment, and the shapes of the state that it carries.

    segment(varied, faults, ends, state, first tick, reference [length, series, lanes], motion)
    returns the state, the outcomes so far, the reference series [length, series, lanes] and, if
    kept, every signal of the first lane [length]. ends: as `traced.own_ends`.
    """
    overshoots = program.ticks % length != 0  # the last segment, the run

    def values(varied: Any) -> list[Any]:
        return [varied[path] for path in program.varied]

    def begin(varied: Any) -> Any:
        return program.begin(values(varied))

    def advance(
        varied: Any, faults: Any, end: Any, state: Any, now: Any, reference: Any, motion: Any
    ) -> Any:
        end = end or ((program.ticks,) if overshoots else ())
        moved = program.step(values(varied), faults, end, state, now, reference, motion)
        return moved if keep_signals else (*moved[:2], ())

    def finish(varied: Any, state: Any) -> Any:
        return program.finish(values(varied), state)

    def segment(
        varied: Any, faults: Any, ends: Any, state: Any, first: Any, reference: Any, motion: Any
    ) -> Any:
        fresh = jax.vmap(begin, axis_size=reference.shape[2])(varied)
        state = jax.tree.map(lambda a, b: jnp.where(first == 0, a, b), fresh, state)

        def body(carry: Any, x: Any) -> Any:
            now, row = x
            moved = jax.vmap(advance, in_axes=(0, 0, 0, 0, None, 1, None))(
                varied, faults, ends, carry, now, row, motion
            )
            new, series, signals = moved
            return new, (jnp.stack(series), jax.tree.map(lambda leaf: leaf[0], signals))

        state, (series, signals) = lax.scan(
            body, state, (first + jnp.arange(length, dtype=jnp.int32), reference)
        )
        return state, jax.vmap(finish)(varied, state), series, signals

    def shapes(varied: Any, lanes: int) -> Any:
        return jax.eval_shape(lambda v: jax.vmap(begin, axis_size=lanes)(v), varied)

    return segment, shapes


class ScanKernel:
    """A compiled segment and the loop over segments."""

    branches = 0

    def __init__(self, program: TickProgram, lanes: int, keep_signals: bool = False) -> None:
        self.program, self.lanes, self.keep_signals = program, lanes, keep_signals
        self.length = segment_ticks(program.ticks)
        self.series = program.loop.series_length(program.setup)
        self.dtype = np.dtype(program.setup.precision.real)
        self.segment, self.shapes = _segment_function(program, self.length, keep_signals)
        self._compiled: Any = None
        self._lock = threading.Lock()

    def size(self, rows: int) -> int:
        """See `interface.Kernel`: always the lanes that it is compiled for."""
        return self.lanes

    def _compile(self, *args: Any) -> Any:
        with self._lock:
            if self._compiled is None:
                self._compiled = jax.jit(self.segment, donate_argnums=(3,)).lower(*args).compile()
        return self._compiled

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        """Compile for blocks and motions of these shapes."""
        with traced.x64(self.program.setup):
            self._compile(*self._arguments(block, motion))

    def _arguments(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[Any, ...]:
        varied = {p: jnp.asarray(block.varied[p]) for p in self.program.varied}
        faults = jax.tree.map(jnp.asarray, block.faults)
        state = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), self.shapes(varied, self.lanes))
        reference = jnp.zeros((self.length, self.series, self.lanes), self.dtype)
        ends = tuple(map(jnp.asarray, traced.own_ends(self.program, block)))
        return (
            varied,
            faults,
            ends,
            state,
            jnp.int32(0),
            reference,
            tuple(jnp.asarray(c) for c in motion),
        )

    def run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None = None
    ) -> BlockResult:
        """See `interface.Kernel`."""
        outcomes, series, _ = self._run(block, motion, progress, keep=block.reference is None)
        return BlockResult(outcomes, series)

    def run_signals(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[BlockResult, Any]:
        """As `run`, and every signal of the first lane, each leaf [ticks]."""
        outcomes, series, signals = self._run(block, motion, None, keep=True)
        return BlockResult(outcomes, series), signals

    def _run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None, keep: bool
    ) -> tuple[dict[str, np.ndarray], np.ndarray, Any]:
        ticks = self.program.ticks
        with traced.x64(self.program.setup):
            varied, faults, ends, state, now, reference, columns = self._arguments(block, motion)
            compiled = self._compile(varied, faults, ends, state, now, reference, columns)
            outcomes: Any = {}
            chunks: list[Any] = []
            for first in range(0, ticks, self.length):
                if block.compared:
                    reference = jnp.asarray(self._segment_of(block, first))
                state, outcomes, *series = compiled(
                    varied, faults, ends, state, jnp.int32(first), reference, columns
                )
                if keep:
                    chunks.append(jax.tree.map(np.asarray, series))
                jax.block_until_ready(outcomes)
                if progress is not None:
                    progress(min(self.length, ticks - first) * self.lanes)
        named = {name: np.asarray(value) for name, value in outcomes.items()}
        if not chunks:
            return named, np.zeros((0, self.series, self.lanes), self.dtype), ()
        series, signals = jax.tree.map(lambda *parts: np.concatenate(parts)[:ticks], *chunks)
        return named, series, signals

    def _segment_of(self, block: Block, first: int) -> np.ndarray:
        """The reference of each lane for one segment; the last row is repeated where it
        overshoots the run.
        """
        assert block.reference is not None
        rows = np.minimum(np.arange(first, first + self.length), len(block.reference) - 1)
        return dataclasses.replace(block, reference=block.reference[rows]).series(
            np.arange(self.lanes)
        )


@dataclasses.dataclass(frozen=True)
class ScanEngine:
    """`xla` (unrolled link dynamics) or `mjx` (link dynamics by mujoco.mjx)."""

    name: str

    @property
    def device(self) -> str:
        """The device in words."""
        return str(jax.devices()[0].device_kind)

    @property
    def threads(self) -> int:
        """One block a core on a CPU; an accelerator takes one at a time."""
        return len(os.sched_getaffinity(0)) if jax.default_backend() == "cpu" else 1

    def _program(self, program: TickProgram) -> TickProgram:
        dynamics = "mjx" if self.name == "mjx" else "unrolled"
        return dataclasses.replace(
            program, setup=dataclasses.replace(program.setup, link_dynamics=dynamics)
        )

    def compile(self, program: TickProgram, runs: int) -> ScanKernel:
        """See `interface.Engine`. The block never depends on the chunk that results are stored
        in.
        """
        share = -(-runs // self.threads)
        lanes = min(MAX_LANES, -(-share // LANE_MULTIPLE) * LANE_MULTIPLE)
        return ScanKernel(self._program(program), lanes)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`."""
        return Tracer(ScanKernel(self._program(program), lanes, keep_signals=True))
