"""Computes time series of many runs of a campaign, with a vectorised tick that outputs a few chosen
signals.

The code is compiled once. It comes from engine `simd`, whatever engine the campaign ran on. On a
CPU the bits are the same; from a GPU the last digits may differ. Each run is measured immediately
and its series dropped.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from ravenjax import threads
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.file.config import validate_tables
from ravenjax.campaign.plan import Plan
from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import VectorCode
from ravenjax.engines.interface import Block
from ravenjax.engines.lanes import Lanes
from ravenjax.store import folder as results
from ravenjax.store import manifest

T = TypeVar("T")
Series = Mapping[str, np.ndarray]
"""Maps a name of SIGNALS to [ticks] or [ticks, k], of the first arm."""

Row = Mapping[str, Any]
"""A row of the result table."""

SIGNALS: dict[str, tuple[Callable[[Any], Any], float]] = {
    # Of the first fault slot; absent in a campaign without faults.
    "fault_active": (lambda signals: signals.fault_active[:1], 1.0),
    "tip": (lambda signals: signals.tip[0], 1.0),  # m, true
    "position": (
        lambda signals: signals.control.arms[0].pos.position_um,
        1e-6,
    ),  # m, as the software measures it
    "model_position": (lambda signals: signals.nominal[0].tip_position, 1.0),  # m
    "jpos": (lambda signals: signals.control.arms[0].jpos, 1.0),  # rad, m; measured
    "tip_error_mm": (
        lambda signals: signals.haptics[0].distance,
        1e3,
    ),  # mm, from measured tip to nominal model
    "cue_force": (lambda signals: signals.haptics[0].force[0], 1.0),  # device units, first cue
}
"""Maps a name to its place in `tick.TickSignals` and the factor to its unit here."""


class Recorder:
    """Measures runs on their time series. Campaigns with equal programs share compiled code."""

    def __init__(self) -> None:
        self._codes: dict[Hashable, _Code] = {}

    def measure(
        self,
        path: Path,
        measured: Callable[[Row, Series], T],
        chosen: Callable[[pd.DataFrame], Sequence[int]] | None = None,
    ) -> list[T]:
        """Return what `measured` computes for each run of result folder `path`, from its row of the
        result table and its series.

        `chosen`: indices of the wanted runs in the result table; None takes all. Raises StoreError
        as `read_all` does.
        """
        config = validate_tables(manifest.read_manifest(path).config)
        table = results.read_all(path).set_index("index", drop=False)
        ready = plan.make_plan(config)
        code = self._code(ready)
        rows = table["index"].tolist() if chosen is None else list(chosen(table))
        blocks = [rows[i : i + code.width] for i in range(0, len(rows), code.width)]

        def block(rows: list[int]) -> list[T]:
            pairs = zip(table.loc[rows].to_dict("records"), code.run(ready, rows), strict=True)
            return [measured({str(k): v for k, v in row.items()}, series) for row, series in pairs]

        return [one for of_block in threads.map_in_threads(block, blocks) for one in of_block]

    def _code(self, ready: Plan) -> _Code:
        program = ready.program
        key = (program.setup, program.varied, program.ticks, _numbers(program.params))
        if key not in self._codes:
            compile_cache.enable_cache()
            self._codes[key] = _Code(ready)
        return self._codes[key]


class _Code:
    """The loop of a program that outputs SIGNALS in each tick."""

    def __init__(self, ready: Plan) -> None:
        from ravenjax.numbers.lazy import jax

        self.program = traced.printable_program(ready.program)
        self.width = jit.host_target().width
        trace = traced.trace_tick(self.program, self._block(ready, [0]), ready.columns)
        leaves, structure = jax.tree.flatten(trace.signals)
        numbered = jax.tree.unflatten(structure, list(range(len(leaves))))
        loop = trace.loop
        before, picked, dtypes = loop.states + trace.series, [], []
        for name, (where, _) in SIGNALS.items():
            numbers = jax.tree.leaves(where(numbered))
            dtypes.append((name, [leaves[k] for k in numbers]))
            picked += [loop.step.outputs[before + k] for k in numbers]
        self._dtypes: list[tuple[str, list[np.dtype]]] = dtypes
        step = dataclasses.replace(loop.step, outputs=(*loop.step.outputs[: loop.states], *picked))
        shared = len(self.program.varied)
        self._series = trace.series
        objects = compile_cache.object_cache()
        self._code = VectorCode(
            dataclasses.replace(loop, step=step), shared, not shared, self.width, objects
        )

    def _block(self, ready: Plan, rows: Sequence[int]) -> Block:
        return Block(*ready.lanes(rows, self.width), None)

    def run(self, ready: Plan, rows: Sequence[int]) -> Iterator[dict[str, np.ndarray]]:
        """Return the series of these rows, at most `width` of them, one after another."""
        ticks, real = self.program.ticks, np.dtype(self.program.setup.precision.real)
        inputs = traced.lane_inputs(self.program, self._block(ready, rows))
        # Only outcomes, which are unused here, read a golden run.
        golden = np.zeros(
            (1, self._series) if self._code.grouped else (1, self._series, self.width), real
        )
        out = np.zeros((ticks, self._code.outputs, self.width), real)
        self._code.run(Lanes(inputs, golden, np.concatenate(ready.columns), out), ticks)
        for lane in range(len(rows)):
            yield self._named(np.ascontiguousarray(out[:, :, lane].T))

    def _named(self, columns: np.ndarray) -> dict[str, np.ndarray]:
        """Name the columns. `columns`: [numbers, ticks], with integers and booleans as the bits of
        32-bit integers.
        """
        series, first = {}, 0
        for (name, dtypes), (_, factor) in zip(self._dtypes, SIGNALS.values(), strict=True):
            parts = [
                column if dtype.kind == "f" else column.view(np.int32)
                for column, dtype in zip(columns[first : first + len(dtypes)], dtypes, strict=True)
            ]
            first += len(dtypes)
            if not parts:
                continue
            values = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
            series[name] = values.astype(bool) if dtypes[0].kind == "b" else values * factor
        return series


def _numbers(params: Any) -> str:
    """Return every number of a parameter record as text that distinguishes two records."""
    from ravenjax.numbers.lazy import jax

    return repr([np.asarray(leaf).item() for leaf in jax.tree.leaves(params)])


def rises(active: np.ndarray) -> list[int]:
    """Return the ticks at which `active`, bool [ticks], becomes true."""
    return np.flatnonzero(active & ~np.concatenate([[False], active[:-1]])).tolist()
