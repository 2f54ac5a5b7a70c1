"""The command `trace`: computes single runs again and writes their time series and a summary."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Ranking, ResultFolder, RunIds, SameEngine

if TYPE_CHECKING:
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
    """Run single runs of a result again and write their time series: MCAP, CSV and a plot.

    Parameters
    ----------
    worst
        trace the N worst runs instead of named ones
    out
        folder of the traces; default FOLDER/traces
    """
    from ravenjax.campaign.inspection.replay import Replayer
    from ravenjax.errors import UserError
    from ravenjax.report.run import summary as run_summary
    from ravenjax.store import files, manifest

    if bool(run_ids) == (worst is not None):
        raise UserError(
            "which runs? Give run ids or indices, as `ravenjax trace DIR 17`, or --worst N"
        )
    record = manifest.read_manifest(folder)
    ranked = console.worst_runs(folder, worst, by)
    place = out or folder / "traces"
    files.require_writable(place)
    if record.code_hash != manifest.code_hash(record.robot):
        console.print_note(
            f"{folder} was computed by another version of the code; a run may come out otherwise"
        )
    runs = run_ids or tuple(run.run_id for run in ranked)
    records = []
    replayer = Replayer.of_folder(folder, engine) if runs else None
    for run in runs:
        assert replayer is not None
        again = replayer.replay(run)
        row = again.row.to_dict()
        summary = run_summary.summarize_run(
            row, record.rules, again.series, again.golden, record.robot
        )
        paths = _write(place, record, again, [event._asdict() for event in summary.events])
        records.append(
            {"run_id": row["run_id"], **summary._asdict(), "files": [str(path) for path in paths]}
        )
        if not as_json:
            console.print_text(
                "\n".join([*summary.lines(), *(f"  wrote    {path}" for path in paths), ""])
            )
    if as_json:
        console.emit_json(records)


def _write(
    place: Path, record: Manifest, again: Replay, events: list[dict[str, Any]]
) -> list[Path]:
    from ravenjax.report import wording
    from ravenjax.report.run.plot import trace_plot
    from ravenjax.store.logs import time_series
    from ravenjax.store.logs.trace import log as trace_log

    row, series, rules = again.row.to_dict(), again.series, record.rules
    log, table, plot = (place / f"{row['run_id']}.{kind}" for kind in ("mcap", "csv", "svg"))
    trace_log.write_trace(
        log, series, _metadata(record, again), bases=again.bases, events=events, robot=record.robot
    )
    time_series.write_csv(table, series, record.robot)
    named = {
        "fault": "first_active_ms",
        "cue": f"cue{rules.cue}_first_ms",
        str(row["response"]): "response_ms",
    }
    named |= {"unintended motion": "unintended_first_ms", "loss of motion": "loss_first_ms"}
    trace_plot(
        _plotted(series, rules.cue),
        plot,
        title=f"run {row['run_id']} · {row['verdict'] or row['failed']}",
        subtitle=f"{row['group']}: {wording.describe_fault(row, record.robot)}",
        threshold_mm=rules.threshold_mm,
        robot=record.robot,
        events={name: float(row[column]) for name, column in named.items()},
    )
    return [log, table, plot]


def _metadata(record: Manifest, again: Replay) -> dict[str, str]:
    from ravenjax.report import wording
    from ravenjax.store import manifest

    row = again.row.to_dict()
    values = {
        name: value
        for name, value in row.items()
        if isinstance(value, str)
        or name in ("index", "seed")
        or (name.startswith(("fault", "param:")) and value == value)
    } | {
        "fault": wording.describe_fault(row, record.robot),
        "campaign": record.campaign,
        "config_hash": record.config_hash,
        "duration_ms": record.duration_ms,
        "limit_mm": record.rules.limit_mm,
        "cue_threshold_mm": record.rules.threshold_mm,
        "engine": again.engine,
        "version": manifest.package_versions()["ravenjax"],
        "code_hash": manifest.code_hash(record.robot),
        "campaign_engine": f"{record.engine} on {record.device}",
        "campaign_version": record.versions.get("ravenjax", ""),
        "campaign_code_hash": record.code_hash,
    }
    return {name: str(value) for name, value in values.items()}


def _plotted(series: Mapping[str, Any], cue: int) -> dict[str, Any]:
    active = [
        values
        for name, values in series.items()
        if name.startswith("fault") and name.endswith("_active")
    ]
    commands = {
        n.replace("boards_cnt", "current_cmd"): v
        for n, v in series.items()
        if n.endswith("/boards_cnt")
    }
    forces = {
        n.replace("cue_force", "haptic_force"): v[:, cue]
        for n, v in series.items()
        if n.endswith("/cue_force")
    }
    return {
        **series,
        **commands,
        **forces,
        **({"pedal": series["surgeon_mode"]} if "surgeon_mode" in series else {}),
        **({"fault_active": sum(active) > 0} if active else {}),
    }
