"""Writes files atomically, so that a reader sees a whole file or none, and reads their JSON."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.errors import StoreError, UserError

if TYPE_CHECKING:
    import pandas as pd


def write_aside(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, flush it to disk and rename it to `path`.

    A crash at any point leaves the old `path` or the new one, and at most one hidden temporary
    file, which the next attempt overwrites. Raises StoreError that names `path` if the disk
    refuses.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        write(temporary)
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise StoreError(
            f"{path}: cannot be written ({error.strerror or error}). Nothing that was there before"
            " is lost; free space or make the folder writable, then start the same command again."
        ) from error


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 as `write_aside` does."""
    write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def replace(path: Path, text: str) -> None:
    """Replace a file's content with `text` atomically, without waiting for the disk.

    For content that may be lost in a power failure but must never be read incomplete. Raises
    OSError if the disk refuses.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def parsed(text: str) -> Any:
    """Return the content of a JSON text.

    Raises ValueError for other text, or where lists and tables are nested too deeply; `json.loads`
    would exhaust the stack.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def json_values(value: Any) -> Any:
    """Return nested values as JSON has them: no NumPy types, None for NaN and infinities."""
    text = json.dumps(value, default=lambda numbers: numbers.tolist())
    return json.loads(text, parse_constant=lambda _: None)


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file in `folder` whose name was read from another file.

    Raises StoreError for a name that leads out of the folder.
    """
    if name in ("", "..") or Path(name).name != name:
        raise StoreError(
            f"{folder}: a record names the file {name!r}, expected the name of a file in this"
            " folder. Nothing was read or written: the record is damaged or forged"
        )
    return folder / name


TABLES = (".csv", ".parquet")


def read_table(path: Path) -> pd.DataFrame:
    """Return the table in a CSV or Parquet file. Raises UserError if it cannot be read."""
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if path.suffix.lower() == ".csv":
            return pd.read_csv(path, skipinitialspace=True)
        return pq.read_table(path).to_pandas(ignore_metadata=True)
    # pandas raises ValueError, and so does text that is not UTF-8.
    except (ValueError, OSError, pa.ArrowException) as error:
        raise UserError(
            f"{path}: no {path.suffix} table that can be read, perhaps truncated:"
            f" {str(error).strip() or type(error).__name__}. Copy or record it again"
        ) from None


def _sync_folder(folder: Path) -> None:
    """Flush the rename itself, if the file system can sync a folder."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def sha256(path: Path) -> str:
    """Return the sha256 of a file's content as hex digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_writable(folder: Path) -> None:
    """Create `folder` if needed and write a file to prove that it is writable.

    Raises StoreError if it is not.
    """
    probe = folder / ".write-test"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise StoreError(
            f"{folder}: the output folder cannot be written to ({error.strerror or error})."
            " Expected a folder that this user may create files in; name another one with --out."
            " No run was started."
        ) from error
