"""Commands that check and run campaigns: `ravenjax run`, `check`, `fault-free`, `search`."""

from __future__ import annotations

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

MOST_ROWS = 40
"""Number of groups that `check` prints; further groups are only counted."""
ENDED = "ended by a signal; finished results are kept, and the same command continues"


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
        shard: i/N: compute only the i-th of N shares, for batch schedulers
        report: write report.html at the end
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.executors import choose_executor, shards
    from ravenjax.cli import terminal

    sizes = {"chunk": chunk, "limit": limit}
    changes = [
        *(overrides or ()),
        *(f"campaign.{key}={value}" for key, value in sizes.items() if value is not None),
    ]
    share = shards.parse_shard(shard) if shard is not None else None
    who = choose_executor(executor, workers, ray_address)
    config = loading.load_campaign(file, changes)
    folder = out or Path("results") / config.campaign.name / (share.folder if share else "")

    from ravenjax.campaign.stop import adaptive, decisions
    from ravenjax.store import manifest

    screen = console.err if as_json else console.out
    show_operator(config, screen)
    # The exit then does not look through all imported modules, which takes 0.2 s.
    gc.freeze()
    with _ended_by_signals(), terminal.Watch(screen) as watch:
        adaptive.run_adaptively(
            config, folder, engine, on_progress=watch, executor=who, shard=share, command=sys.argv
        )
    record = manifest.read_manifest(folder)
    head, counted = _count_faults(folder, record)
    if not as_json:
        _summary(folder, record, head, counted)
    page = write_report(folder, prints=not as_json) if report and share is None else None
    if as_json:
        names = "campaign config_hash runs engine device code_hash compile_s run_s runs_per_s"
        content = {name: getattr(record, name) for name in names.split()} | {
            "folder": folder,
            "finished": record.done,
            "verdicts_of_distinct_faults": counted,
            "runs_without_valid_outcome": record.failures,
            "runs_not_counted": {key: head.get(key, 0) for key in NOT_COUNTED},
            "stop_rule": decisions.describe_stop(folder) or None,
            "report": page,
            "shard": None if share is None else str(share),
        }
        console.emit_json(content)
    elif share is not None:
        console.print_text(f"one of {share.of} shards; `ravenjax merge OUT SHARD...` joins all")


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

    sizes = [] if limit is None else [f"campaign.limit={limit}"]
    config = loading.load_campaign(file, [*(overrides or ()), *sizes], runs=False)
    view, sample = preview_campaign(config, out or Path("results") / config.campaign.name, engine)
    view["sample"] = [
        {
            "index": int(row["index"]),
            "run_id": row["run_id"],
            "group": str(row["group"]),
            "fault": wording.describe_fault(row, config.robot),
        }
        for row in sample.to_dict("records")
    ]
    if as_json:
        console.emit_json(view)
        return
    content = view | {"config": config, "duration": format_estimate, "most": MOST_ROWS}
    console.print_tables(console.fill_listings("check.j2", **content), as_json)
    for notice in view["notices"]:
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
        engine: auto, cuda, simd, xla or mjx; auto is a CPU engine, because motions run one at a
            time
        report: write report.html of FOLDER again at the end
    """
    from ravenjax.campaign.inspection import fault_free as more_motion
    from ravenjax.cli import terminal
    from ravenjax.report import wording
    from ravenjax.store.access.fault_free import FOLDER

    motions_folder, screen = folder / FOLDER, console.err if as_json else console.out

    def began(there: float, path: Path):
        so_far = f"{wording.format_hours(there)} of {wording.format_hours(hours)} computed"
        console.print_text(f"{so_far}; next folder: {path}", screen)

    with _ended_by_signals(), terminal.Watch(screen) as watch:
        there = more_motion.extend_fault_free(
            folder, hours, engine, on_motion=began, on_progress=watch, command=sys.argv
        )
    if not as_json:
        console.print_text(f"fault-free motion: {wording.format_hours(there)} in {motions_folder}")
    page = write_report(folder, prints=not as_json) if report else None
    if as_json:
        console.emit_json({"folder": motions_folder, "hours": there, "report": page})


NOT_COUNTED = {
    "inactive": "whose fault never changed a bit",
    "repeats": "that repeat a fault",
    "reacting": "with an operator who reacts",
}


def _count_faults(folder: Path, record: Manifest) -> tuple[dict[str, Any], dict[str, int]]:
    # Returns the counts of the report's first page, and the number of distinct faults by verdict.
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import tables

    if not record.done:
        return {}, {}
    with contextlib.closing(Runs.open(folder, record)) as runs:
        counted = {name: n for name, _, n in tables.class_counts(runs, "verdict::VARCHAR", ())}
        return tables.headline_counts(runs, record), counted


def _summary(folder: Path, record: Manifest, head: dict[str, Any], counted: dict[str, int]):
    # Prints the verdicts of a finished or interrupted campaign.
    from ravenjax.campaign.stop import decisions
    from ravenjax.cli import terminal
    from ravenjax.outcomes import events

    verdicts = terminal.share_rows(counted, sum(counted.values()))
    content = {
        "record": record,
        "verdicts": [(events.name_harm(name, record.rules), *row) for name, *row in verdicts],
        "failures": terminal.share_rows(record.failures, record.done),
        "head": head,
        "not_counted": NOT_COUNTED,
        "why": decisions.describe_stop(folder),
    }
    console.print_tables(console.fill_listings("summary.j2", **content), as_json=False)
    if verdicts:
        console.print_text(console.render_template("evading.j2", **content))
    console.print_text(console.render_template("ended.j2", folder=folder, **content))


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Exit on SIGTERM and SIGHUP as on Ctrl-C, with exit code 128 + the number of the signal."""
    with interruption.exit_on_signals(signal.SIGTERM, signal.SIGHUP):
        try:
            with interruption.ended_in_time(ENDED), interruption.held_back():
                yield
        except SystemExit:
            console.print_text(ENDED, console.err)
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
    with _ended_by_signals(), terminal.Watch(screen) as watch:
        result = runner.run_search(file, out, engine, overrides or (), watch)
    if as_json:
        numbers = json.loads((result.out / runner.NUMBERS).read_text(encoding="utf-8"))
        console.emit_json({"folder": result.out} | numbers)
        return
    for sentence in result.sentences:
        console.print_text(f"- {sentence}")
    console.print_text(f"search: {result.out}")
    console.print_text(f"page: {result.out / runner.PAGE}")
