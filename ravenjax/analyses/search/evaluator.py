"""Computes the outcomes of the runs that a search requests. The campaign's code is compiled once.

A *point* is a set of values for a run's inputs. A point always gives the same run: the run's id is
a hash of its content, as in a campaign. Random draws (effect "random", noise) therefore equal those
of a campaign with the same row. The file `journal` stores computed points, so that no point is
computed twice, even after an interruption.
"""

import contextlib
import copy
import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax import interruption
from ravenjax.analyses.search.file.outcome import Outcome
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
from ravenjax.campaign import compile_cache, memory_windows, plan
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors.protocol import finish_chunk
from ravenjax.campaign.faults import design, run_id, table
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import OnProgress, Progress
from ravenjax.errors import UserError
from ravenjax.store import parts, schema


class Evaluator:
    """Computes outcomes of points. Call it with case [n] and values [n, inputs]. The result is an
    array [n, outcomes], with NaN for failed runs.
    """

    def __init__(
        self,
        template: Template,
        wanted: Sequence[Outcome],
        engine: str = "auto",
        margins: bool = False,
    ):
        """Prepare runs of a template, of which the outcomes `wanted` are computed.

        `margins`: True computes the distance of a number from its limit instead of 0 or 1. Raise
        UserError for outcomes that the campaign does not have.
        """
        self.template, self.wanted = template, tuple(wanted)
        self._computes_margins = margins
        # One run per case is enough to compile the code that computes all points.
        self._plan = plan.make_plan(template.config)
        complaints = [text for outcome in wanted for text in outcome.complaints(self._plan.shape)]
        if complaints:
            source = f"{template.config.source}: " if template.config.source is not None else ""
            raise UserError("\n".join(f"{source}search: {complaint}" for complaint in complaints))
        self.engine = compile_cache.cached_engine(engine, self._plan.program.setup.precision)
        self.batches = 0
        # `use_journal` replaces this, when the number of runs is known.
        self.progress = self._progress(1, None, 0, ())
        self._journal: Journal | None = None
        self._computation: Computation | None = None
        self._tables: list[pa.Table] = []
        # Ids of all computed runs, in the order of the tables' rows, and their outcomes.
        self._computed = pd.Index(np.zeros(0, np.uint64))
        self._values = np.zeros((0, len(self.wanted)))
        self._requested = pd.Index(np.zeros(0, np.uint64))

    def use_journal(self, journal: Journal, expected: int, on_progress: OnProgress | None) -> None:
        """Store runs in `journal`, and use the runs that it contains. `expected`: approximate
        number of runs of the search, for the progress.
        """
        self._journal = journal
        for rows in journal.tables:
            ids = run_id.parse_run_ids(rows.column("run_id").to_pylist())
            # If the process was killed, two files may contain the same runs.
            new = np.flatnonzero(self._computed.get_indexer(ids) < 0)
            self._add_runs(ids[new], [rows.take(new)])
        # `expected` is approximate, so the progress must not start complete.
        self.progress = self._progress(
            expected, on_progress, min(len(self._computed), expected - 1), journal.notes
        )
        for rows in self._tables:
            self.progress.count_failures(parts.count_failures(rows))

    def _progress(
        self, expected: int, on_progress: OnProgress | None, earlier: int, notes: tuple[str, ...]
    ) -> Progress:
        # `earlier`: number of runs that earlier starts of the search have computed.
        engine, ticks = f"{self.engine.name} on {self.engine.device}", self._plan.program.ticks
        return Progress(engine, expected, expected - earlier, ticks, on_progress, notes=notes)

    @property
    def runs(self) -> int:
        """Number of runs that were requested. A repeated point counts once."""
        return len(self._requested)

    def __call__(self, case: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the outcomes [n, outcomes] of points: case [n] and values [n, inputs].

        Only points that were not computed before are computed, and equal points only once.
        """
        points, point_index = np.unique(
            np.column_stack([case, values]), axis=0, return_inverse=True
        )
        campaign = self.template.campaign(points[:, 0].astype(np.int64), points[:, 1:])
        rows = design.table_columns(campaign)
        ids = rows["run_id"].to_numpy()
        # `get_indexer` returns -1 for an id that the index does not contain.
        first_requests = ids[self._requested.get_indexer(ids) < 0]
        if len(first_requests):
            self._requested = self._requested.append(pd.Index(first_requests))
            self.batches += 1
        new = np.flatnonzero(self._computed.get_indexer(ids) < 0)
        if len(new):
            self._compute_runs(rows.take(new))
        return self._values[self._computed.get_indexer(ids)][point_index.reshape(-1)]

    def rows(self) -> pa.Table:
        """Return the result table of all requested runs, in the order of the first requests."""
        stored_rows = self._computed.get_indexer(self._requested)
        numbers = np.arange(self.runs, dtype=np.int32)
        table = parts.concatenate_parts(self._tables).iloc[stored_rows]
        # A search has no crossed parameters, so each run is its own pair.
        return schema.conform_table(table.assign(index=numbers, pair=numbers), self._plan.shape)

    def _compute_runs(self, rows: pd.DataFrame):
        # Computes the runs as a campaign does, and stores each finished part in the journal. A part
        # is a chunk of consecutive rows. The engine computes it in smaller blocks.
        planned = self._plan_rows(rows)
        size = parts.rows_of_a_part(planned.runs)
        tables = []
        starts = range(0, planned.runs, size)
        chunks = [range(start, min(start + size, planned.runs)) for start in starts]
        computation = self._computation_of(planned)
        with interruption.delay_signals(), contextlib.closing(computation.blocks(chunks)) as blocks:
            for part in memory_windows.assemble_parts(chunks, blocks):
                done = finish_chunk(
                    planned, part, lambda columns: schema.conform_table(columns, self._plan.shape)
                )
                tables.append(done.packed)
                if self._journal is not None:
                    self._journal.add(done.packed)
                self.progress.count_part(len(done.rows), done.failures)
        self._add_runs(planned.rows["run_id"].to_numpy(), tables)

    def _add_runs(self, ids: np.ndarray, tables: Sequence[pa.Table]):
        # Adds computed runs to the known runs. ids: run ids of all rows of the tables.
        self._tables += tables
        self._computed = self._computed.append(pd.Index(ids))
        self._values = np.concatenate([self._values, *map(self._outcomes_of, tables)])

    def _outcomes_of(self, rows: pa.Table) -> np.ndarray:
        """Return the wanted outcomes of the rows of a result table, float64 [rows, outcomes]."""
        rules = self._plan.config.rules
        names = {name for outcome in self.wanted for name in outcome.columns(rules)}
        columns = rows.select(sorted(names)).to_pandas()
        if self._computes_margins:
            values = [outcome.margins(columns) for outcome in self.wanted]
        else:
            values = [outcome.values(columns, rules) for outcome in self.wanted]
        return np.stack(values, axis=1)

    def _plan_rows(self, rows: pd.DataFrame) -> Plan:
        """Return the search's plan with other rows. Runs that share a golden run are adjacent."""
        base, columns = self._plan, table.varied_parameters(rows)
        # Keys of random numbers depend on the run id.
        for path, purpose in base.keys.items():
            columns[path] = run_id.stream_keys(rows["run_id"].to_numpy(), purpose)
        varied = {path: columns[path].astype(values.dtype) for path, values in base.varied.items()}
        golden = plan.number_golden_runs(varied, len(rows))
        order = np.argsort(golden, kind="stable")
        numbers = np.arange(len(rows), dtype=np.int32)
        # A search has no crossed parameters, so each run is its own pair.
        rows = rows.take(order).assign(index=numbers, pair=numbers)
        return dataclasses.replace(
            base,
            rows=rows,
            faults=table.fault_arrays(rows, base.program.setup.injection, base.tick_ms),
            varied={path: values[order] for path, values in varied.items()},
            golden=golden[order],
        )

    def _computation_of(self, planned: Plan) -> Computation:
        """Return the computation for a plan. It is compiled for the first plan and then reused."""
        if self._computation is None:
            self._computation = Computation(planned, self.engine, self.progress)
        computation = self._computation.of(planned)
        # Smaller blocks distribute a small batch over all threads. The kernel is copied, because
        # the next plan may need larger blocks.
        runs_per_thread = math.ceil(planned.runs / computation.threads)
        kernel = computation.kernel = copy.copy(computation.kernel)
        kernel.lanes = min(kernel.lanes, kernel.size(min(runs_per_thread, kernel.lanes)))
        return computation
