"""Commands on result folders: `ravenjax report`, `verify`, `compare`, `merge`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing, ResultFolder, SameEngine


def report(folder: ResultFolder, *, figures: Path | None = None) -> None:
    """Write report.html into a result folder.

    Args:
        figures: also draw the main figures into this folder, SVG and PDF
    """
    write_report(folder)
    if figures is not None:
        from ravenjax.report import paper

        for path in paper.write_figures(folder, figures):
            console.print_text(f"wrote {path}")


def verify(
    folder: ResultFolder,
    *,
    sample: int = 64,
    engine: SameEngine = "auto",
    seed: int = 0,
    as_json: AsJson = False,
) -> int:
    """Verify a result folder: checksums, rows, values, and a random sample of runs computed again.

    The exit code is 1 if something is wrong. Runs on another engine may differ; the command
    states by how much.

    Args:
        sample: number of runs to compute again; 0 for none
        seed: seed with which these runs are drawn
    """
    from ravenjax.campaign.inspection import verification

    verified = verification.verify_folder(folder, sample, engine, seed)
    if as_json:
        rerun = verified.rerun
        # JSON lists only the columns that differ.
        if rerun is not None:
            rerun = rerun._replace(rows=rerun.rows.tolist(), columns=rerun.differing)  # pyright: ignore[reportArgumentType]
        checks = [check._asdict() | {"fine": check.fine} for check in verified.checks]
        content = {"folder": folder, "fine": verified.fine, "checks": checks, "rerun": rerun}
        console.emit_json(content)
        return int(not verified.fine)
    rows = [
        (check.name, "ok" if check.fine else "WRONG", check.looked_at) for check in verified.checks
    ]
    console.print_table(f"Verified: {folder}", ("check", "result", "what was checked"), rows)
    for check in verified.checks:
        for problem in check.problems:
            console.print_error(f"{check.name}: {problem}")
    if verified.rerun is not None and verified.rerun.differing:
        run_count = len(verified.rerun.rows)
        rows = [
            (column.name, f"{run_count - column.equal} of {run_count}", f"{column.largest:.3g}")
            for column in verified.rerun.differing
        ]
        columns = ("column", "runs that differ", "largest difference")
        console.print_table("Columns that differ when computed again", columns, rows)
    return int(not verified.fine)


def merge(
    out: Path,
    shards: Annotated[list[Path], Parameter(consume_multiple=True)],
    *,
    partial: bool = False,
) -> None:
    """Join the shards of a campaign into one result folder.

    Parts are linked or copied, and checked. The shards stay unchanged. You can run it again
    after an interruption, or with further shards.

    Args:
        out: Folder to merge into.
        shards: Result folders of the same campaign, as `ravenjax run --shard` wrote them.
        partial: merge although runs are missing
    """
    from ravenjax.store.access import merging, query

    merged = merging.merge_shards(out, shards, partial)
    record = merged.manifest
    parts = len(record.parts)
    runs = f"{record.done} of {record.runs} runs in {parts} part{'s' if parts != 1 else ''}"
    files = (
        f"{merged.linked} files linked, {merged.copied} copied, {merged.present} already present"
    )
    console.print_text(f"merged: {out}: {runs} ({files})")
    if merged.missing:
        console.print_text(f"missing runs: {query.in_words(merged.missing)}")


def write_report(folder: Path, prints: bool = True) -> Path:
    """Write report.html into a result folder and return its path. prints: also print the path."""
    from ravenjax.report import page

    path = page.build_report(folder)
    if prints:
        console.print_text(f"report: {path}")
    return path


def compare(first: ResultFolder, second: Path, *, most: int = 10, as_json: AsJson = False) -> None:
    """Compare two results run by run: configuration, outcomes, rates, and the runs that changed
    most.

    Differences are second minus first. If the faults were drawn at random, they have 95 %
    intervals over the faults.

    Args:
        second: Result folder of another campaign with the same faults, or of the same campaign with
            other settings or code.
        most: number of most changed runs to list
    """
    from ravenjax.report import comparison

    if first.resolve() == second.resolve():
        console.print_note(f"{first} and {second} are the same folder, so nothing can differ")
    result = comparison.compare_folders(first, second, most)
    if as_json:
        content = result._asdict()
        # The key of code and machine in JSON is `made`.
        content["made"] = content.pop("environment")
        console.emit_json(content)
        return
    for sentence in result.sentences():
        console.print_text(sentence)
    changes = [
        (change.path, change.first or "–", change.second or "–")
        for change in (*result.configuration, *result.environment)
    ]
    title = "Differences in configuration, code and machine"
    changed = Listing("configuration", title, ("key", "first", "second"), changes)
    console.print_tables([changed, *console.fill_listings("comparison.j2", found=result)], False)
