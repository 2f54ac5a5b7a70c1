"""Engines `xla` and `mjx`: run the tick under `vmap` in a `lax.scan` over time, compiled by `jit`.

A *block* is a batch of lanes. A call of the compiled function advances one block by one *segment*
of ticks. The same function therefore serves runs of any length, and its memory does not grow with
the length. Each call returns the outcomes so far.

On a CPU a block is small, and each core runs one block. On accelerators one large block runs at a
time, and `jit` divides its lanes among the devices.
"""

import collections
import dataclasses
import functools
import os
import threading
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ravenjax import threads
from ravenjax.engines import traced
from ravenjax.engines.interface import Block, BlockResult, Motion, Progress, TickProgram, Tracer
from ravenjax.errors import UserError
from ravenjax.numbers.lazy import jax, jnp, lax

MAX_SEGMENT = 1000
"""Largest number of ticks of a segment."""
SERIES_BYTES = 2**30
"""Device memory of a segment's series in bytes, once for the golden runs and once for the lanes."""
SMALL_LANES = 256
"""Lanes of a block of few rows, such as golden runs. On a CPU also of others, if runs are few."""
CPU_LANES = 2**12
"""Largest number of lanes of a block of engine xla on a CPU core. In a block of SMALL_LANES half of
the time is the fixed cost of some hundred loops.
"""
MJX_CPU_LANES = 2**10  # The same for engine mjx: XLA can wait forever for products of 2048 lanes.
ACCELERATOR_LANES = 2**19
"""Largest number of lanes of a block on each accelerator. A tick launches some 400 kernels, which
takes 1.7 ms on an H100, so large blocks are the fastest (analysis/engines/gpu.md). With 2**20 lanes
an array of mjx exceeds 2**31 bytes and is wrong.
"""
LANE_BYTES = 2**14
"""Device memory of each lane in bytes: its state and the intermediate results of a tick."""
MJX_ON_CPU: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}
"""XLA options of engine mjx on a CPU. With these emitters a fusion computes the pose of a body for
each body behind it, so a tick takes up to a hundred times as long."""
LANE_MULTIPLE = 16
"""Lanes come in multiples of the widest float32 vector, so that every lane is in a full vector."""


def segment_ticks(ticks: int, longest: int) -> int:
    """Return the ticks of equal segments that cover a run. The last may go beyond the run."""
    segments = -(-ticks // max(1, min(ticks, longest)))
    return -(-ticks // segments)


@functools.cache
def _accelerators() -> tuple[Any, ...]:
    return () if jax.default_backend() == "cpu" else tuple(jax.devices())


def _choose_lanes(runs: int, cores: int, by_mjx: bool) -> int:
    """Return the number of lanes of a block, for all accelerators together or for one CPU core."""
    # The result covers `share` runs, is at most `limit`, and is rounded up to a `multiple`.
    share, limit, multiple = -(-runs // cores), SMALL_LANES, LANE_MULTIPLE
    if devices := _accelerators():
        memory = min(device.memory_stats()["bytes_limit"] for device in devices)
        fitting = memory // LANE_BYTES // LANE_MULTIPLE * LANE_MULTIPLE
        share, limit = runs, min(ACCELERATOR_LANES, fitting) * len(devices)
        multiple = LANE_MULTIPLE * len(devices)
    elif share >= 4 * (MJX_CPU_LANES if by_mjx else SMALL_LANES):
        # All blocks compute the same number of lanes, so a last block with few runs would waste
        # time. For fewer runs, compiling for more lanes than SMALL_LANES would take too long.
        blocks = -(-share // (MJX_CPU_LANES if by_mjx else CPU_LANES))
        limit = -(-share // blocks)
    return -(-min(limit, share) // multiple) * multiple


def _place(array, axis: int = 0) -> Any:
    """Put an array on the accelerators, divided along `axis`, that of lanes, if possible."""
    devices = _accelerators()
    # Lanes that cannot be divided evenly, such as the one of a trace, stay on the first device.
    if len(devices) < 2 or np.shape(array)[axis] % len(devices):
        return jnp.asarray(array)
    mesh = jax.sharding.Mesh(np.array(devices), ("lanes",))
    spec = jax.sharding.PartitionSpec(*[None] * axis, "lanes")
    return jax.device_put(array, jax.sharding.NamedSharding(mesh, spec))


def _segment_function(program: TickProgram, length: int, keep_signals: bool) -> Any:
    """Return the segment function. segment(varied, faults, ends, state, first tick, reference,
    motion) advances all lanes by `length` ticks. It returns the state, the outcomes so far, the
    lanes' own series and, if kept, every signal of the first lane [length]. The lanes' series and
    `reference`, the series of their golden runs, are [length, series, lanes]. ends: value of
    `traced.lane_ends`.
    """
    # If the last segment extends beyond the run, lanes without an own end stop at the run's end.
    run_end = (program.ticks,) if program.ticks % length else ()

    def advance(varied, faults, own_end, state, now, reference, motion):
        end = own_end or run_end
        new, series, signals = program.step(varied, faults, end, state, now, reference, motion)
        return new, series, signals if keep_signals else ()

    def segment(varied, faults, ends, state, first, reference, motion):
        # The segment that begins with tick 0 replaces `state` by the initial state.
        lanes = reference.shape[2]
        fresh = jax.vmap(program.begin, axis_size=lanes)(varied)
        state = jax.tree.map(lambda a, b: jnp.where(first == 0, a, b), fresh, state)

        def body(state, tick):
            # Axis 0 is that of lanes. `golden` is [series, lanes]. All lanes have one `now` and one
            # `motion`, so these have no axis of lanes.
            advance_all = jax.vmap(advance, in_axes=(0, 0, 0, 0, None, 1, None))
            now, golden = tick
            new, series, signals = advance_all(varied, faults, ends, state, now, golden, motion)
            first_lane = jax.tree.map(lambda leaf: leaf[0], signals)
            return new, (jnp.stack(series), first_lane)

        ticks = first + jnp.arange(length, dtype=jnp.int32), reference
        state, (series, signals) = lax.scan(body, state, ticks)
        return state, jax.vmap(program.finish)(varied, state), series, signals

    return segment


class ScanKernel:
    """A compiled segment and the loop over segments."""

    branches = 0

    def __init__(self, program: TickProgram, lanes: int, keep_signals: bool = False):
        self.program, self.lanes = program, lanes
        self.series = program.loop.series_length(program.setup)
        self.dtype = np.dtype(program.setup.precision.real)
        longest = SERIES_BYTES // (lanes * self.series * self.dtype.itemsize)
        self.length = segment_ticks(program.ticks, min(MAX_SEGMENT, longest))
        self.keep_signals = keep_signals
        self.segment = _segment_function(program, self.length, keep_signals)
        self.compiled: dict[int, Any] = {}
        self._locks = collections.defaultdict(threading.Lock)

    def size(self, rows: int) -> int:
        """Return one of two block sizes, each compiled once; see `interface.Kernel`."""
        return min(self.lanes, SMALL_LANES) if rows <= SMALL_LANES else self.lanes

    def _compile(self, lanes: int, arguments: tuple[Any, ...]) -> Any:
        with self._locks[lanes]:
            if lanes not in self.compiled:
                # The new state is written into the memory of the old one, argument 3.
                function = jax.jit(self.segment, donate_argnums=(3,))
                by_mjx = getattr(self.program.setup, "link_dynamics", "") == "mjx"
                options = MJX_ON_CPU if by_mjx and not _accelerators() else None
                self.compiled[lanes] = function.lower(*arguments).compile(compiler_options=options)
        return self.compiled[lanes]

    def prepare(self, block: Block, motion: Motion) -> None:
        """Compile for blocks and motions of these types, for both sizes in parallel."""

        def compile_for(block: Block):
            with traced.x64_context(self.program.setup):
                self._compile(*self._arguments(block, motion))

        small = block.select_lanes(np.arange(block.lanes)[: self.size(1)])
        blocks = [block] if small.lanes == block.lanes else [block, small]
        threads.map_in_threads(compile_for, blocks, 2)

    def _arguments(self, block: Block, motion: Motion):
        # Returns the number of lanes, and the arguments of the first segment, on the devices. Their
        # state is zeros, which the segment replaces. A block without arrays of lanes is full.
        lanes = block.lanes or self.lanes
        varied = [_place(block.varied[path]) for path in self.program.varied]
        faults = jax.tree.map(_place, block.faults)
        shapes = jax.eval_shape(jax.vmap(self.program.begin, axis_size=lanes), varied)
        state = jax.tree.map(lambda s: _place(np.zeros(s.shape, s.dtype)), shapes)
        ends = tuple(map(_place, traced.lane_ends(self.program, block)))
        columns = tuple(jnp.asarray(c) for c in motion)
        reference = self._reference(block, 0, lanes)
        return lanes, (varied, faults, ends, state, jnp.int32(0), reference, columns)

    def _reference(self, block: Block, first: int, lanes: int) -> Any:
        """Return the lanes' golden series from tick `first` on, [length, series, lanes]. The last
        row is repeated if the segment ends after the run. Without golden runs: zeros.
        """
        if not block.compared:
            return _place(np.zeros((self.length, self.series, lanes), self.dtype), axis=2)
        assert block.reference is not None
        rows = np.minimum(np.arange(first, first + self.length), len(block.reference) - 1)
        # Each golden run is copied to the device once, although several lanes may have it.
        runs, run_of_lane = np.unique(block.golden_of(np.arange(lanes)), return_inverse=True)
        series = jnp.asarray(block.reference[rows][:, :, runs])
        return _place(jnp.take(series, _place(run_of_lane), axis=2), axis=2)

    def run(self, block: Block, motion: Motion, progress: Progress | None = None) -> BlockResult:
        """See `interface.Kernel`."""
        return self.run_signals(block, motion, progress)[0]

    def run_signals(
        self, block: Block, motion: Motion, progress: Progress | None = None
    ) -> tuple[BlockResult, Any]:
        """Run a block like `run`. Return also the signals of the first lane, arrays [ticks]."""
        ticks = self.program.ticks
        with traced.x64_context(self.program.setup):
            lanes, arguments = self._arguments(block, motion)
            compiled = self._compile(lanes, arguments)
            varied, faults, ends, state, _, reference, columns = arguments
            # A segment reuses the memory of its state, so no other reference to it may remain.
            del arguments
            outcomes: Any = {}
            chunks = []
            for first in range(0, ticks, self.length):
                if block.compared and first:
                    reference = self._reference(block, first, lanes)
                inputs = varied, faults, ends, state, jnp.int32(first), reference, columns
                state, outcomes, series, signals = compiled(*inputs)
                # Only golden runs and traces return their series.
                if block.reference is None or self.keep_signals:
                    read = series[:, :, : block.rows or lanes]
                    chunks.append(jax.tree.map(np.asarray, (read, signals)))
                jax.block_until_ready(outcomes)
                if progress is not None:
                    progress(min(self.length, ticks - first) * lanes)
        named = {name: np.asarray(value) for name, value in outcomes.items()}
        if not chunks:
            return BlockResult(named, np.zeros((0, self.series, lanes), self.dtype)), ()
        series, signals = jax.tree.map(lambda *parts: np.concatenate(parts)[:ticks], *chunks)
        return BlockResult(named, series), signals


@dataclasses.dataclass(frozen=True)
class ScanEngine:
    """`xla` (the links move by the printed equations) or `mjx` (by `mjx.step`)."""

    name: str
    objects: Any = None  # not used, because JAX itself caches compiled code

    @property
    def device(self) -> str:
        """The device in words."""
        kind = str(jax.devices()[0].device_kind)
        return f"cpu {llvm.get_host_cpu_name()}" if kind == "cpu" else kind

    @property
    def threads(self) -> int:
        """Parallel blocks: one per core on a CPU, one at a time on an accelerator."""
        return 1 if _accelerators() else len(os.sched_getaffinity(0))

    def _program(self, program: TickProgram) -> TickProgram:
        # Returns the program with the link dynamics of this engine.
        if self.name == "xla":
            return program
        if not hasattr(program.setup, "link_dynamics"):
            raise UserError(
                "engine 'mjx' moves the links of the Raven-II and of MJCF files, not those of this"
                " robot: use engine xla, or auto"
            )
        setup = dataclasses.replace(program.setup, link_dynamics="mjx")
        return dataclasses.replace(program, setup=setup)

    def compile(self, program: TickProgram, runs: int) -> ScanKernel:
        """See `interface.Engine`. Block sizes do not depend on the chunk size of the results."""
        lanes = _choose_lanes(runs, self.threads, by_mjx=self.name == "mjx")
        return ScanKernel(self._program(program), lanes)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`."""
        return Tracer(ScanKernel(self._program(program), lanes, keep_signals=True))
