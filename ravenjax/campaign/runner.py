"""Runs a campaign: fixed blocks of lanes through an engine, finished rows into parts, always resumable.

Blocks have the kernel's size and are cut from whatever rows are missing, parts have the campaign's chunk size; a
lane's result depends on neither. Each block of faulty runs is preceded by the fault-free twins it is compared with; a
twin that many runs share is computed once.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax import tick
from ravenjax.campaign import compile_cache, outcomes, plan
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, Engine, Kernel
from ravenjax.store import manifest, parts, schema
from ravenjax.store.folder import ResultFolder, read_all

TWIN_BYTES = 256 * 2**20
"""Memory that the twins' time series may take."""


@dataclasses.dataclass(frozen=True)
class Status:
    """How far a campaign is."""

    phase: str  # "compile", "run" or "done"
    done: int  # runs finished, those of earlier starts included
    total: int
    compile_s: float  # s, tracing and compiling
    run_s: float  # s, executing so far
    progress: float  # share of this start's work that is done, 0 to 1
    failed: int  # runs of this start whose outcome is not valid
    engine: str  # which engine runs, on what

    @property
    def left_s(self) -> float | None:
        """Estimated seconds left."""
        return self.run_s * (1.0 - self.progress) / self.progress if self.progress > 0 else None


OnProgress = Callable[[Status], None]


def run_campaign(
    config: CampaignConfig, out: Path | None = None, engine: str = "auto", *, on_progress: OnProgress | None = None
) -> pd.DataFrame:
    """Run `config`, or finish it where `out` holds a part of it; the result table, ordered by `index`.

    out: result folder, None to keep everything in memory. Raises UserError and StoreError for what the user can mend;
    whatever happens, finished parts stay.
    """
    compile_cache.enable()
    ready = plan.make(config)
    chosen = selection.select(engine, ready.program.setup.precision, compile_cache.objects())
    folder = ResultFolder.open(out, _manifest(ready, chosen)) if out is not None else None
    chunk = config.campaign.chunk
    missing = (
        list(folder.missing(chunk))
        if folder
        else [range(i, min(i + chunk, ready.runs)) for i in range(0, ready.runs, chunk)]
    )
    work = _Work(ready, chosen, sum(map(len, missing)), on_progress)
    kept: list[pd.DataFrame] = []
    try:
        if missing:
            work.compile()
        for rows in _batches(ready, missing, work.kernel):
            for finished in work.batch(rows):
                (folder.add if folder else kept.append)(finished)
                work.stored += len(finished)
    finally:
        if folder:
            folder.close(work.compile_s, work.run_s, work.stored)
    work.report("done")
    if out is not None:
        return read_all(out)
    return parts.concatenate([schema.conform(part, _shape(ready)) for part in kept])


def _manifest(ready: Plan, engine: Engine) -> manifest.Manifest:
    config, setup = ready.config, ready.program.setup
    content = config.model_dump(mode="json", exclude={"campaign": {"chunk"}})  # how rows are stored decides nothing
    return manifest.Manifest(
        campaign=config.campaign.name,
        config=content,
        config_hash=manifest.config_hash({"config": content, "runs": list(ready.table["run_id"])}),
        seed=config.campaign.seed,
        runs=ready.runs,
        duration_ms=ready.program.ticks,
        shape=_shape(ready),
        cues=tuple(
            manifest.Cue(threshold_mm=c.threshold_m * 1e3, kp_per_mm=c.kp / 1e3, kd_s_per_mm=c.kd / 1e3, cap=c.cap)
            for c in config.haptics.cues()
        ),
        verdict_cue=config.outcomes.cue,
        verdict_jump=f"jump_{config.outcomes.jump}",
        engine=engine.name,
        device=f"{engine.device} ({'+'.join(setup.arms)})",
    )


def _shape(ready: Plan) -> schema.Shape:
    setup = ready.program.setup
    return schema.Shape(
        arms=setup.arms,
        slots=setup.injection.slots,
        cues=setup.cues,
        checks=tick.CHECKS,
        parameters=tuple(path for path in ready.varied if path != plan.NOISE_KEY),
    )


def _batches(ready: Plan, missing: Sequence[range], kernel: Kernel | None) -> Iterator[list[range]]:
    """Ranges of rows taken together: enough to keep every thread busy, few enough that their twins fit in memory."""
    if kernel is None:
        return
    setup = ready.program.setup
    per_twin = ready.program.ticks * 6 * len(setup.arms) * np.dtype(setup.precision.real).itemsize
    most_twins = max(kernel.lanes, TWIN_BYTES // per_twin)
    batch: list[range] = []
    twins: set[int] = set()
    for rows in missing:
        new = twins | set(ready.twin[rows.start : rows.stop].tolist())
        if batch and (len(new) > most_twins or sum(map(len, batch)) >= 64 * kernel.lanes):
            yield batch
            batch, new = [], set(ready.twin[rows.start : rows.stop].tolist())
        batch.append(rows)
        twins = new
    if batch:
        yield batch


Columns = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class _Twins:
    """Fault-free twins, in ascending order of their numbers."""

    numbers: np.ndarray  # int64 [twins]
    reference: np.ndarray  # [twins, ticks, series]
    outcomes: Columns  # outcome -> [twins]

    def picked(self, numbers: np.ndarray) -> _Twins:
        """Those of `numbers` (ascending) that are here."""
        kept = np.isin(self.numbers, numbers)
        outcomes = {name: values[kept] for name, values in self.outcomes.items()}
        return _Twins(self.numbers[kept], self.reference[kept], outcomes)

    def joined(self, more: list[_Twins]) -> _Twins:
        """These and others."""
        every = [twins for twins in (self, *more) if len(twins.numbers)]
        numbers = np.concatenate([twins.numbers for twins in every])
        order = np.argsort(numbers)
        outcomes = {n: np.concatenate([twins.outcomes[n] for twins in every])[order] for n in every[0].outcomes}
        return _Twins(numbers[order], np.concatenate([twins.reference for twins in every])[order], outcomes)


_NO_TWINS = _Twins(np.zeros(0, np.int64), np.zeros((0, 0, 0)), {})


class _Work:
    """One start of a campaign."""

    def __init__(self, ready: Plan, engine: Engine, rows: int, on_progress: OnProgress | None) -> None:
        self.ready, self.engine, self.on_progress = ready, engine, on_progress
        self.rows = rows  # to compute in this start
        self.stored = self.failed = 0
        self.compile_s = self.run_s = 0.0
        self.kernel: Kernel | None = engine.compile(ready.program, ready.runs) if rows else None
        self.ticks_done = 0
        self.ticks_due = max(1, rows * ready.program.ticks)
        self._began = 0.0
        self._lock = threading.Lock()
        self._twins = _NO_TWINS

    def compile(self) -> None:
        """Trace and compile, before the clock of the runs starts."""
        self.report("compile")
        assert self.kernel is not None
        start = time.perf_counter()
        varied, faults = self.ready.lanes(range(min(self.ready.runs, self.kernel.lanes)), self.kernel.lanes)
        self.kernel.prepare(Block(varied, faults, None), self.ready.columns)
        self.compile_s = time.perf_counter() - start
        self._began = time.perf_counter()
        self.report("run")

    def batch(self, ranges: Sequence[range]) -> Iterator[pd.DataFrame]:
        """The result rows of each range, as soon as it is whole; every range is one part."""
        assert self.kernel is not None
        rows = np.concatenate([np.asarray(r) for r in ranges])
        ends = np.cumsum([len(r) for r in ranges])
        found: Columns = {}
        done = np.zeros(len(rows), bool)
        with ThreadPoolExecutor(max_workers=max(1, self.engine.threads)) as pool:
            try:
                self._run_twins(pool, rows)
                places = _cut(np.arange(len(rows)), self.kernel.lanes)
                pending = {pool.submit(self._faulty, rows[place]): place for place in places}
                waiting = dict(enumerate(ends))
                while pending:
                    finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                    for future in finished:
                        place = pending.pop(future)
                        for name, values in future.result().items():
                            found.setdefault(name, np.zeros(len(rows), values.dtype))[place] = values
                        done[place] = True
                    for i, end in list(waiting.items()):
                        part = slice(end - len(ranges[i]), end)
                        if done[part].all():
                            del waiting[i]
                            yield self._frame(ranges[i], {name: values[part] for name, values in found.items()})
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def _run_twins(self, pool: ThreadPoolExecutor, rows: np.ndarray) -> None:
        """Make sure that the twin of each of `rows` is there, and no other."""
        assert self.kernel is not None
        numbers, first = np.unique(self.ready.twin[rows], return_index=True)
        self._twins = self._twins.picked(numbers)
        lacking = rows[first[~np.isin(numbers, self._twins.numbers)]]
        blocks = _cut(lacking, self.kernel.lanes)
        with self._lock:
            self.ticks_due += len(blocks) * self.kernel.lanes * self.ready.program.ticks
        futures: list[Future[_Twins]] = [pool.submit(self._twin_block, block) for block in blocks]
        self._twins = self._twins.joined([future.result() for future in futures])

    def _twin_block(self, rows: np.ndarray) -> _Twins:
        assert self.kernel is not None
        varied, faults = self.ready.lanes(rows, self.kernel.lanes, harmless=True)
        result = self.kernel.run(Block(varied, faults, None), self.ready.columns, self._advance)
        outcomes = {name: values[: len(rows)] for name, values in result.outcomes.items()}
        reference = np.ascontiguousarray(np.moveaxis(result.reference[:, :, : len(rows)], 2, 0))
        return _Twins(self.ready.twin[rows], reference, outcomes)

    def _faulty(self, rows: np.ndarray) -> Columns:
        assert self.kernel is not None
        lanes = self.kernel.lanes
        index = np.searchsorted(self._twins.numbers, self.ready.twin[rows])
        if (index == index[0]).all():
            one = self._twins.reference[index[0]][:, :, None]
            reference = np.broadcast_to(one, (*one.shape[:2], lanes))
        else:
            padded = index[np.minimum(np.arange(lanes), len(rows) - 1)]
            reference = np.moveaxis(self._twins.reference[padded], 0, 2)
        varied, faults = self.ready.lanes(rows, lanes)
        result = self.kernel.run(Block(varied, faults, reference), self.ready.columns, self._advance)
        return {name: values[: len(rows)] for name, values in result.outcomes.items()}

    def _frame(self, part: range, found: Columns) -> pd.DataFrame:
        index = np.searchsorted(self._twins.numbers, self.ready.twin[part.start : part.stop])
        twins = pd.DataFrame({name: values[index] for name, values in self._twins.outcomes.items()})
        table = self.ready.table.iloc[part.start : part.stop]
        rows = outcomes.frame(self.ready.config, table, pd.DataFrame(found), twins)
        self.failed += int(np.count_nonzero(rows["failed"] != ""))
        return rows

    def _advance(self, ticks: int) -> None:
        with self._lock:
            self.ticks_done += ticks
            self.report("run")

    def report(self, phase: str) -> None:
        """Tell how far the campaign is."""
        if self._began:
            self.run_s = time.perf_counter() - self._began
        if self.on_progress is not None:
            earlier = self.ready.runs - self.rows
            share = 1.0 if phase == "done" else min(1.0, self.ticks_done / self.ticks_due)
            self.on_progress(
                Status(
                    phase,
                    earlier + self.stored,
                    self.ready.runs,
                    self.compile_s,
                    self.run_s,
                    share,
                    self.failed,
                    f"{self.engine.name} on {self.engine.device}",
                )
            )


def _cut(rows: np.ndarray, size: int) -> list[np.ndarray]:
    return [rows[i : i + size] for i in range(0, len(rows), size)]
