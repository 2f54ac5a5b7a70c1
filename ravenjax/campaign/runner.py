"""Runs a campaign: what is missing of it through an executor, finished chunks into parts, always
resumable.

Parts are cut at the multiples of the campaign's chunk; a run's result depends on neither chunk, nor
executor, nor on what was computed before.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from ravenjax import interruption
from ravenjax.campaign import compile_cache
from ravenjax.campaign.executors.local import Local
from ravenjax.campaign.executors.protocol import Executor, FinishedChunk, Work
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.faults import run_id, table
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan, make_plan
from ravenjax.campaign.progress import OnProgress, Progress, ProgressFile
from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.errors import StoreError, UserError
from ravenjax.store import files, manifest, parts, schema
from ravenjax.store.access import lock
from ravenjax.store.access.results import Results
from ravenjax.store.folder import ResultFolder


def run_campaign(
    config: CampaignConfig,
    out: Path | None = None,
    engine: str = "auto",
    *,
    on_progress: OnProgress | None = None,
    rows: Sequence[range] | None = None,
    executor: Executor | None = None,
    shard: Shard | None = None,
    command: Sequence[str] = (),
) -> Results:
    """Run `config`, or finish it where `out` holds a part of it. `campaign.limit` is no part of
    what identifies a folder: with another one, or without, the same campaign goes on.

    out: result folder, None to keep everything in memory. rows: compute these only; a folder that
    already holds, or is to hold, others goes on with both. shard: compute its share only. command:
    the command line, for the record. Raises UserError and StoreError for what the user can mend;
    whatever happens, finished parts stay.
    """
    compile_cache.enable()
    plan = make_plan(config)
    interruption.point()
    backend = selection.select(engine, plan.program.setup.precision, compile_cache.objects())
    executor = executor or Local()
    chunk = config.campaign.chunk or parts.rows_of_a_part(plan.runs, executor.workers)
    first = range(min(config.campaign.limit or plan.runs, plan.runs))
    if shard is not None:
        if rows is not None:
            raise UserError(f"rows and shard {shard} were both given, expected one of them")
        chunk = config.campaign.chunk or shard.chunk(len(first), chunk)
        rows = shard.rows(len(first), chunk)
    elif rows is None and len(first) < plan.runs:
        rows = [first]
    record = _manifest(plan, backend).model_copy(
        update={
            "rows": None if rows is None else _pairs(rows, plan.runs),
            "shard": None if shard is None else str(shard),
            "command": tuple(command),
        }
    )
    if out is None:
        return _in_memory(
            plan, backend, executor, list(parts.gaps((), record.wanted, chunk)), on_progress
        )
    files.require_writable(out)
    with lock.held(out):
        folder = ResultFolder.open(out, record)
        _into(folder, plan, backend, executor, list(folder.missing(chunk)), on_progress)
    return Results(record.shape, out)


def _into(
    folder: ResultFolder,
    plan: Plan,
    engine: Engine,
    executor: Executor,
    missing: Sequence[range],
    on_progress: OnProgress | None,
) -> None:
    """Compute what is missing into its folder."""
    listener, shape = ProgressFile(folder.path, on_progress), shape_of(plan)
    due = folder.manifest.due
    progress = _progress(plan, engine, due, missing, listener, folder.notes)
    progress.known(folder.manifest.failures)

    def deliver(done: FinishedChunk[parts.Encoded]) -> None:
        folder.put(done.packed)
        progress.part(len(done.rows), done.failures)

    pack = functools.partial(parts.encode, shape=shape, config_hash=folder.manifest.config_hash)
    try:
        if missing:
            executor.run(Work(plan, engine, pack, deliver, progress), missing)
    except BaseException:
        with contextlib.suppress(StoreError):  # a disk that is full, or gone, has been told of
            folder.close(progress.compile_s, progress.run_s, progress.stored)
        progress.tell("stopped")
        raise
    folder.close(progress.compile_s, progress.run_s, progress.stored)
    progress.tell("done")


def _in_memory(
    plan: Plan,
    engine: Engine,
    executor: Executor,
    chunks: Sequence[range],
    on_progress: OnProgress | None,
) -> Results:
    """Compute chunks into tables."""
    shape, tables = shape_of(plan), dict[int, pa.Table]()
    progress = _progress(plan, engine, sum(map(len, chunks)), chunks, on_progress, ())

    def deliver(done: FinishedChunk[pa.Table]) -> None:
        tables[done.rows.start] = done.packed
        progress.part(len(done.rows), done.failures)

    if chunks:
        executor.run(
            Work(plan, engine, functools.partial(schema.conform, shape=shape), deliver, progress),
            chunks,
        )
    progress.tell("done")
    return Results(shape, None, tuple(tables[first] for first in sorted(tables)))


def _progress(
    plan: Plan,
    engine: Engine,
    due: int,
    missing: Sequence[range],
    told: Any,
    notes: tuple[str, ...],
) -> Progress:
    words, rows = f"{engine.name} on {engine.device}", sum(map(len, missing))
    return Progress(words, due, rows, plan.program.ticks, told, notes=notes)


def _pairs(rows: Sequence[range], runs: int) -> tuple[tuple[int, int], ...]:
    """Row ranges as a manifest has them; raises UserError for rows that the campaign has not."""
    for some in rows:
        if some.step != 1 or (some and not 0 <= some.start < some.stop <= runs):
            raise UserError(
                f"rows {some}: expected ranges of step 1 within 0 to {runs}, the runs of the"
                " campaign"
            )
    return manifest.joined(tuple((some.start, some.stop - 1) for some in rows if some)) or ()


def _manifest(plan: Plan, engine: Engine) -> manifest.Manifest:
    config, setup = plan.config, plan.program.setup
    # How rows are stored, and how many of them are computed, decides no outcome.
    undecided = {"chunk", "limit"} | (
        {"observe_ms"} if config.campaign.observe_ms is None else set()
    )
    content = config.model_dump(mode="json", exclude={"campaign": undecided})
    return manifest.Manifest(
        campaign=config.campaign.name,
        config=content,
        config_hash=manifest.campaign_hash(
            content, plan.operator, run_id.digest(plan.rows.numbers("run_id"))
        ),
        seed=config.campaign.seed,
        runs=plan.runs,
        duration_ms=plan.program.ticks,
        shape=shape_of(plan),
        cues=tuple(
            manifest.CueRecord(
                threshold_mm=c.threshold_m * 1e3,
                kp_per_mm=c.kp / 1e3,
                kd_s_per_mm=c.kd / 1e3,
                cap=c.cap,
            )
            for c in config.haptics.cues()
        ),
        detectors=tuple(
            manifest.DetectorRecord(
                name, use.kind, use.fusion, use.consecutive, thresholds, use.stops
            )
            for name, use, thresholds in config.detectors
        ),
        operator=plan.operator,
        verdict_cue=config.outcomes.cue,
        verdict_jump=f"jump_{config.outcomes.jump}",
        limit_mm=config.outcomes.limit_mm,
        code_hash=manifest.code_hash(config.robot),
        engine=engine.name,
        device=f"{engine.device} ({'+'.join(setup.arms)})",
    )


def shape_of(plan: Plan) -> schema.Shape:
    """Which repeated columns a plan's result table has."""
    setup = plan.program.setup
    return schema.Shape(
        robot=plan.config.campaign.robot,
        arms=setup.arms,
        joints=setup.joints,
        slots=setup.injection.slots,
        cues=setup.cues,
        checks=tuple(plan.config.robot.checks),
        parameters=tuple(table.parameters(plan.rows)),
        reacts=setup.reacts,
        hand_yields=setup.hand_yields,
        cables=plan.config.watches_cables,
        contact=plan.config.touches,
        detectors=tuple(use.thresholds for use in setup.detectors),
        observes=plan.program.ends,
        own_checks=plan.config.own_checks,
        stops=plan.config.stops,
    )
