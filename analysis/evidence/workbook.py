"""Writes the tables as one workbook (XLSX). The package that writes it is an optional
dependency.
"""

import csv
import importlib
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from evidence.record import NOTICE
from ravenjax.errors import UserError
from ravenjax.outcomes import verdict

FILE = "tables.xlsx"
GOAL = "Each table is there for a spreadsheet, too."
MOST_ROWS = 1_048_575
"""Lines below the header that a sheet can have. The CSV has the further lines of a longer table."""
_COUNTS = {"evaded", "alarms", "failed_runs_of_group", "index", "faults", "evade"}
_COUNTS |= {name.replace(" ", "_") for name in verdict.HAZARDS}


def require_writer() -> ModuleType:
    """Import the package that writes workbooks. Raises UserError if it is not installed."""
    try:
        return importlib.import_module("xlsxwriter")
    except ImportError as error:
        raise UserError(
            "--xlsx needs the package XlsxWriter, which is not installed: pip install"
            " 'ravenjax[xlsx]'; the same tables are written as CSV without it"
        ) from error


def write_workbook(path: Path, tables: Sequence[Path], most: int = MOST_ROWS) -> None:
    """Write tables (CSV) as sheets of a workbook, after a sheet that states what they are not.
    `most`: lines per sheet.

    Text that looks like a formula, a link or a number stays text; for example, a run id such as
    1e10 would be a number. Raises OSError if the disk refuses, and UserError as `require_writer`
    does.
    """
    package = require_writer()
    options = {"constant_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
    lines = [NOTICE, "README.md beside this file has definitions."]
    try:
        with package.Workbook(str(path), options) as book:
            first = book.add_worksheet("read me")
            for table in tables:
                with open(table, encoding="utf-8", newline="") as file:
                    more = _write_sheet(book.add_worksheet(table.stem), csv.reader(file), most)
                if more:
                    rest = f"{more:,} more in {table.name}"
                    lines.append(f"{table.stem}: the first {most:,} lines; {rest}")
            for number, line in enumerate(lines):
                first.write_string(number, 0, line)
    except package.exceptions.XlsxFileError as error:
        # The package wraps the disk's error in an exception that is no OSError.
        raise OSError(str(error)) from error


def _write_sheet(sheet: Any, rows: Iterator[list[str]], most: int) -> int:
    """Write the header and up to `most` lines, and return how many more there are."""
    header = next(rows)
    sheet.freeze_panes(1, 0)
    sheet.set_column(0, len(header) - 1, 18)
    sheet.write_row(0, 0, header)
    line = 0
    for line, row in enumerate(itertools.islice(rows, most), start=1):
        for column, (title, cell) in enumerate(zip(header, row, strict=True)):
            if cell and _is_number(title):
                sheet.write_number(line, column, float(cell))
            elif cell:
                sheet.write_string(line, column, cell)
    sheet.autofilter(0, 0, line, len(header) - 1)
    return sum(1 for _ in rows)


def _is_number(title: str) -> bool:
    """Return whether a column holds numbers."""
    return title.startswith("rate_") or title.endswith("_ms") or title in _COUNTS
