"""Commands on a result folder: `report`, `trace`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ravenjax.cli import console


def report(
    folder: Path,
    *,
    figures: Annotated[Path | None, Parameter(help="also draw the main figures into this folder, SVG and PDF")] = None,
) -> None:
    """Write report.html into a result folder.

    Parameters
    ----------
    folder
        What `ravenjax run` wrote.
    """
    write_report(folder)
    if figures is not None:
        from ravenjax.report import paper

        for path in paper.write(folder, figures):
            console.out.print(f"wrote {path}", highlight=False, soft_wrap=True)


def trace(
    folder: Path,
    run_id: str,
    *,
    out: Annotated[Path | None, Parameter(help="folder of the trace; default FOLDER/traces")] = None,
    engine: Annotated[str, Parameter(help="auto is the engine that the campaign ran on")] = "auto",
) -> None:
    """Run one row of a result again and write its whole time series: MCAP and a plot.

    Parameters
    ----------
    folder
        What `ravenjax run` wrote.
    run_id
        The row's run_id, or enough of its beginning to tell it from others, or its index.
    """
    from ravenjax.campaign import replay
    from ravenjax.report import wording
    from ravenjax.report.trace_plot import trace_plot
    from ravenjax.store import files, manifest, trace_log

    record = manifest.read(folder)
    place = out or folder / "traces"
    files.require_writable(place)
    if record.code_hash != manifest.code_hash():
        console.err.print(f"note: {folder} was computed by another version of the code; the run may come out otherwise")
    again = replay.from_folder(folder, run_id, engine)
    row, series = again.row, again.series
    log, plot = place / f"{row['run_id']}.mcap", place / f"{row['run_id']}.svg"
    columns = ("run_id", "index", "group", "seed", "verdict", "response_cause")
    trace_log.write(log, series, {name: str(row[name]) for name in columns})
    cue, cues = record.verdict_cue, record.cues
    named = {"fault": "first_active_ms", "cue": f"cue{cue}_first_ms", str(row["response"]): "response_ms"}
    trace_plot(
        _plotted(series, cue),
        plot,
        title=f"run {row['run_id']} · {row['verdict'] or row['failed']}",
        subtitle=f"{row['group']}: {wording.fault(row.to_dict())}",
        threshold_mm=cues[cue].threshold_mm if cues else 3.0,
        events={name: float(row.at[column]) for name, column in named.items()},
    )
    for path in (log, plot):
        console.out.print(f"wrote {path}", highlight=False, soft_wrap=True)


def _plotted(series: dict[str, Any], cue: int) -> dict[str, Any]:
    """A replay's series under the names that the plot knows, with the force of that cue."""
    active = [values for name, values in series.items() if name.startswith("fault") and name.endswith("_active")]
    commands = {name.replace("dac_cnt", "current_cmd"): values for name, values in series.items() if "dac_cnt" in name}
    forces = {n.replace("cue_force", "haptic_force"): v[:, cue] for n, v in series.items() if n.endswith("/cue_force")}
    return {
        **series,
        **commands,
        **forces,
        "pedal": series["surgeon_mode"],
        **({"fault_active": sum(active) > 0} if active else {}),
    }


def write_report(folder: Path) -> None:
    from ravenjax.report import page

    console.out.print(f"report: {page.build(folder)}", highlight=False, soft_wrap=True)
