"""Commands that check and run campaigns: `ravenjax run`, `check`, `fault-free`, `search`."""

import contextlib
import gc
import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax import interruption
from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Count, Engine, Overrides, ResultFolder
from ravenjax.cli.motion import show_operator
from ravenjax.cli.results import write_report

if TYPE_CHECKING:
    from ravenjax.store.manifest import Manifest

MAX_GROUPS = 40
"""Number of groups that `check` prints; further groups are only counted."""
SIGNAL_MESSAGE = "ended by a signal; finished results are kept, and the same command continues"


def run(
    file: Path,
    *,
    out: Path | None = None,
    engine: Engine = "auto",
    overrides: Overrides = None,
    chunk: Count = None,
    limit: Count = None,
    executor: str | None = None,
    workers: int | None = None,
    ray_address: str | None = None,
    shard: str | None = None,
    report: bool = True,
    as_json: AsJson = False,
) -> None:
    """Run a campaign, or continue it in an existing result folder.

    Exit codes: 0 is success. 2 means that you can correct the problem: the campaign file, a
    full disk, workers that die. Signals end the command with 130 (Ctrl-C), 143 (SIGTERM) or 129
    (SIGHUP). Finished runs are always kept, and the same command continues.

    Args:
        file: Campaign file, or the name of a bundled campaign (see `ravenjax campaigns`).
        out: result folder; default results/NAME of the campaign
        chunk: number of runs in each file of the result
        limit: compute only the first runs
        executor: local (this process) or ray (a cluster)
        workers: number of parallel Ray tasks; default one for each GPU, or one for some cores
        ray_address: address of a running Ray cluster; default a new cluster on this machine
        shard: i/N: compute only the i-th of N shards, for batch schedulers
        report: write report.html at the end
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.executors import choose_executor, shards
    from ravenjax.cli import terminal

    changes = list(overrides or ())
    for key, value in (("chunk", chunk), ("limit", limit)):
        if value is not None:
            changes.append(f"campaign.{key}={value}")
    share = shards.parse_shard(shard) if shard is not None else None
    chosen_executor = choose_executor(executor, workers, ray_address)
    config = loading.load_campaign(file, changes)
    folder = out or Path("results") / config.campaign.name / (share.folder if share else "")

    from ravenjax.campaign.stop import adaptive, decisions
    from ravenjax.store import manifest

    screen = console.err if as_json else console.out
    show_operator(config, screen)
    # The last garbage collection, at the exit, then skips all imported modules. This saves 0.2 s.
    gc.freeze()
    with _exit_on_signals(), terminal.Watch(screen) as watch:
        adaptive.run_adaptively(
            config,
            folder,
            engine,
            on_progress=watch,
            executor=chosen_executor,
            shard=share,
            command=sys.argv,
        )
    record = manifest.read_manifest(folder)
    counts, faults_by_verdict = _count_faults(folder, record)
    if not as_json:
        _print_summary(folder, record, counts, faults_by_verdict)
    page = write_report(folder, prints=not as_json) if report and share is None else None
    if as_json:
        names = "campaign config_hash runs engine device code_hash compile_s run_s runs_per_s"
        content = {name: getattr(record, name) for name in names.split()} | {
            "folder": folder,
            "finished": record.done,
            "verdicts_of_distinct_faults": faults_by_verdict,
            "runs_without_valid_outcome": record.failures,
            "runs_not_counted": {key: counts.get(key, 0) for key in NOT_COUNTED},
            "stop_rule": decisions.describe_stop(folder) or None,
            "report": page,
            "shard": None if share is None else str(share),
        }
        console.emit_json(content)
    elif share is not None:
        console.print_text(f"shard {share}; `ravenjax merge OUT SHARD...` joins all shards")


def check(
    file: str,
    *,
    overrides: Overrides = None,
    out: Path | None = None,
    engine: Engine = "auto",
    limit: Count = None,
    as_json: AsJson = False,
) -> None:
    """Show what a campaign file would run: runs, groups, faults, operator, cues, time and memory.

    The command simulates nothing. The exit code is 2 if `ravenjax run` would refuse the file.

    Args:
        file: Campaign file, or the name of a bundled campaign (see `ravenjax campaigns`).
        out: planned result folder; default results/NAME
        limit: only the first runs, as for `ravenjax run`
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.inspection.estimate import format_estimate
    from ravenjax.campaign.inspection.preview import preview_campaign
    from ravenjax.report import wording

    changes = list(overrides or ())
    if limit is not None:
        changes.append(f"campaign.limit={limit}")
    config = loading.load_campaign(file, changes, runs=False)
    folder = out or Path("results") / config.campaign.name
    preview, sample = preview_campaign(config, folder, engine)
    preview["sample"] = [
        {
            "index": int(row["index"]),
            "run_id": row["run_id"],
            "group": str(row["group"]),
            "fault": wording.describe_fault(row, config.robot),
        }
        for row in sample.to_dict("records")
    ]
    if as_json:
        console.emit_json(preview)
        return
    content = preview | {"config": config, "duration": format_estimate, "max_groups": MAX_GROUPS}
    console.print_tables(console.fill_listings("check.j2", **content), as_json)
    for notice in preview["notices"]:
        console.print_text(f"note: {notice}")


def fault_free(
    folder: ResultFolder,
    hours: float,
    *,
    engine: str = "auto",
    report: bool = True,
    as_json: AsJson = False,
) -> None:
    """Simulate fault-free motion of a campaign's robot, to measure false alarms per hour.

    Robot, cues and detectors are those of the campaign. The operator's motion has other seeds.
    Each motion is a result folder in FOLDER/fault_free, and the report of FOLDER includes it.
    Hours that were computed before count, and an interrupted command continues. Exit codes are
    those of `ravenjax run`.

    Args:
        hours: Total hours of fault-free motion in pedal-down, including existing hours. The report
            states how many hours it needs.
        engine: as in `ravenjax run`; auto is the engine that computed the campaign, but never one
            that needs a GPU: motions run one at a time, which is faster on a CPU
        report: write report.html of FOLDER again at the end
    """
    from ravenjax.campaign.inspection.fault_free import extend_fault_free
    from ravenjax.cli import terminal
    from ravenjax.report import wording
    from ravenjax.store.access.fault_free import FOLDER

    motions_folder, screen = folder / FOLDER, console.err if as_json else console.out

    def announce_motion(hours_computed: float, path: Path):
        # Prints the hours that are computed when the next motion begins.
        share = f"{wording.format_hours(hours_computed)} of {wording.format_hours(hours)} computed"
        console.print_text(f"{share}; next folder: {path}", screen)

    with _exit_on_signals(), terminal.Watch(screen) as watch:
        total_hours = extend_fault_free(
            folder, hours, engine, on_motion=announce_motion, on_progress=watch, command=sys.argv
        )
    if not as_json:
        total = wording.format_hours(total_hours)
        console.print_text(f"fault-free motion: {total} in {motions_folder}")
    page = write_report(folder, prints=not as_json) if report else None
    if as_json:
        console.emit_json({"folder": motions_folder, "hours": total_hours, "report": page})


NOT_COUNTED = {
    "inactive": "whose fault never changed a bit",
    "repeats": "that repeat a fault",
    "reacting": "with an operator who reacts",
}
"""Count on the report's first page -> the runs that it counts. No verdict counts these runs."""


def _count_faults(folder: Path, record: "Manifest") -> tuple[dict[str, Any], dict[str, int]]:
    # Returns the counts of the report's first page, by name, and the number of distinct faults of
    # each verdict. Both are empty if no run is finished.
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import tables

    if not record.done:
        return {}, {}
    with contextlib.closing(Runs.open(folder, record)) as runs:
        verdict_rows = tables.class_counts(runs, "verdict::VARCHAR", ())
        faults_by_verdict = {verdict: count for verdict, _, count in verdict_rows}
        return tables.headline_counts(runs, record), faults_by_verdict


def _print_summary(
    folder: Path, record: "Manifest", counts: dict[str, Any], faults_by_verdict: dict[str, int]
):
    # Prints tables of verdicts and failed runs, how many faults evade the checks, and which runs
    # are not counted. The campaign may be interrupted. For counts see `_count_faults`.
    from ravenjax.campaign.stop import decisions
    from ravenjax.cli import terminal
    from ravenjax.outcomes import events

    verdicts = terminal.share_rows(faults_by_verdict, sum(faults_by_verdict.values()))
    content = {
        "record": record,
        "verdicts": [(events.name_harm(name, record.rules), *row) for name, *row in verdicts],
        "failures": terminal.share_rows(record.failures, record.done),
        "counts": counts,
        "not_counted": NOT_COUNTED,
        "stop_reason": decisions.describe_stop(folder),
    }
    console.print_tables(console.fill_listings("summary.j2", **content), as_json=False)
    if verdicts:
        console.print_text(console.render_template("evading.j2", **content))
    console.print_text(console.render_template("ended.j2", folder=folder, **content))


@contextlib.contextmanager
def _exit_on_signals() -> Iterator[None]:
    """Exit on SIGTERM and SIGHUP as on Ctrl-C, with exit code 128 + the number of the signal."""
    with interruption.exit_on_signals(signal.SIGTERM, signal.SIGHUP):
        try:
            with interruption.limit_shutdown_time(SIGNAL_MESSAGE), interruption.delay_signals():
                yield
        except SystemExit:
            console.print_text(SIGNAL_MESSAGE, console.err)
            raise


def search(
    file: Path,
    *,
    out: Path | None = None,
    engine: Engine = "auto",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Search for the smallest harmful fault, the inputs that matter most, or the probability of a
    rare event.

    Finished runs are always kept, and the same command continues. Exit codes are those of
    `ravenjax run`.

    Args:
        file: Search file, or the name of a bundled search (see `ravenjax campaigns`).
        out: folder to write; default results/NAME of the search
    """
    from ravenjax.analyses.search import runner
    from ravenjax.analyses.search.file import loading
    from ravenjax.cli import terminal

    screen = console.err if as_json else console.out
    show_operator(loading.load_search(file, overrides or ()).campaign, screen)
    with _exit_on_signals(), terminal.Watch(screen) as watch:
        result = runner.run_search(file, out, engine, overrides or (), watch)
    if as_json:
        numbers = json.loads((result.out / runner.NUMBERS).read_text(encoding="utf-8"))
        console.emit_json({"folder": result.out} | numbers)
        return
    for sentence in result.sentences:
        console.print_text(f"- {sentence}")
    console.print_text(f"search: {result.out}")
    console.print_text(f"page: {result.out / runner.PAGE}")
