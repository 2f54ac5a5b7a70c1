"""Commands on result folders: `report`, `trace`, `verify`, `merge`."""

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


def verify(
    folder: Path,
    *,
    sample: Annotated[int, Parameter(help="runs that are made again, 0 for none")] = 64,
    engine: Annotated[str, Parameter(help="auto is the engine that the campaign ran on")] = "auto",
    seed: Annotated[int, Parameter(help="of the sample")] = 0,
) -> int:
    """Check a result folder: checksums, rows, values, and a random sample of its runs made again.

    Ends with code 1 where something is wrong. Runs made again on another engine may differ: it is told by how much.

    Parameters
    ----------
    folder
        What `ravenjax run` wrote.
    """
    from ravenjax import terminal
    from ravenjax.campaign import verification

    found = verification.verify(folder, sample, engine, seed)
    rows = [(check.name, "ok" if check.fine else "WRONG", check.looked_at) for check in found.checks]
    console.out.print(terminal.table(f"Verified: {folder}", ("what", "", "looked at"), rows))
    for check in found.checks:
        for problem in check.problems:
            console.err.print(f"{check.name}: {problem}", style="red", markup=False, highlight=False, soft_wrap=True)
    if found.rerun is not None and found.rerun.differing:
        n = len(found.rerun.rows)
        apart = [(one.name, f"{n - one.equal} of {n}", f"{one.largest:.3g}") for one in found.rerun.differing]
        columns = ("column", "rows that differ", "largest difference")
        console.out.print(terminal.table("Not equal to the bit", columns, apart))
    return 0 if found.fine else 1


def merge(
    out: Path,
    shards: Annotated[list[Path], Parameter(consume_multiple=True)],
    *,
    partial: Annotated[bool, Parameter(help="merge though rows are missing")] = False,
) -> None:
    """Join the shards of a campaign into one result folder.

    Their parts are linked or copied, each checked; the shards stay as they are. May be given again after an
    interruption, or with further shards.

    Parameters
    ----------
    out
        Folder to merge into.
    shards
        Result folders of the same campaign, as `ravenjax run --shard` wrote them.
    """
    from ravenjax.store import merging, query

    done = merging.merge(out, shards, partial)
    record = done.manifest
    told = f"{record.done} of {record.runs} runs in {len(record.parts)} parts"
    ways = f"{done.linked} linked, {done.copied} copied, {done.kept} there before"
    console.out.print(f"merged: {out}: {told} ({ways})", highlight=False, soft_wrap=True)
    if done.missing:
        console.out.print(f"missing: rows {query.in_words(done.missing)}", highlight=False, soft_wrap=True)


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
