"""The command `gate`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing, ResultFolder


def gate(
    first: ResultFolder,
    second: Path,
    *,
    margin: Annotated[list[str], Parameter(negative=())],
    most: int = 10,
    markdown: Path | None = None,
    junit: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Judge whether a change made things worse, by margins that you state.

    The exit code is 0 if every margin holds, 1 if one is exceeded, and 2 if the faults are too few
    to decide, or the input is wrong.

    Parameters
    ----------
    second
        The same of the changed robot, check or software, with the same faults.
    margin
        what may change: "evades +0.5 points" lets the share of evading faults rise by half a
        point, "stopped -2 points" lets another fall, and "false cues +2/h" is per hour without a
        fault; repeat the option for several
    most
        runs that are listed as most changed
    markdown
        also write a summary for a pull request
    junit
        also write JUnit XML
    """
    from ravenjax.analyses import gate as gates
    from ravenjax.store.files import write_aside

    found = gates.judge_folders(first, second, [gates.parse_margin(text) for text in margin], most)
    for path, text in ((markdown, gates.format_markdown), (junit, gates.format_junit)):
        if path is not None:
            content = text(found)
            write_aside(path, lambda target, content=content: target.write_text(content, "utf-8"))
    if not as_json:
        for sentence in found.compared.sentences():
            console.print_text(sentence)
    listings = [
        Listing(name, name.capitalize(), columns, rows)
        for name, columns, rows in found.tables()
        if rows or as_json
    ]
    console.print_tables(listings, as_json)
    return found.exit_code
