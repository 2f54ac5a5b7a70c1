"""The command `ravenjax coverage`: the harmful faults that checks detect, and harmful pairs."""

import contextlib
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Count, Listing, ResultFolder, Switch

HEADINGS = ("run", "site", "fault from, ms", "harm from, ms", "detected, ms", "detected")
"""Headings of the list of harmful runs."""


def coverage(
    folder: ResultFolder,
    *,
    check_name: Annotated[str | None, Parameter(name="--runs")] = None,
    pairs: Switch = False,
    most: Count = None,
    out: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Measure which share of the harmful faults each check detects: its diagnostic coverage.

    The table has a row for each check, each detector and the cue, and for all of them together. It
    counts the faults that are detected at all, and those that are detected before the harm. If
    `ravenjax deadline` has computed deadlines, it also counts detections in time for a stop.

    Args:
        check_name: instead, list the harmful runs with the time at which this check or set of
            checks detects the fault
        pairs: instead, compare runs with two faults with runs that have only one of them
        most: with --pairs: number of pairs of each kind to list; default 5
        out: folder of the files; default FOLDER/coverage
    """
    from ravenjax.analyses import double_faults
    from ravenjax.errors import UserError
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import coverage as checks
    from ravenjax.report.sections import tables
    from ravenjax.store import files, manifest
    from ravenjax.store.access import explained

    if pairs and check_name is not None:
        raise UserError("--runs and --pairs print different lists: give only one of them")
    if most is not None and not pairs:
        console.print_note("--most has no effect without --pairs")
    out_folder = out or files.path_inside(folder, "coverage")
    with contextlib.closing(Runs.open(folder, manifest.read_manifest(folder))) as runs:
        if pairs:
            found = double_faults.measure_pairs(runs)
        else:
            found = checks.measure_coverage(runs, explained.read_deadlines(folder))
            if check_name is not None:
                rows = found.list_runs(check_name, runs)
                listing = Listing("runs", f"Harmful runs: {check_name}", HEADINGS, rows)
                return console.print_tables([listing], as_json)
    files.require_writable(out_folder)
    if isinstance(found, double_faults.DoubleFaults):
        paths = double_faults.write_pairs(found, out_folder)
        content = {
            "counts": found.counts,
            "cut_sets_of_order_1": found.cut_sets()[0],
            "pairs": [pair.cells() for pair in found.pairs],
        }
    else:
        paths = [out_folder / "coverage.csv"]
        # These columns are indices that only the computation uses.
        table = found.harmful.drop(columns=["row", "distinct"]).map(files.without_formula)
        files.write_text(paths[0], table.to_csv(index=False))
        content = {"rows": found.rows, "smallest": found.smallest}
    if as_json:
        return console.emit_json(content | {"notices": found.notices, "files": paths})
    names = {"everything": checks.EVERYTHING, "every_site": tables.EVERY_SITE, "most": most or 5}
    template = "pairs.j2" if pairs else "coverage.j2"
    console.print_tables(console.fill_listings(template, found=found, **names), as_json)
    for notice in found.notices:
        console.print_note(notice)
    return console.print_written(paths)
