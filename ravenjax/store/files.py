"""Writes files atomically, so that a reader sees a complete file or none, and reads JSON files."""

import contextlib
import hashlib
import io
import itertools
import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pydantic_core

from ravenjax.errors import StoreError, UserError

if TYPE_CHECKING:
    import pandas as pd


KEPT = (
    ". Complete files are kept. Free space or make the folder writable, then start the same command"
    " again."
)


@contextlib.contextmanager
def disk_errors(begin: str, end: str = "") -> Iterator[None]:
    """Convert an OSError to a StoreError with the message: `begin` (reason) `end`."""
    try:
        yield
    except OSError as error:
        raise StoreError(f"{begin} ({error.strerror or error}){end}") from error


def write_aside(path: Path, write: Callable[[Path], object], waits: bool = True) -> None:
    """Write a file atomically: `write` fills a temporary file, which is then renamed to `path`.
    After a crash there is the old file or the new file, and at most one hidden temporary file,
    which the next call overwrites. waits: wait for the disk; otherwise a power failure may lose the
    content, but no reader sees an incomplete file. Raise StoreError if the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    with disk_errors(f"{path}: cannot be written", KEPT):
        try:
            # The temporary file could be a link to a file outside of the folder.
            temporary.unlink(missing_ok=True)
            write(temporary)
            if waits:
                with open(temporary, "rb+") as file:
                    os.fsync(file.fileno())
            os.replace(temporary, path)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
    if not waits:
        return
    # The new name is on the disk only after the folder is flushed.
    with contextlib.suppress(OSError), contextlib.ExitStack() as closing:
        descriptor = os.open(path.parent, os.O_RDONLY)
        closing.callback(os.close, descriptor)
        os.fsync(descriptor)


def write_text(path: Path, text: str, waits: bool = True) -> None:
    """Write a text file in UTF-8 atomically, as `write_aside` does."""
    write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"), waits)


def parse_json(text: str) -> Any:
    """Return the content of a JSON text. Raise ValueError for text that is not JSON, cannot be
    written as UTF-8, or is nested too deeply.
    """
    try:
        return pydantic_core.from_json(text)
    except ValueError as error:
        if "recursion" in str(error):
            raise ValueError("lists or tables are nested too deeply") from None
        raise


def read_json(path: Path, missing: str, advice: str) -> Any:
    """Return the content of a JSON file. Raise StoreError with the message `missing` if the file
    does not exist. If the file is damaged, the message ends with `advice`.
    """
    try:
        with disk_errors(f"{path}: cannot be read"):
            if not path.exists():
                raise StoreError(missing)
            return parse_json(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise StoreError(f"{path}: is not valid JSON ({error}){advice}") from error


def json_values(value: Any) -> Any:
    """Convert nested values, also NumPy arrays, to types of JSON. NaN and infinity become None."""
    text = json.dumps(value, default=lambda array: array.tolist())
    return json.loads(text, parse_constant=lambda _: None)


def without_formula(cell: Any) -> Any:
    """Return a cell of CSV; an apostrophe precedes text that a spreadsheet would compute."""
    computed = isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r"))
    return f"'{cell}" if computed else cell


def path_inside(folder: Path, name: str) -> Path:
    """Return the path of a file or folder in `folder`, of a name that may come from another file.
    Raises StoreError for a name that leads out of the folder, and for a link.
    """
    path = folder / name
    if not re.fullmatch(r"\w[\w.-]{,199}", name) or path.is_symlink():
        raise StoreError(
            f"{folder}: the list of files contains {name!r}, expected a file of this folder that is"
            " not a link. The list is damaged or forged, so nothing was read or written"
        )
    return path


TABLES = (".csv", ".txt", ".tsv", ".parquet")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?|nan", re.IGNORECASE)


def require_content(path: Path) -> None:
    """Raise UserError for an empty file, and for a Git LFS pointer instead of a file."""
    pointer = b"version https://git-lfs.github.com/spec/v1"
    with open(path, "rb") as file:
        begin = file.read(len(pointer))
    if not begin:
        raise UserError(f"{path}: the file is empty; expected a recording")
    if begin == pointer:
        raise UserError(
            f"{path}: is only a Git LFS pointer of {path.stat().st_size} bytes. Download the file"
            " with: git lfs pull"
        )


def read_table(
    path: Path, names: Sequence[str] | None = None, header: str = "time_s,x_mm"
) -> "pd.DataFrame":
    """Read a table from a Parquet file or a text: CSV, or separated by ;, tabs or spaces. names:
    columns of a text without a header line. header: example of a header line for the error message.
    Raise UserError if the file cannot be read or has no header line.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    require_content(path)
    try:
        if path.suffix.lower() == ".parquet":
            table = pq.read_table(path).to_pandas(ignore_metadata=True)
        else:
            table = _read_text(path, names, header)
    except UserError:
        raise
    # pandas raises ValueError, and so does text that is not UTF-8.
    except (ValueError, OSError, pa.ArrowException) as error:
        raise UserError(
            f"{path}: cannot be read as a {path.suffix} table, perhaps because it is truncated:"
            f" {str(error).strip() or type(error).__name__}. Copy or record it again; save a text"
            " as UTF-8"
        ) from None
    require_distinct(path, table)
    return table


def require_distinct(path: Path, table: "pd.DataFrame") -> None:
    """Raise UserError if two columns have the same name."""
    for name in table.columns[table.columns.duplicated()]:
        raise UserError(f"{path}: column {name} is there twice; keep one of them")


def _read_text(path: Path, names: Sequence[str] | None, header: str) -> "pd.DataFrame":
    import pandas as pd

    with open(path, encoding="utf-8-sig") as file:
        lines = [line for line in file if line.strip()] or ["\n"]
    comments = sum(1 for _ in itertools.takewhile(lambda line: line[0] in "#%", lines))
    # NumPy writes the header line as a comment, under other comments.
    lines = [line.lstrip("#% ") for line in lines[:comments][-1:]] + lines[comments:]
    sample = "".join(lines[1:5] or lines)
    spaced = re.search(r"\d,\d+ +-?\d", sample)
    marks = ";\t|" if spaced else ";\t|,"
    separator = next((mark for mark in marks if mark in sample), r"\s+")
    cells = separator.replace("|", r"\|")
    first, second = (re.split(cells, line.strip()) for line in (lines * 2)[:2])
    if comments and len(first) != len(second):
        first, lines = second, lines[1:]
    headed = not all(_NUMBER.fullmatch(cell.strip()) for cell in first if cell.strip())
    if not headed and names is None:
        raise UserError(
            f"{path}: the first line contains numbers, so the table has no header line. It has"
            f" {len(first)} columns; write a line such as {header}"
        )
    if headed:
        # pandas would give the second one another name.
        require_distinct(path, pd.DataFrame(columns=[cell.strip() for cell in first if cell]))
    if names is not None and (headed or len(names) != len(first)):
        got = "a header line" if headed else f"{len(first)} columns"
        raise UserError(f"{path}: has {got}; expected only numbers, in {len(names)} columns")
    comma = re.search(r'"-?\d+,\d+"' if separator == "," else r"\d,\d", sample)
    table = pd.read_csv(
        io.StringIO("".join(lines)),
        sep=separator,
        skipinitialspace=True,
        decimal="," if comma else ".",
        header=0 if headed else None,
    )
    if not isinstance(table.index, pd.RangeIndex):
        raise UserError(f"{path}: rows have more cells than the header line; name every column")
    table.columns = names or [str(name).strip() for name in table]
    if not lines[-1].endswith("\n"):
        *others, last = (_row_size(re.split(cells, line.strip())) for line in lines[headed:])
        if last < min(others, default=last):
            table.attrs["notes"] = (
                f"the last row is probably cut off: it ends in {lines[-1].strip()[-12:]!r}, without"
                " a line break, and is shorter than the others. Copy the file again, or delete this"
                " row",
            )
    return table


def _row_size(row: list[str]) -> tuple[int, int, int]:
    # Returns the number of cells, and of the last cell: 2 if it has a decimal point, else 1; and
    # the number of characters after the point, or of all. A row that was cut off has a smaller
    # tuple. Digits before a point do not count, because their number differs between numbers.
    parts = re.split(r"[.,]", row[-1].strip())
    return len(row), len(parts), len(parts[-1])


EXPECTED_FOLDER = (
    ". Expected a folder in which you may create files; name another folder with --out. No run was"
    " started."
)


def hash_file(path: Path) -> str:
    """Return the sha256 of a file's content as hex digits. For a folder: of the names and contents
    of its files.
    """
    if path.is_dir():
        names = (file for file in sorted(path.iterdir()) if file.is_file())
        lines = [f"{file.name} {hash_file(file)}\n" for file in names]
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def megabytes(variable: str, usual: int, advice: str = ", such as 4000") -> int:
    """Return the number of MB in an environment variable; `usual` if it is not set. Raise
    UserError, whose message ends with `advice`, if it is not a positive whole number.
    """
    text = os.environ.get(variable, "").strip() or f"{usual}"
    if not text.isdecimal() or not int(text):
        raise UserError(f"{variable}={text}: expected a whole number of MB, 1 or more{advice}")
    return int(text)


def require_writable(folder: Path) -> None:
    """Create `folder` if needed, and raise StoreError if no file can be written into it."""
    probe = folder / ".write-test"
    with disk_errors(f"{folder}: the output folder cannot be written to", EXPECTED_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        probe.unlink(missing_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
