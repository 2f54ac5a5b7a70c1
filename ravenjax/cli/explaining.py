"""The commands `ravenjax trace` and `ravenjax explain`, which compute runs again.

`trace` writes the time series of runs. `explain` shows how a fault becomes a failure.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Ranking, ResultFolder, RunIds, SameEngine

if TYPE_CHECKING:
    from ravenjax.campaign.inspection.explain import Explained
    from ravenjax.campaign.inspection.replay import Replay
    from ravenjax.store.manifest import Manifest


def trace(
    folder: ResultFolder,
    *run_ids: RunIds,
    worst: int | None = None,
    by: Ranking = "unintended",
    out: Path | None = None,
    engine: SameEngine = "auto",
    as_json: AsJson = False,
) -> None:
    """Compute single runs of a result again, and write an MCAP file, a CSV table and a plot of the
    time series of each run.

    Args:
        worst: trace the N worst runs instead of runs that you name
        out: folder of the traces; default FOLDER/traces
    """
    from ravenjax.campaign.inspection.replay import Replayer
    from ravenjax.errors import UserError
    from ravenjax.report.run.summary import summarize_run
    from ravenjax.store import files, manifest

    if bool(run_ids) == (worst is not None):
        raise UserError(
            "expected the runs to trace: run ids or indices, such as `ravenjax trace DIR 17`, or"
            " --worst N"
        )
    record = manifest.read_manifest(folder)
    ranked = console.worst_runs(folder, worst, by)
    out_folder = out or files.path_inside(folder, "traces")
    files.require_writable(out_folder)
    if record.code_hash != manifest.code_hash(record.robot):
        console.print_note(f"{folder} was computed by other code, so outcomes may differ")
    runs = run_ids or tuple(run.run_id for run in ranked)
    records = []
    replayer = Replayer.of_folder(folder, engine)
    for run in runs:
        replay = replayer.replay(run)
        row = replay.row.to_dict()
        summary = summarize_run(row, record.rules, replay.series, replay.golden, record.robot)
        events = [event._asdict() for event in summary.events]
        paths = _write_trace(out_folder, record, replay, events)
        records.append({"run_id": row["run_id"], **summary._asdict(), "files": paths})
        if not as_json:
            console.print_text("\n".join(summary.lines()))
            console.print_written(paths)
            console.print_text("")
    if as_json:
        console.emit_json(records)


def _write_trace(folder: Path, record: Manifest, replay: Replay, events: list[dict]) -> list[Path]:
    # Writes the trace of a recomputed run as MCAP file, CSV table and figure. Returns the paths.
    from ravenjax.report import wording
    from ravenjax.report.run.plot import trace_plot
    from ravenjax.store import manifest
    from ravenjax.store.logs import time_series, trace_log

    row, rules = replay.row.to_dict(), record.rules
    fault_text = wording.describe_fault(row, record.robot)
    metadata = {
        name: value
        for name, value in row.items()
        if isinstance(value, str)
        or name in ("index", "seed")
        # NaN, which does not equal itself, marks a number that this run does not have.
        or (name.startswith(("fault", "param:")) and value == value)
    } | {
        "fault": fault_text,
        "campaign": record.campaign,
        "config_hash": record.config_hash,
        "duration_ms": record.duration_ms,
        "limit_mm": record.rules.limit_mm,
        "cue_threshold_mm": record.rules.threshold_mm,
        "engine": replay.engine,
        "version": manifest.package_versions()["ravenjax"],
        "code_hash": manifest.code_hash(record.robot),
        "campaign_engine": f"{record.engine} on {record.device}",
        "campaign_version": record.versions.get("ravenjax", ""),
        "campaign_code_hash": record.code_hash,
    }
    header = {name: str(value) for name, value in metadata.items()}
    paths = [folder / f"{row['run_id']}.{ending}" for ending in ("mcap", "csv", "svg")]
    log_path, csv_path, plot_path = paths
    trace_log.write_trace(
        log_path, replay.series, header, bases=replay.bases, events=events, robot=record.robot
    )
    time_series.write_csv(csv_path, replay.series, record.robot)
    event_columns = {
        "fault": "first_active_ms",
        "cue": f"cue{rules.cue}_first_ms",
        str(row["response"]): "response_ms",
        "unintended motion": "unintended_first_ms",
        "loss of motion": "loss_first_ms",
    }
    trace_plot(
        replay.series,
        plot_path,
        title=f"run {row['run_id']} · {row['verdict'] or row['failed']}\n"
        f"{row['group']}: {fault_text}",
        threshold_mm=rules.threshold_mm,
        cue=rules.cue,
        robot=record.robot,
        events={name: float(row[column]) for name, column in event_columns.items()},
    )
    return paths


def explain(
    folder: ResultFolder,
    *run_ids: RunIds,
    worst: int | None = None,
    by: Ranking = "unintended",
    group: str | None = None,
    out: Path | None = None,
    engine: SameEngine = "auto",
    as_json: AsJson = False,
) -> None:
    """Explain how a fault became a failure: which signal differed first, and where a check could
    have detected the fault.

    Without run ids, --worst and --group, all runs with a fault are explained and summarised, if
    any fault evades the checks.

    Args:
        worst: explain the N worst runs instead of runs that you name
        group: summarise all runs with a fault of this group
        out: folder for the written files; default FOLDER/explained
    """
    from ravenjax.campaign.inspection.explain import Explainer
    from ravenjax.cli import terminal
    from ravenjax.errors import UserError
    from ravenjax.report.run import ranking
    from ravenjax.store import files, manifest
    from ravenjax.store.access import explained

    if sum((bool(run_ids), worst is not None, group is not None)) > 1:
        raise UserError("expected one of: run ids or indices, --worst N, or --group NAME")
    record = manifest.read_manifest(folder)
    ranked = console.worst_runs(folder, worst, by)
    if worst is not None and not ranked:
        return console.emit_json([]) if as_json else None
    # Without chosen runs, all runs with a fault are summarised together.
    summary_rows = None if run_ids or ranked else ranking.faulty_rows(folder, group)
    if summary_rows == []:
        sentence = "No fault evades the checks, so there is nothing to explain."
        return console.print_findings([sentence], as_json, evading=0)
    out_folder = out or files.path_inside(folder, explained.FOLDER)
    files.require_writable(out_folder)
    explainer = Explainer.of_folder(folder, engine)
    rows: Any = (
        list(dict.fromkeys(explainer.index(run) for run in run_ids))
        or [run.row for run in ranked]
        or summary_rows
    )
    # Fewer runs take so little time that progress is not of interest.
    hides_progress = as_json or len(rows) < 100
    with contextlib.nullcontext() if hides_progress else terminal.Watch(console.err) as watch:
        explanation = explainer.explain(rows, watch)
    explained.add_explained(out_folder, explanation.ticks, record)
    if changed := ranking.count_changed(folder, explanation.results):
        code = "this" if record.code_hash == manifest.code_hash(record.robot) else "another"
        console.print_note(
            f"{folder}: {changed} of {len(explanation.ticks)} runs now have another outcome than in"
            f" the folder, which engine {record.engine} of {code} version of the code computed"
        )
    if summary_rows is None:
        _explain_each_run(out_folder, record, explanation, as_json)
    else:
        _summarize_runs(folder, out_folder, record, as_json)
    return None


def _explain_each_run(out_folder: Path, record: Manifest, explanation: Explained, as_json: bool):
    # Prints how the error propagated in each run, and writes a table and a figure per run.
    from ravenjax.report import downloads, wording
    from ravenjax.report.drawing import save_figure
    from ravenjax.report.run import chain, chain_words
    from ravenjax.store.files import write_text

    records = []
    for row, ticks in zip(
        explanation.results.to_dict("records"), explanation.ticks.to_dict("records"), strict=True
    ):
        explained = chain.trace_chain(row, ticks, record.robot, record.shape.arms, record.rules.cue)  # type: ignore[arg-type]
        paths = [out_folder / f"{explained.run_id}.csv"]
        # If no signal differs from the golden run, the table has only its headings.
        write_text(paths[0], downloads.format_csv(explained.links) or "layer,signal\n")
        if (figure := chain_words.timeline_figure(explained)) is not None:
            paths.append(out_folder / f"{explained.run_id}.svg")
            save_figure(figure, paths[1])
        records.append(explained._asdict() | {"visible": explained.first, "files": paths})
        if as_json:
            continue
        templates = ("links.txt.j2", "near_checks.txt.j2")
        tables = [("", wording.fill_table(template, chain=explained)) for template in templates]
        lines = [chain_words.chain_title(explained), *chain_words.chain_sentences(explained)]
        console.print_findings(["\n  ".join(lines)], as_json, tables, paths)
        console.print_text("")
    if as_json:
        console.emit_json(records)


def _summarize_runs(folder: Path, out_folder: Path, record: Manifest, as_json: bool):
    # Prints in how many runs each signal transmitted the error, and writes a table and a chart.
    from ravenjax.report import downloads, wording
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import chains
    from ravenjax.store.access import explained
    from ravenjax.store.files import write_text

    ticks = explained.read_explained(out_folder, record)
    assert ticks is not None
    with contextlib.closing(Runs.open(folder, record)) as runs:
        summary = chains.summarize_chains(runs, ticks)
    paths = [out_folder / explained.FILE]
    if text := downloads.format_csv(summary.carriers):
        paths.append(out_folder / "signals.csv")
        write_text(paths[-1], text)
    if chains.draw_charts(summary, out_folder / "signals.svg"):
        paths.append(out_folder / "signals.svg")
    tables = [("", wording.fill_table("carriers.txt.j2", all=summary))]
    sentences = chains.chain_sentences(summary)
    console.print_findings(sentences, as_json, tables, paths, **summary._asdict())
