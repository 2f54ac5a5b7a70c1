"""Writes the tables of evidence as one XLSX workbook, with an optional package."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import pandas as pd

from evidence.record import NOTICE
from ravenjax.errors import UserError
from ravenjax.outcomes import verdict

FILE = "tables.xlsx"
GOAL = "Each table is there for a spreadsheet, too."
MOST_ROWS = 1_048_575
"""Lines below the header that a sheet can have."""
_COUNTS = {"evaded", "alarms", "failed_runs_of_group", "index", "faults", "evade"}
_COUNTS |= {name.replace(" ", "_") for name in verdict.HAZARDS}


def require_writer() -> ModuleType:
    """Import the package that writes workbooks. Raises UserError if it is not installed."""
    try:
        return importlib.import_module("xlsxwriter")
    except ImportError as error:
        needs = "--xlsx needs the package XlsxWriter, which is not installed"
        install = "pip install 'ravenjax[xlsx]'; the same tables are written as CSV without it"
        raise UserError(f"{needs}: {install}") from error


def write_workbook(path: Path, tables: Sequence[Path], most: int = MOST_ROWS) -> None:
    """Write tables (CSV) as sheets of a workbook, after a sheet that states what they are not.
    `most`: lines per sheet. Text that looks like a formula, a link or a number (a run id such as
    1e10) stays text. Raises OSError if the disk refuses.
    """
    package = require_writer()
    options = {"strings_to_formulas": False, "strings_to_urls": False}
    lines = [NOTICE, "README.md beside this file has definitions."]
    try:
        with pd.ExcelWriter(path, "xlsxwriter", engine_kwargs={"options": options}) as book:
            first = book.book.add_worksheet("read me")
            for table in tables:
                frame = pd.read_csv(table, dtype=str, keep_default_na=False)
                numbers = [title for title in frame if _is_number(title)]
                frame[numbers] = frame[numbers].apply(pd.to_numeric)
                shown = frame.head(most)
                shown.to_excel(book, sheet_name=table.stem, index=False, freeze_panes=(1, 0))
                sheet = book.sheets[table.stem]
                sheet.set_column(0, len(frame.columns) - 1, 18)
                sheet.autofilter(0, 0, len(shown), len(frame.columns) - 1)
                if more := len(frame) - len(shown):
                    rest = f"{more:,} more in {table.name}"
                    lines.append(f"{table.stem}: the first {most:,} lines; {rest}")
            first.write_column(0, 0, lines)
    except package.exceptions.XlsxFileError as error:
        # The package wraps the disk's error in an exception that is no OSError.
        raise OSError(str(error)) from error


def _is_number(title: str) -> bool:
    """Return whether a column holds numbers."""
    return title.startswith("rate_") or title.endswith("_ms") or title in _COUNTS
