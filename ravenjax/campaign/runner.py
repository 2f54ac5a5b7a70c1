"""Runs a campaign: computes its missing runs and stores them as Parquet files in the result folder.

Each file, a *part*, begins at a multiple of the chunk size. The result of a run does not depend on
the chunk size, on the executor that computes it, or on earlier runs.
"""

import contextlib
import functools
import shutil
import tempfile
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path

from ravenjax import interruption
from ravenjax.campaign import compile_cache, notices
from ravenjax.campaign.executors.protocol import Executor, FinishedChunk, Local, Work
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.faults import run_id
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan, make_plan
from ravenjax.campaign.progress import OnProgress, Progress, ProgressFile
from ravenjax.engines.interface import Engine
from ravenjax.errors import StoreError, require_utf8
from ravenjax.store import files, manifest, parts
from ravenjax.store.access import lock
from ravenjax.store.folder import ResultFolder, Results

PART_TICKS, MIN_PART_ROWS = 2**27, 256
"""Number of ticks in a file of the result, and the smallest number of its rows. A core computes
these ticks in ten seconds, so runs of long operations are also stored early.
"""


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
    """Run a campaign, or continue it if the folder `out` contains some of its runs. out: result
    folder; None: a temporary folder that is deleted with the results. The campaign may have another
    `campaign.limit` than before. rows: compute only these rows, in addition to stored rows. shard:
    compute only this share. command: the command line, for the manifest. Raise UserError and
    StoreError for errors that the user can correct. Finished files are always kept.
    """
    if out is None:
        return in_temporary_folder(
            lambda folder: run_campaign(
                config, folder, engine, on_progress=on_progress, executor=executor, shard=shard
            )
        )
    require_utf8(str(out.absolute()))
    plan = make_plan(config)
    interruption.check_interruption()
    ticks = plan.runs * plan.program.ticks
    backend = compile_cache.cached_engine(engine, plan.program.setup.precision, ticks)
    executor = executor or Local()
    chunk = config.campaign.chunk or min(
        parts.rows_of_a_part(plan.runs, executor.workers),
        max(MIN_PART_ROWS, PART_TICKS // plan.program.ticks),
    )
    limit = min(config.campaign.limit or plan.runs, plan.runs)
    if shard is not None:
        chunk = config.campaign.chunk or shard.chunk(limit, chunk)
        rows = shard.rows(limit, chunk)
    elif rows is None and limit < plan.runs:
        rows = [range(limit)]
    plan_notices = notices.of_plan(plan)
    record = make_manifest(plan, backend).model_copy(
        update={
            "rows": manifest.join_ranges(
                None if rows is None else tuple((span.start, span.stop - 1) for span in rows)
            ),
            "shard": None if shard is None else str(shard),
            "command": tuple(command),
            "notices": plan_notices,
        }
    )
    files.require_writable(out)
    with lock.hold_lock(out):
        folder = ResultFolder.open(out, record)
        missing = list(folder.missing(chunk))
        progress = Progress(
            f"{backend.name} on {backend.device}",
            folder.manifest.due,
            sum(map(len, missing)),
            plan.program.ticks,
            ProgressFile(out, on_progress),
            (*folder.notes, *plan_notices),
        )
        progress.count_failures(folder.manifest.failures)

        def store_chunk(finished: FinishedChunk):
            folder.put(finished.packed)
            progress.count_part(len(finished.rows), finished.failures)

        config_hash = folder.manifest.config_hash
        pack = functools.partial(parts.encode_part, shape=record.shape, config_hash=config_hash)
        phase = "stopped"
        try:
            if missing:
                executor.run(Work(plan, backend, pack, store_chunk, progress), missing)
            phase = "done"
        finally:
            # If the run stopped because a file could not be written, the manifest probably cannot
            # be written either. The user then sees the first error.
            ignored = (StoreError,) if phase == "stopped" else ()
            with contextlib.suppress(*ignored):
                status = progress.status
                folder.close(status.compile_s, status.run_s, status.computed, status.notes)
            progress.tell(phase)
    return Results(record.shape, out)


def in_temporary_folder(compute: Callable[[Path], Results]) -> Results:
    """Call `compute` with a temporary folder, which is deleted together with the results."""
    folder = tempfile.mkdtemp(prefix="ravenjax-")
    try:
        results = compute(Path(folder))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(results, shutil.rmtree, folder, ignore_errors=True)
    return results


def make_manifest(plan: Plan, engine: Engine) -> manifest.Manifest:
    """Return the manifest of a plan before its computation."""
    config, setup = plan.config, plan.program.setup
    # Outcomes do not depend on these keys, so they are not part of the campaign's hash.
    excluded = {"chunk", "limit"}
    if config.campaign.observe_ms is None:
        excluded.add("observe_ms")
    content = config.model_dump(mode="json", exclude={"campaign": excluded})
    ids = run_id.hash_run_ids(plan.rows["run_id"].to_numpy())
    return manifest.Manifest(
        campaign=config.campaign.name,
        config=content,
        config_hash=manifest.campaign_hash(content, plan.operator, ids),
        seed=config.campaign.seed,
        runs=plan.runs,
        duration_ms=config.campaign.duration_ms,
        shape=plan.shape,
        cues=tuple(
            manifest.CueRecord(
                threshold_mm=cue.threshold_m * 1e3,
                kp_per_mm=cue.kp / 1e3,
                kd_s_per_mm=cue.kd / 1e3,
                cap=cue.cap,
            )
            for cue in config.haptics.cues()
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
        settings=compile_cache.engine_settings(engine.name),
        device=f"{engine.device} ({'+'.join(setup.arms)})",
    )
