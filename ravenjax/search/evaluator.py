"""Runs of a template as a function of their inputs: planned once, compiled once, then batch after batch.

The same point is the same run: its id hashes its content, as that of any campaign's run, so what a run draws (effect
"random", noise) is drawn in a campaign with that row, too, and a point that comes again is not run again.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax.campaign import compile_cache, design, outcomes, plan, run_id, runner, table
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import OnProgress, Progress
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, Kernel, Result
from ravenjax.engines.interface import Progress as OnTicks
from ravenjax.errors import UserError
from ravenjax.search.outcome import Outcome
from ravenjax.search.template import Template
from ravenjax.store import schema


class Evaluator:
    """Outcomes of points: `evaluator(case [n], values [n, inputs]) -> [n, outcomes]`, NaN where a run failed."""

    def __init__(
        self,
        template: Template,
        wanted: Sequence[Outcome],
        engine: str = "auto",
        on_progress: OnProgress | None = None,
        due: int = 1,
        margins: bool = False,
    ) -> None:
        """due: about how many runs will be asked for, for `on_progress`. margins: of `wanted` rather than 0 and 1.

        Raises UserError for what cannot be run and for outcomes that there are not.
        """
        compile_cache.enable()
        self.template, self.wanted = template, tuple(wanted)
        self._margins = margins
        self._plan = plan.make(template.config)  # one run a case: what picks code is the same for every point
        self.shape = runner.shape_of(self._plan)
        if wrong := [complaint for outcome in wanted for complaint in outcome.complaints(self.shape)]:
            source = f"{template.config.source}: " if template.config.source is not None else ""
            raise UserError("\n".join(f"{source}search: {complaint}" for complaint in wrong))
        self.engine = selection.select(engine, self._plan.program.setup.precision, compile_cache.objects())
        words, ticks = f"{self.engine.name} on {self.engine.device}", self._plan.program.ticks
        self.progress = Progress(words, due, due, ticks, on_progress)
        self.batches, self.run_s = 0, 0.0
        self._computation: Computation | None = None
        self._kernel: Kernel | None = None
        self._tables: list[pa.Table] = []
        self._known = pd.Index(np.zeros(0, np.uint64))
        self._values = np.zeros((0, len(self.wanted)))

    @property
    def runs(self) -> int:
        """Runs so far; a point that came again counts once."""
        return len(self._known)

    def __call__(self, case: np.ndarray, values: np.ndarray) -> np.ndarray:
        """See the class."""
        start = time.perf_counter()
        points, place = np.unique(np.column_stack([case, values]), axis=0, return_inverse=True)
        rows = design.expand(self.template.campaign(points[:, 0].astype(np.int64), points[:, 1:]))
        ids = rows["run_id"].to_numpy()
        new = np.flatnonzero(self._known.get_indexer(ids) < 0)
        if len(new):
            compiled = self.progress.compile_s
            self._run(rows.iloc[new])
            self.batches += 1
            self.run_s += time.perf_counter() - start - (self.progress.compile_s - compiled)
        return self._values[self._known.get_indexer(ids)][place.reshape(-1)]

    def ids(self, case: np.ndarray, values: np.ndarray) -> list[str]:
        """Run ids of points that are all different."""
        rows = design.expand(self.template.campaign(np.asarray(case), np.asarray(values, float)))
        return run_id.text(rows["run_id"].to_numpy()).to_pylist()

    def rows(self) -> pa.Table:
        """Every run so far as rows of the result table, in the order in which they came."""
        whole = pa.concat_tables(self._tables).unify_dictionaries()
        numbers = pa.array(np.arange(self.runs, dtype=np.int32))
        for name in ("index", "pair"):
            place = whole.schema.get_field_index(name)
            whole = whole.set_column(place, whole.schema.field(place), numbers)
        return whole

    def _run(self, rows: pd.DataFrame) -> None:
        ready = self._planned(rows)
        blocks = list(self._blocks(ready))
        found, twins = ({name: np.concatenate([block[i][name] for block in blocks]) for name in blocks[0][i]}
                        for i in (0, 1))  # fmt: skip
        columns = outcomes.columns(ready.config, ready.table, found, twins)
        wanted = [one.margins(columns) if self._margins else one.values(columns) for one in self.wanted]
        self._values = np.concatenate([self._values, np.stack(wanted, axis=1)])
        self._known = self._known.append(pd.Index(ready.table["run_id"].to_numpy()))
        self._tables.append(schema.conform(columns, self.shape))
        self.progress.rows(ready.runs, int(np.count_nonzero(columns["failed"] != "")))

    def _planned(self, rows: pd.DataFrame) -> Plan:
        """The template's plan with other rows; those that share a twin stand together, so that it is computed once."""
        base, given = self._plan, table.parameters(rows)
        if base.program.setup.noise:
            given[plan.NOISE_KEY] = run_id.stream(rows["run_id"].to_numpy(), "noise")
        varied = {path: given[path].astype(values.dtype) for path, values in base.varied.items()}
        twin = np.zeros(len(rows), np.int32)
        if varied:
            different = np.stack([values.astype(np.float64) for values in varied.values()], axis=1)
            twin = np.unique(different, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)
        order = np.argsort(twin, kind="stable")
        own = np.arange(len(rows), dtype=np.int32)
        rows = rows.iloc[order].assign(index=own, pair=own)
        return dataclasses.replace(
            base,
            table=rows,
            faults=table.arrays(rows, base.program.setup.injection),
            varied={path: values[order] for path, values in varied.items()},
            twin=twin[order],
        )

    def _blocks(self, ready: Plan):
        if self._computation is None or self._kernel is None:
            self._computation = Computation(ready, self.engine, self.progress)
            self._kernel = self._computation.kernel
            self._computation.compile()
        share = -(-ready.runs // self._computation.threads)
        lanes = min(self._kernel.lanes, self._kernel.size(min(share, self._kernel.lanes)))
        self._computation.ready, self._computation.kernel = ready, _Narrow(self._kernel, lanes)
        return self._computation.blocks([range(ready.runs)])


class _Narrow:
    """A kernel whose blocks have fewer lanes, so that a small batch is spread over all threads."""

    def __init__(self, kernel: Kernel, lanes: int) -> None:
        self.kernel, self.lanes = kernel, lanes

    def size(self, rows: int) -> int:
        return self.kernel.size(rows)

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        self.kernel.prepare(block, motion)

    def run(self, block: Block, motion: tuple[np.ndarray, ...], progress: OnTicks | None = None) -> Result:
        return self.kernel.run(block, motion, progress)
