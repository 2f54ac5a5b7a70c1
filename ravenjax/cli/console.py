"""Printed output of commands, and options that several commands share."""

import importlib
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from cyclopts import Parameter, validators
from rich.console import Console
from rich.table import Table

from ravenjax.engines import selection
from ravenjax.errors import UserError

if TYPE_CHECKING:
    from ravenjax.report.run.ranking import WorstRun

MAX_NAME_LENGTH = 48
"""Largest length of a name, in characters. Longer texts in the first column are sentences."""

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\x9b]")

out = Console()
err = Console(stderr=True)

Overrides = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        consume_multiple=True,
        negative="",
        help="key.path=value, such as campaign.duration_s=5 or group.0.runs=100",
    ),
]
Count = Annotated[int | None, Parameter(validator=validators.Number(gte=1))]
Words = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
Switch = Annotated[bool, Parameter(negative="")]
Engine = Annotated[str, Parameter(help=selection.CHOICES)]
SameEngine = Annotated[str, Parameter(help="auto is the engine that computed the campaign")]
ResultFolder = Annotated[Path, Parameter(help="Result folder that `ravenjax run` wrote.")]
RunIds = Annotated[
    str, Parameter(help="The run_id of each run, its first letters, or the run's index.")
]
Ranking = Annotated[
    str, Parameter(help="order of worst runs: unintended, loss, report, tissue, cue or response")
]

AsJson = Annotated[bool, Parameter(name="--json", negative="", help="print only JSON")]


class Listing(NamedTuple):
    """A table that a command prints. In JSON it is a list of objects."""

    name: str  # key of the list in JSON
    title: str
    # Headings of the columns. In JSON, "what it asks" becomes the key what_it_asks.
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def print_tables(listings: Sequence[Listing], as_json: bool) -> None:
    """Print the tables that have rows, or all as one JSON object {name: [{column: cell}]}."""
    if as_json:
        emit_json({listing.name: _row_objects(listing) for listing in listings})
        return
    filled = [listing for listing in listings if listing.rows]
    for number, listing in enumerate(filled):
        # A blank line separates two tables.
        if number:
            out.print()
        print_table(listing.title, listing.columns, listing.rows)


def print_table(
    title: str, columns: tuple[str, ...], rows: Sequence[tuple[str, ...]], to: Console | None = None
) -> None:
    """Print a table of text to a console; `to` None: standard output. Names in the first column are
    not wrapped, so that they can be copied. Sentences are wrapped.
    """
    grid = Table(title=title, title_justify="left", show_edge=False)
    has_names = all(len(row[0]) <= MAX_NAME_LENGTH for row in rows)
    for number, column in enumerate(columns):
        grid.add_column(column, overflow="fold", no_wrap=has_names and number == 0)
    # A terminal would obey control characters, and Rich would obey text in square brackets.
    for row in rows:
        grid.add_row(*(_CONTROL.sub("", cell).replace("[", r"\[") for cell in row))
    (to or out).print(grid)


def emit_json(value: Any) -> None:
    """Print a value as JSON. NaN and infinite numbers become null, and paths become text."""
    import json

    def convert(other: Any) -> Any:
        # Converts arrays and numbers of NumPy to Python's, and all else, such as paths, to text.
        return other.tolist() if hasattr(other, "tolist") else str(other)

    text = json.dumps(_with_objects(value), default=convert)
    plain = json.loads(text, parse_constant=lambda _: None)
    print(json.dumps(plain, indent=1, ensure_ascii=False), file=out.file)


def print_text(text: object, to: Console | None = None, style: str | None = None) -> None:
    """Print text without markup to a console; `to` None: standard output."""
    # A terminal would obey control characters of a foreign file.
    plain = _CONTROL.sub("", str(text))
    (to or out).print(plain, style=style, markup=False, highlight=False, soft_wrap=True)


def print_findings(
    sentences: Sequence[str],
    as_json: bool,
    tables: Iterable[tuple[str, Sequence[tuple[str, ...]]]] = (),
    files: Sequence[Path] = (),
    **content: Any,
) -> None:
    """Print sentences, tables and the paths of written files. As JSON, print one object with the
    keys `sentences` and `files` and those of `content`, without the tables. tables: (title, rows)
    of each table; its first row has the headings. A table with only its headings is not printed.
    """
    if as_json:
        return emit_json(content | {"sentences": sentences, "files": files})
    print_text("\n".join(sentences))
    for title, (columns, *rows) in tables:
        if rows:
            print_table(title, columns, rows)
    return print_written(files)


def print_written(paths: Iterable[Path]) -> None:
    """Print the paths of files that a command wrote."""
    for path in paths:
        print_text(f"  wrote    {path}")


def render_template(template: str, **content: Any) -> str:
    """Return the text of a template of this package, filled with `content`."""
    from ravenjax.report.wording import text_templates

    return text_templates("ravenjax.cli").get_template(template).render(content).rstrip("\n")


def fill_listings(template: str, **content: Any) -> list[Listing]:
    """Render a template of this package and return the tables that it describes. In the rendered
    text a blank line separates two tables. The first line of a table has its name and title, the
    second its columns, and each further line a row. Cells are separated by "|". Only the last cell
    of a line may contain "|".
    """
    listings = []
    for table in render_template(template, **content).split("\n\n"):
        name_and_title, headings, *lines = table.splitlines()
        name, title = name_and_title.split("|")
        columns = tuple(headings.split("|"))
        # With this limit on the number of splits, the last cell keeps its "|".
        rows = [tuple(line.split("|", len(columns) - 1)) for line in lines]
        listings.append(Listing(name, title, columns, rows))
    return listings


def print_error(text: str) -> None:
    """Print an error message."""
    print_text(text, err, "red")


def print_note(text: str) -> None:
    """Print a note on standard error."""
    print_text(f"note: {text}", err)


def load_module(name: str) -> Any:
    """Import and return a module of the folder `analysis` of a checkout, such as
    "studies.claims". Raise UserError if ravenjax runs from an installed package.
    """
    analysis = Path(__file__).resolve().parents[2] / "analysis"
    folder = analysis / name.partition(".")[0]
    if not (folder / "__init__.py").is_file():
        raise UserError(
            f"this command needs a checkout of the repository, but the folder {folder} is missing."
            " Clone the repository and install it with `pip install -e .`"
        )
    if str(analysis) not in sys.path:
        sys.path.insert(0, str(analysis))
    return importlib.import_module(name)


def worst_runs(folder: Path, most: int | None, by: str) -> "list[WorstRun]":
    """Return the `most` worst runs of a result folder, worst first; [] if `most` is None. by: name
    of the ranking. If the ranking has fewer runs, return these and print a note.
    """
    from ravenjax.report.run import ranking

    if most is None:
        return []
    ranked = ranking.worst_runs(folder, most, by)
    if len(ranked) < most:
        have = "run is" if len(ranked) == 1 else "runs are"
        rank = ranking.RANKINGS[by]
        # For example: "results: only 3 runs are above 0 mm (largest unintended motion)".
        print_note(f"{folder}: only {len(ranked)} {have} above 0 {rank.unit} ({rank.meaning})")
    return ranked


def _row_objects(listing: Listing) -> list[dict[str, str]]:
    # Returns each row of a table as {key: cell}. Keys are headings in lower case with underscores.
    keys = [re.sub(r"[^a-z0-9]+", "_", column.lower()).strip("_") for column in listing.columns]
    return [dict(zip(keys, row, strict=True)) for row in listing.rows]


def _with_objects(value) -> Any:
    """Return nested values with a dict in place of each named tuple, and lists of other tuples."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {str(key): _with_objects(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | set):
        return [_with_objects(inner) for inner in value]
    return value
