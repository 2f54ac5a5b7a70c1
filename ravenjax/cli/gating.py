"""The command `ravenjax gate`: decides whether a change made results worse than a margin allows."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, ResultFolder


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
    """Judge whether a change of the robot, a check or the software made results worse.

    You state how much worse each result may become. The exit code is 0 if no result exceeds its
    margin, and 1 if a result does. It is 2 if there are too few faults to decide, or if the input
    is wrong.

    Args:
        second: Result folder of the changed robot, check or software, with the same faults.
        margin: largest accepted change. "evades +0.5 points": the share of faults that evade may
            rise by half a percentage point. "stopped -2 points": the share of stopped runs may fall
            by 2. "false cues +2/h": per hour without a fault. Repeat the option for several margins
        most: number of most changed runs to list
        markdown: also write a summary for a pull request
        junit: also write JUnit XML
    """
    from ravenjax.analyses import gate as gates
    from ravenjax.document.html import markdown_table
    from ravenjax.store.files import write_text

    margins = [gates.parse_margin(text) for text in margin]
    result = gates.judge_folders(first, second, margins, most)
    listings = console.fill_listings("gate.j2", gate=result)
    content = {"gate": result, "listings": listings, "markdown_table": markdown_table}
    for path, template in ((markdown, "gate.md.j2"), (junit, "gate.xml.j2")):
        if path is not None:
            write_text(path, console.render_template(template, **content) + "\n")
    if not as_json:
        for sentence in result.compared.sentences():
            console.print_text(sentence)
    console.print_tables(listings, as_json)
    return result.exit_code
