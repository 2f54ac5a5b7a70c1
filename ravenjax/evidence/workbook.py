"""The tables as one workbook (XLSX). Its writer is an extra, imported only where somebody wants
one.
"""

from __future__ import annotations

import contextlib
import csv
import importlib
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from ravenjax.errors import UserError
from ravenjax.evidence.notice import NOTICE
from ravenjax.outcomes import verdict

FILE = "tables.xlsx"
GOAL = "Each table is there for a spreadsheet, too."
MOST_ROWS = 1_048_575
"""Lines below the header that a sheet can have; of a longer table the rest stands in its CSV
alone.
"""
_COUNTS = {"evaded", "alarms", "failed_runs_of_group", "index", "faults", "evade"}
_COUNTS |= {name.replace(" ", "_") for name in verdict.HAZARDS}
_SHARES = {"rate_value", "rate_low", "rate_high"}
_LEAST, _WIDEST, _BUTTON = 6, 48, 4
"""Letters of a column: at least, at most, and those under the button of its filter."""
_SAMPLE = 500
"""Lines by which columns are as wide as they are."""
_READ, _LINE = 80, 16
"""Letters of a line of the first sheet, and its height."""
_HEAD = {"bold": True, "bg_color": "#eef2f6", "bottom": 1}


def writer() -> ModuleType:
    """The package that writes workbooks. Raises UserError where it is not installed."""
    try:
        return importlib.import_module("xlsxwriter")
    except ImportError as error:
        raise UserError(
            "--xlsx needs the package XlsxWriter, which is not installed: pip install"
            " 'ravenjax[xlsx]'; the same tables are written as CSV without it"
        ) from error


def write(path: Path, tables: Sequence[Path], most: int = MOST_ROWS) -> None:
    """Tables (CSV) as sheets of a workbook, after a sheet that says what they are not. most: lines
    of a sheet.

    Raises OSError where the disk refuses, UserError as `writer`.
    """
    package = writer()
    try:
        _write(package, path, tables, most)
    except (
        package.exceptions.XlsxFileError
    ) as error:  # wraps the error of the disk, and is none itself
        raise OSError(str(error)) from error


def _write(package: ModuleType, path: Path, tables: Sequence[Path], most: int) -> None:
    """Sheet by sheet, line by line.

    What looks like a formula, a link or a number stays the text that it is: a run id such as 1e10
    would be one. Numbers have 16 digits there.
    """
    options = {"constant_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
    with package.Workbook(str(path), options) as book, contextlib.ExitStack() as stack:
        first, wrapped = (
            book.add_worksheet("read me"),
            book.add_format({"text_wrap": True, "valign": "top"}),
        )
        heads = [
            book.add_format(_HEAD | {"indent": 1}),
            book.add_format(_HEAD | {"align": "right"}),
        ]
        words = book.add_format({"indent": 1})  # apart from the number before it
        first.set_column(0, 0, _READ)
        rate = book.add_format({"num_format": "0.0000"})
        lines = [NOTICE, "README.md beside this file has definitions."]
        for table in tables:
            rows = csv.reader(stack.enter_context(open(table, encoding="utf-8", newline="")))
            name, header, total = table.stem, next(rows), 0
            sheet, sample = book.add_worksheet(name), list(itertools.islice(rows, _SAMPLE))
            _lay_out(sheet, header, sample)
            for column, title in enumerate(header):
                sheet.write_string(0, column, title, heads[_numeric(title)])
            rows = itertools.chain(sample, rows)
            for line, row in enumerate(itertools.islice(rows, most), start=1):
                total = line
                for column, (title, cell) in enumerate(zip(header, row, strict=True)):
                    if cell and _numeric(title):
                        sheet.write_number(
                            line, column, float(cell), rate if title in _SHARES else None
                        )
                    elif cell:
                        sheet.write_string(line, column, cell, words)
            if total:
                sheet.autofilter(0, 0, total, len(header) - 1)
            more = sum(1 for _ in rows)
            lines += (
                [f"{name}: the first {total:,} lines; {more:,} more in {name}.csv"] if more else []
            )
        for number, text in enumerate(lines):
            first.set_row(number, _LINE * math.ceil(len(text) / _READ))
            first.write_string(number, 0, text, wrapped)


def _lay_out(sheet: Any, header: Sequence[str], sample: Sequence[Sequence[str]]) -> None:
    """Columns as wide as what they hold, up to a limit; on paper as wide as a page, with the
    header on each.
    """
    for column, title in enumerate(header):
        longest = 0 if title in _SHARES else max((len(row[column]) for row in sample), default=0)
        sheet.set_column(
            column, column, min(_WIDEST, max(_LEAST, len(title) + _BUTTON, longest + 2))
        )
    sheet.freeze_panes(1, 0)
    sheet.repeat_rows(0)
    sheet.set_landscape()
    sheet.set_paper(8)  # A3
    sheet.fit_to_pages(1, 0)


def _numeric(title: str) -> bool:
    """Whether a column holds numbers."""
    return title.startswith("rate_") or title.endswith("_ms") or title in _COUNTS
