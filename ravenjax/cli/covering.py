"""The command `ravenjax coverage`: which harmful faults each check detects, and pairs of faults."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Count, Listing, ResultFolder, Switch

if TYPE_CHECKING:
    from ravenjax.report.data.runs import Runs


def coverage(
    folder: ResultFolder,
    *,
    of: Annotated[str | None, Parameter(name="--runs")] = None,
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
        of: instead, list the harmful runs with the time at which this check or set of checks
            detects the fault
        pairs: instead, compare runs with two faults with runs that have only one of them
        most: with --pairs: number of pairs of each kind to list; default 5
        out: folder of the files; default FOLDER/coverage
    """
    from ravenjax.analyses.deadline import read_deadlines
    from ravenjax.errors import UserError
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import coverage as checks
    from ravenjax.report.sections import tables
    from ravenjax.store import files, manifest

    if pairs and of is not None:
        raise UserError("--runs and --pairs print different lists: give only one of them")
    if most is not None and not pairs:
        console.print_note("--most has no effect without --pairs")
    out_folder = out or files.path_inside(folder, "coverage")
    with contextlib.closing(Runs.open(folder, manifest.read_manifest(folder))) as runs:
        if pairs:
            return _pairs(runs, out_folder, most or 5, as_json)
        found = checks.measure_coverage(runs, read_deadlines(folder))
        if of is not None:
            columns = ("run", "site", "fault from, ms", "harm from, ms", "detected, ms", "detected")
            listing = Listing("runs", f"Harmful runs: {of}", columns, found.list_runs(of, runs))
            return console.print_tables([listing], as_json)
    files.require_writable(out_folder)
    table = found.harmful.drop(columns=["row", "distinct"]).map(files.without_formula)
    files.write_text(out_folder / "coverage.csv", table.to_csv(index=False))
    if as_json:
        content = {key: getattr(found, key) for key in ("rows", "smallest", "notices")}
        return console.emit_json({**content, "files": [out_folder / "coverage.csv"]})
    names = {"everything": checks.EVERYTHING, "every_site": tables.EVERY_SITE}
    console.print_tables(console.fill_listings("coverage.j2", found=found, **names), as_json)
    for notice in found.notices:
        console.print_note(notice)
    return console.print_written([out_folder / "coverage.csv"])


def _pairs(runs: Runs, out_folder: Path, most: int, as_json: bool) -> None:
    # Prints which single faults and pairs of faults cause harm, and writes files about them.
    from ravenjax.analyses.coverage import pairs
    from ravenjax.store import files

    found = pairs.measure_pairs(runs)
    files.require_writable(out_folder)
    paths = pairs.write_pairs(found, out_folder)
    if as_json:
        singles = found.cut_sets()[0]
        listed = {"cut_sets_of_order_1": singles, "pairs": [pair.cells() for pair in found.pairs]}
        content = {"counts": found.counts, **listed, "notices": found.notices, "files": paths}
        return console.emit_json(content)
    console.print_tables(console.fill_listings("pairs.j2", found=found, most=most), as_json)
    for notice in found.notices:
        console.print_note(notice)
    return console.print_written(paths)
