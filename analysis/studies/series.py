"""Computes time series of many runs of a campaign, with a vectorised tick that outputs a few chosen
signals. Each run is evaluated immediately, and its series is not stored.

Engine `simd` compiles the code, also for campaigns that ran on another engine: then the last digits
may differ.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ravenjax import threads
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.plan import Plan
from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.cpu.kernel import print_kernel
from ravenjax.engines.interface import Block
from ravenjax.engines.lanes import Lanes
from ravenjax.ir.time_loop import split_lanes
from ravenjax.numbers.lazy import jax
from ravenjax.store import folder as results
from ravenjax.store import manifest

T = TypeVar("T")
Series = Mapping[str, np.ndarray]
"""Maps a name of SIGNALS to [ticks] or [ticks, k], of the first arm."""

Row = Mapping[str, Any]
"""A row of the result table."""


def _software(name: str) -> Callable[[Any], Any]:
    """Return the place of a signal of the control software."""
    return lambda signals: getattr(signals.control.arms[0], name)


SIGNALS: dict[str, tuple[Callable[[Any], Any], float]] = {
    # Of the first fault slot; absent in a campaign without faults.
    "fault_active": (lambda signals: signals.fault_active[:1], 1.0),
    "tip": (lambda signals: signals.tip[0], 1.0),  # m, true
    # m, as the software measures and wants it
    "position": (lambda signals: signals.control.arms[0].pos.position_um, 1e-6),
    "position_d": (lambda signals: signals.control.arms[0].pos_d.position_um, 1e-6),
    "model_position": (lambda signals: signals.nominal[0].tip_position, 1.0),  # m
    # rad, m, and rad/s, measured; rad, desired; counts
    **{name: (_software(name), 1.0) for name in ("jpos", "mpos", "mvel", "mpos_d")},
    "dac_cnt": (_software("current_cmd_written"), 1.0),
    "last_seq": (lambda signals: signals.control.last_seq, 1.0),  # number of the newest packet
    # mm, from measured tip to nominal model
    "tip_error_mm": (lambda signals: signals.haptics[0].distance, 1e3),
    "cue_force": (lambda signals: signals.haptics[0].force[0], 1.0),  # device units, first cue
}
"""Maps a name to its place in `tick.TickSignals` and the factor to its unit here."""


def own_operator(field: str) -> str:
    """Return the name of a number in the state of the campaign's own operator."""
    return f"{_OWN}{field}"


_OWN = "own operator: "

CUE = ("fault_active", "tip", "position", "model_position", "jpos", "tip_error_mm", "cue_force")
"""Signals of a study of the cue."""


class Recorder:
    """Measures runs on some of SIGNALS. Campaigns with equal programs share compiled code."""

    def __init__(self, names: Iterable[str] = CUE) -> None:
        self._names = tuple(names)
        self._codes: dict[Hashable, _Code] = {}

    def measure(
        self, path: Path, measured: Callable[[Row, Series], T], rows: Sequence[int] | None = None
    ) -> list[T]:
        """Return what `measured` computes for each run of result folder `path`, from its row of the
        result table and its series. `rows`: indices of the wanted runs; None: all.
        """
        ready = plan.make_plan(validate_tables(manifest.read_manifest(path).config))
        table = results.read_all(path).set_index("index", drop=False)
        table = table if rows is None else table.loc[list(rows)]
        code = self._code(ready)

        def block(begin: int) -> list[T]:
            part = table.iloc[begin : begin + code.width]
            series = code.run(ready, part.index.tolist())
            return [
                measured({str(k): v for k, v in row.items()}, one)
                for row, one in zip(part.to_dict("records"), series, strict=True)
            ]

        blocks = threads.map_in_threads(block, range(0, len(table), code.width))
        return [one for of_block in blocks for one in of_block]

    def _code(self, ready: Plan) -> _Code:
        program = ready.program
        numbers = repr([np.asarray(leaf).item() for leaf in jax.tree.leaves(program.params)])
        key = (program.setup, program.varied, program.ticks, numbers)
        if key not in self._codes:
            compile_cache.enable_cache()
            self._codes[key] = _Code(ready, self._names)
        return self._codes[key]


class _Code:
    """The loop of a program that outputs some of SIGNALS in each tick."""

    def __init__(self, ready: Plan, names: Sequence[str]) -> None:
        self.program = traced.printable_program(ready.program)
        self.width = jit.host_target().width
        block = self._block(ready, [0])
        trace = traced.trace_tick(self.program, block, ready.columns)
        loop, self._series = trace.loop, trace.series
        dtypes: dict[int, np.dtype] = {}

        def numbered(shapes: Any, first: int) -> Any:
            """Return the numbers of a step's outputs in place of their types, and note these."""
            leaves, structure = jax.tree.flatten(shapes)
            dtypes.update(enumerate(leaves, first))
            return jax.tree.unflatten(structure, range(first, first + len(leaves)))

        # Outputs of a step: states, reference series, signals
        signals = numbered(trace.signals, loop.states + trace.series)
        places = {}
        for name in names:
            if name.startswith(_OWN):
                types = [np.asarray(block.varied[path]).dtype for path in self.program.varied]
                with traced.x64_context(self.program.setup):
                    varied = traced.record_shapes(types)
                    _, state = traced.trace_function(self.program.begin, varied)
                state = numbered(jax.tree.map(lambda leaf: np.dtype(leaf.dtype), state), 0)
                own = state.stages["own_operator"].file_state
                places[name] = jax.tree.leaves(getattr(own, name.removeprefix(_OWN)))
            else:
                places[name] = jax.tree.leaves(SIGNALS[name][0](signals))
        self._dtypes = {name: [dtypes[k] for k in of] for name, of in places.items()}
        outputs = loop.step.outputs
        picked = [*outputs[: loop.states], *(outputs[k] for of in places.values() for k in of)]
        loop = dataclasses.replace(loop, step=dataclasses.replace(loop.step, outputs=tuple(picked)))
        shared, objects = len(self.program.varied), compile_cache.object_cache()
        parts, features = split_lanes(loop, shared, not shared), jit.host_target().features
        self._code = VectorCode(print_kernel(parts, self.width, features), objects)

    def _block(self, ready: Plan, rows: Sequence[int]) -> Block:
        return Block(*ready.lanes(rows, self.width), None)

    def run(self, ready: Plan, rows: Sequence[int]) -> Iterator[dict[str, np.ndarray]]:
        """Return the series of these rows, at most `width` of them, one after another."""
        ticks, real = self.program.ticks, np.dtype(self.program.setup.precision.real)
        inputs = traced.lane_inputs(self.program, self._block(ready, rows))
        # Only outcomes, which are unused here, read a golden run.
        lanes = (self.width,) if self.program.varied else ()
        golden = np.zeros((1, self._series, *lanes), real)
        out = np.zeros((ticks, self._code.kernel.outputs, self.width), real)
        course = LaneCourse(np.zeros(1, int), np.full(self.width, ticks))
        self._code.run_course(Lanes(inputs, golden, np.concatenate(ready.columns), out), course)
        for lane in range(len(rows)):
            columns, series = iter(np.ascontiguousarray(out[:, :, lane].T)), {}
            for name, dtypes in self._dtypes.items():
                # Integers and booleans are bits of int32.
                parts = [
                    column if dtype.kind == "f" else column.view(np.int32)
                    for dtype, column in zip(dtypes, islice(columns, len(dtypes)), strict=True)
                ]
                if parts:
                    values = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
                    boolean, factor = dtypes[0].kind == "b", SIGNALS.get(name, (None, 1.0))[1]
                    series[name] = values.astype(bool) if boolean else values * factor
            yield series


def rises(active: np.ndarray) -> list[int]:
    """Return the ticks at which `active`, bool [ticks], becomes true."""
    return np.flatnonzero(active & ~np.concatenate([[False], active[:-1]])).tolist()
