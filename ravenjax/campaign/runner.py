"""Runs a campaign: blocks of lanes through an engine, finished rows into parts, always resumable.

Blocks are cut from whatever rows are missing, as large as the engine likes them, parts have the campaign's chunk size;
a run's result depends on neither. What is under way between plan and disk is bounded: memory grows with the number of
runs by the plan alone.
"""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np

from ravenjax import tick
from ravenjax.campaign import assembly, compile_cache, outcomes, plan, run_id, table
from ravenjax.campaign.assembly import Part
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import OnProgress, Progress
from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.store import manifest, parts, schema
from ravenjax.store.folder import ResultFolder
from ravenjax.store.results import Results

WRITERS = 4
"""Parts that are made into tables and written side by side, at most."""

T = TypeVar("T")


def run_campaign(
    config: CampaignConfig, out: Path | None = None, engine: str = "auto", *, on_progress: OnProgress | None = None
) -> Results:
    """Run `config`, or finish it where `out` holds a part of it.

    out: result folder, None to keep everything in memory. Raises UserError and StoreError for what the user can mend;
    whatever happens, finished parts stay.
    """
    compile_cache.enable()
    ready = plan.make(config)
    chosen = selection.select(engine, ready.program.setup.precision, compile_cache.objects())
    folder = ResultFolder.open(out, _manifest(ready, chosen)) if out is not None else None
    shape, chunk = shape_of(ready), config.campaign.chunk or parts.rows_of_a_part(ready.runs)
    missing = list(folder.missing(chunk) if folder else parts.gaps((), ready.runs, chunk))
    rows, words = sum(map(len, missing)), f"{chosen.name} on {chosen.device}"
    progress = Progress(words, ready.runs, rows, ready.program.ticks, on_progress)
    store = folder.add if folder else functools.partial(schema.conform, shape=shape)
    kept = []
    try:
        if missing:
            kept = _run(ready, chosen, missing, progress, store)
    finally:
        if folder:
            folder.close(progress.compile_s, progress.run_s, progress.stored)
    progress.tell("done")
    return Results(shape, out, () if folder else tuple(kept))


def _run(
    ready: Plan, engine: Engine, missing: Sequence[range], progress: Progress, store: Callable[[schema.Columns], T]
) -> list[T]:
    """Compute the rows of these ranges, each of which is one part; what `store` returned of each, in order."""
    computation = Computation(ready, engine, progress)
    computation.compile()
    writers = min(WRITERS, len(os.sched_getaffinity(0)))
    stored: list[Future[T]] = []

    def finish(part: Part) -> T:
        runs = ready.table.iloc[part.rows.start : part.rows.stop]
        rows = outcomes.columns(ready.config, runs, *part.tables())
        found = store(rows)
        progress.rows(len(part.rows), int(np.count_nonzero(rows["failed"] != "")))
        return found

    with ThreadPoolExecutor(writers) as pool, contextlib.closing(computation.blocks(missing)) as blocks:
        for part in assembly.parts(missing, blocks):
            if len(stored) >= 2 * writers:
                stored[-2 * writers].result()  # neither rows nor errors pile up
            stored.append(pool.submit(finish, part))
        return [future.result() for future in stored]


def _manifest(ready: Plan, engine: Engine) -> manifest.Manifest:
    config, setup = ready.config, ready.program.setup
    content = config.model_dump(mode="json", exclude={"campaign": {"chunk"}})  # how rows are stored decides nothing
    return manifest.Manifest(
        campaign=config.campaign.name,
        config=content,
        config_hash=manifest.config_hash({"config": content, "runs": run_id.digest(ready.table["run_id"].to_numpy())}),
        seed=config.campaign.seed,
        runs=ready.runs,
        duration_ms=ready.program.ticks,
        shape=shape_of(ready),
        cues=tuple(
            manifest.Cue(threshold_mm=c.threshold_m * 1e3, kp_per_mm=c.kp / 1e3, kd_s_per_mm=c.kd / 1e3, cap=c.cap)
            for c in config.haptics.cues()
        ),
        detectors=tuple(
            manifest.Detector(name, use.kind, use.fusion, use.consecutive, levels)
            for name, use, levels in config.detectors
        ),
        verdict_cue=config.outcomes.cue,
        verdict_jump=f"jump_{config.outcomes.jump}",
        engine=engine.name,
        device=f"{engine.device} ({'+'.join(setup.arms)})",
    )


def shape_of(ready: Plan) -> schema.Shape:
    """Which repeated columns a plan's result table has."""
    setup = ready.program.setup
    return schema.Shape(
        arms=setup.arms,
        slots=setup.injection.slots,
        cues=setup.cues,
        checks=tick.CHECKS,
        parameters=tuple(table.parameters(ready.table)),
        reacts=setup.reacts,
        detectors=tuple(use.levels for use in setup.detectors),
    )
