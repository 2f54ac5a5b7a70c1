"""Writes files atomically, so that a reader sees a complete file or none, and reads JSON files."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.errors import StoreError, UserError

if TYPE_CHECKING:
    import pandas as pd


@contextlib.contextmanager
def disk_errors(begin: str, end: str = "") -> Iterator[None]:
    """Convert an OSError to a StoreError with the message: `begin` (reason) `end`."""
    try:
        yield
    except OSError as error:
        raise StoreError(f"{begin} ({error.strerror or error}){end}") from error


def write_aside(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file atomically: `write` fills a temporary file, which is then renamed to `path`.

    After a crash there is the old file or the new file, and at most one hidden temporary file,
    which the next call overwrites. Raise StoreError if the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    kept = (
        ". Existing files are unchanged. Free space or make the folder writable, then start the"
        " same command again."
    )
    with disk_errors(f"{path}: cannot be written", kept):
        try:
            # The temporary file could be a link to a file outside of the folder.
            temporary.unlink(missing_ok=True)
            write(temporary)
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
    # The new name is on the disk only after the folder is flushed.
    with contextlib.suppress(OSError), contextlib.ExitStack() as closing:
        descriptor = os.open(path.parent, os.O_RDONLY)
        closing.callback(os.close, descriptor)
        os.fsync(descriptor)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 atomically, as `write_aside` does."""
    write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def replace_file(path: Path, text: str) -> None:
    """Replace the content of a file atomically, without waiting for the disk.

    A power failure may lose the content, but no reader sees an incomplete file. Raise OSError if
    the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.unlink(missing_ok=True)
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def parse_json(text: str) -> Any:
    """Return the content of a JSON text.

    Raise ValueError for text that is not JSON, or is nested so deeply that `json.loads` would
    exhaust the stack.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def read_json(path: Path, missing: str, advice: str) -> Any:
    """Return the content of a JSON file.

    Raise StoreError with the message `missing` if the file does not exist. If the file is damaged,
    the message ends with `advice`.
    """
    try:
        with disk_errors(f"{path}: cannot be read"):
            if not path.exists():
                raise StoreError(missing)
            return parse_json(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise StoreError(f"{path}: is not valid JSON ({error}){advice}") from error


def json_values(value: Any) -> Any:
    """Convert nested values to types of JSON. NaN and infinite numbers become None."""
    text = json.dumps(value, default=lambda numbers: numbers.tolist())
    return json.loads(text, parse_constant=lambda _: None)


def path_inside(folder: Path, name: str) -> Path:
    """Return the path of a file in `folder` whose name was read from another file.

    Raises StoreError for a name that leads out of the folder.
    """
    if name in ("", "..") or Path(name).name != name:
        raise StoreError(
            f"{folder}: the list of files contains {name!r}, expected the name of a file in this"
            " folder. The list is damaged or forged, so nothing was read or written"
        )
    return folder / name


TABLES = (".csv", ".txt", ".tsv", ".parquet")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?|nan", re.IGNORECASE)


def require_content(path: Path) -> None:
    """Raise UserError for an empty file, and for a Git LFS pointer instead of a file."""
    with open(path, "rb") as file:
        begin = file.read(42)
    if not begin:
        raise UserError(f"{path}: the file is empty; expected a recording")
    if begin == b"version https://git-lfs.github.com/spec/v1":
        raise UserError(
            f"{path}: is only a Git LFS pointer of {path.stat().st_size} bytes. Download the file"
            " with: git lfs pull"
        )


def read_table(
    path: Path, names: Sequence[str] | None = None, header: str = "time_s,x_mm"
) -> pd.DataFrame:
    """Read a table from a Parquet file or a text: CSV, or separated by ;, tabs or spaces.

    names: columns of a text without a header line. header: example of a header line for the error
    message. Raise UserError if the file cannot be read or has no header line.
    """
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    require_content(path)
    try:
        if path.suffix.lower() == ".parquet":
            return pq.read_table(path).to_pandas(ignore_metadata=True)
        with open(path, encoding="utf-8-sig") as file:
            lines = "".join(itertools.islice(file, 5))
        separator = next((mark for mark in ";\t," if mark in lines), r"\s+")
        first = re.split(separator, lines.strip().partition("\n")[0].strip())
        headed = not all(_NUMBER.fullmatch(cell.strip()) for cell in first if cell.strip())
        if not headed and names is None:
            raise UserError(
                f"{path}: the first line contains numbers, so the table has no header line. Write a"
                f" line with the names of its {len(first)} columns, such as {header}"
            )
        if names is not None and (headed or len(names) != len(first)):
            got = "a header line" if headed else f"{len(first)} columns"
            raise UserError(f"{path}: has {got}; expected only numbers, in {len(names)} columns")
        decimal = "," if separator != "," and re.search(r"\d,\d", lines) else "."
        table = pd.read_csv(
            path,
            sep=separator,
            skipinitialspace=True,
            decimal=decimal,
            header=0 if headed else None,
        )
        table.columns = names or [str(name).lstrip("# ").strip() for name in table]
        return table
    except UserError:
        raise
    # pandas raises ValueError, and so does text that is not UTF-8.
    except (ValueError, OSError, pa.ArrowException) as error:
        raise UserError(
            f"{path}: cannot be read as a {path.suffix} table, perhaps because it is truncated:"
            f" {str(error).strip() or type(error).__name__}. Copy or record it again"
        ) from None


EXPECTED_FOLDER = (
    ". Expected a folder in which you may create files; name another folder with --out. No run was"
    " started."
)


def hash_file(path: Path) -> str:
    """Return the sha256 of a file's content as hex digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_writable(folder: Path) -> None:
    """Create `folder` if needed, and raise StoreError if no file can be written into it."""
    probe = folder / ".write-test"
    with disk_errors(f"{folder}: the output folder cannot be written to", EXPECTED_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        probe.unlink(missing_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
