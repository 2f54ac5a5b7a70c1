"""Computes the outcomes of the runs that a search requests. The campaign's code is compiled once.

A *point* is a set of values for a run's inputs. A point always gives the same run: the run's id is
a hash of its content, as in a campaign. Random draws (effect "random", noise) therefore equal those
of a campaign with the same row. The file `journal` stores computed points, so that no point is
computed twice, even after an interruption.
"""

import contextlib
import copy
import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax import interruption
from ravenjax.analyses.search.file.outcome import Outcome
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
from ravenjax.campaign import compile_cache, memory_windows, plan, runner
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors.protocol import finish_chunk
from ravenjax.campaign.faults import design, run_id, table
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import OnProgress, Progress
from ravenjax.engines import selection
from ravenjax.engines.interface import Kernel
from ravenjax.errors import UserError
from ravenjax.store import parts, schema


class Evaluator:
    """Computes outcomes of points. Call it with case [n] and values [n, inputs].

    The result is an array [n, outcomes], with NaN for failed runs.
    """

    def __init__(
        self,
        template: Template,
        wanted: Sequence[Outcome],
        engine: str = "auto",
        margins: bool = False,
    ) -> None:
        """Prepare runs of a template whose outcomes are `wanted`.

        `margins`: compute the distance of a number from its limit, not 0 and 1. Raise UserError for
        outcomes that the campaign does not have.
        """
        compile_cache.enable_cache()
        self.template, self.wanted = template, tuple(wanted)
        self._margins = margins
        # One run per case: settings that select code are equal for all points.
        self._plan = plan.make_plan(template.config)
        self.shape = runner.shape_of(self._plan)
        if complaints := [
            complaint for outcome in wanted for complaint in outcome.complaints(self.shape)
        ]:
            source = f"{template.config.source}: " if template.config.source is not None else ""
            raise UserError("\n".join(f"{source}search: {complaint}" for complaint in complaints))
        self.engine = selection.select_engine(
            engine, self._plan.program.setup.precision, compile_cache.object_cache()
        )
        self.batches = 0
        self.progress = self._progress(1, None, 0, ())
        self._journal: Journal | None = None
        self._computation: Computation | None = None
        self._kernel: Kernel | None = None
        self._tables: list[pa.Table] = []
        self._known = pd.Index(np.zeros(0, np.uint64))  # ids of the tables' rows
        self._values = np.zeros((0, len(self.wanted)))  # outcomes of the runs in `_known`
        self._requested = pd.Index(np.zeros(0, np.uint64))

    def keep_in(self, journal: Journal, expected: int, on_progress: OnProgress | None) -> None:
        """Store runs in `journal`, and use the runs that it contains.

        `expected`: approximate number of runs of the search, for the progress.
        """
        self._journal = journal
        for rows in journal.tables:
            ids = run_id.parse_run_ids(rows.column("run_id").to_pylist())
            # If the process was killed, two files may contain the same runs.
            new = np.flatnonzero(self._known.get_indexer(ids) < 0)
            self._learn(ids[new], [rows.take(new)])
        # `expected` is approximate, so the progress must not start complete.
        self.progress = self._progress(
            expected, on_progress, min(self.held, expected - 1), journal.notes
        )
        for rows in self._tables:
            self.progress.count_failures(parts.count_failures(rows))

    def _progress(
        self, expected: int, on_progress: OnProgress | None, earlier: int, notes: tuple[str, ...]
    ) -> Progress:
        words, ticks = f"{self.engine.name} on {self.engine.device}", self._plan.program.ticks
        return Progress(words, expected, expected - earlier, ticks, on_progress, notes=notes)

    @property
    def runs(self) -> int:
        """Return the number of runs that were requested. A repeated point counts once."""
        return len(self._requested)

    @property
    def held(self) -> int:
        """Return the number of computed runs, including runs of earlier starts of the search."""
        return len(self._known)

    def __call__(self, case: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the outcomes [n, outcomes] of points: case [n] and values [n, inputs] of the axes.

        Only points that were not computed before are computed.
        """
        points, row_of_point = np.unique(
            np.column_stack([case, values]), axis=0, return_inverse=True
        )
        rows = design.table_columns(
            self.template.campaign(points[:, 0].astype(np.int64), points[:, 1:])
        )
        ids = rows["run_id"].to_numpy()
        fresh = ids[self._requested.get_indexer(ids) < 0]
        if len(fresh):
            self._requested, self.batches = (
                self._requested.append(pd.Index(fresh)),
                self.batches + 1,
            )
        new = np.flatnonzero(self._known.get_indexer(ids) < 0)
        if len(new):
            self._run(rows.take(new))
        return self._values[self._known.get_indexer(ids)][row_of_point.reshape(-1)]

    def rows(self) -> pa.Table:
        """Return the result table of all requested runs, in the order of the first requests."""
        stored_rows, numbers = (
            self._known.get_indexer(self._requested),
            np.arange(self.runs, dtype=np.int32),
        )
        return schema.conform_table(
            parts.concatenate_parts(self._tables)
            .iloc[stored_rows]
            .assign(index=numbers, pair=numbers),
            self.shape,
        )

    def _run(self, rows: pd.DataFrame) -> None:
        # Computes the runs as a campaign does, and stores each finished part in the journal.
        ready = self._planned(rows)
        size, tables = parts.rows_of_a_part(ready.runs), []
        chunks = [
            range(first, min(first + size, ready.runs)) for first in range(0, ready.runs, size)
        ]
        computation = self._computation_of(ready)
        with interruption.held_back(), contextlib.closing(computation.blocks(chunks)) as blocks:
            for part in memory_windows.assemble_parts(chunks, blocks):
                done = finish_chunk(
                    ready, part, lambda columns: schema.conform_table(columns, self.shape)
                )
                tables.append(done.packed)
                if self._journal is not None:
                    self._journal.add(done.packed)
                self.progress.count_part(len(done.rows), done.failures)
        self._learn(ready.rows["run_id"].to_numpy(), tables)

    def _learn(self, ids: np.ndarray, tables: Sequence[pa.Table]) -> None:
        """Store the outcomes of newly computed runs. ids: run ids of all rows of the tables."""
        self._tables += tables
        self._known = self._known.append(pd.Index(ids))
        self._values = np.concatenate([self._values, *map(self._wanted, tables)])

    def _wanted(self, rows: pa.Table) -> np.ndarray:
        """Return the outcomes that the search needs, float64 [rows, outcomes]."""
        rules = self._plan.config.rules
        names = {name for one in self.wanted for name in one.columns(rules)}
        columns = rows.select(sorted(names)).to_pandas()
        values = [
            one.margins(columns) if self._margins else one.values(columns, rules)
            for one in self.wanted
        ]
        return np.stack(values, axis=1)

    def _planned(self, rows: pd.DataFrame) -> Plan:
        """Return the template's plan with other rows, sorted so that runs that share a golden run
        are adjacent.
        """
        base, columns = self._plan, table.varied_parameters(rows)
        for path, purpose in base.keys.items():
            columns[path] = run_id.stream_keys(rows["run_id"].to_numpy(), purpose)
        varied = {path: columns[path].astype(values.dtype) for path, values in base.varied.items()}
        golden = plan.number_golden_runs(varied, len(rows))
        order = np.argsort(golden, kind="stable")
        own = np.arange(len(rows), dtype=np.int32)
        rows = rows.take(order).assign(index=own, pair=own)
        return dataclasses.replace(
            base,
            rows=rows,
            faults=table.fault_arrays(rows, base.program.setup.injection, base.tick_ms),
            varied={path: values[order] for path, values in varied.items()},
            golden=golden[order],
        )

    def _computation_of(self, ready: Plan) -> Computation:
        """Return the computation for a plan. It is compiled for the first plan and then reused."""
        if self._computation is None or self._kernel is None:
            self._computation = Computation(ready, self.engine, self.progress)
            self._kernel = self._computation.kernel
            self._computation.compile()
        share = -(-ready.runs // self._computation.threads)
        # Blocks with fewer runs distribute a small batch over all threads.
        kernel = copy.copy(self._kernel)
        kernel.lanes = min(kernel.lanes, kernel.size(min(share, kernel.lanes)))
        self._computation.plan, self._computation.kernel = ready, kernel
        return self._computation
