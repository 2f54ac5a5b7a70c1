"""The command `ravenjax deadline`: the last time at which an action prevents harm."""

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, ResultFolder, SameEngine


def deadline(
    folder: ResultFolder,
    *,
    group: str | None = None,
    engine: SameEngine = "auto",
    as_json: AsJson = False,
) -> None:
    """Find the point of no return of each harmful fault: the last time at which an action prevents
    the harm.

    The actions are a lifted pedal, a pressed E-stop, a stop by the software, a held command, and
    an operator who follows the cue. An arm from an MJCF file has the last three. Each deadline is
    compared with the time at which a signal first shows the fault. The tables are in
    FOLDER/deadline and in the next report of the folder.

    Args:
        group: only faults of this group
    """
    import contextlib

    from ravenjax.analyses.deadline import find_deadlines
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import deadline as section
    from ravenjax.store import files, manifest
    from ravenjax.store.access import explained

    def print_progress(text: str):
        if not as_json:
            console.print_text(text, console.err)

    record, path = manifest.read_manifest(folder), folder / explained.DEADLINES
    files.require_writable(files.path_inside(folder, path.parent.name))
    table = find_deadlines(folder, engine, group, print_progress)
    if not len(table):
        sentence = "No fault causes harm, so there is no deadline to find."
        return console.print_findings([sentence], as_json, harmful=0)
    explained.write_rows(path, table, record)
    csv_path = path.with_suffix(".csv")
    files.write_text(csv_path, table.map(files.without_formula).to_csv(index=False))
    with contextlib.closing(Runs.open(folder, record)) as runs:
        summary = section.summarize_deadlines(runs, table)
    sentences, tables = section.deadline_sentences(summary), section.deadline_tables(summary)
    files_written = [path, csv_path]
    return console.print_findings(sentences, as_json, tables, files_written, **summary._asdict())
