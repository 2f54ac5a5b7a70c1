"""Stores the runs of a search as they finish, so that the same command continues after an
interruption.

A search is made of batches, each of which follows from the outcomes of those before. What is kept
is runs alone: the next start takes the same way again, finds the runs of finished batches here, and
computes from where there are none. Parts are a campaign's (`store.parts`), numbered as they come;
once the search is done, `rows.parquet` holds all in one.
"""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.campaign.executors.protocol import BackgroundQueue
from ravenjax.errors import StoreError
from ravenjax.store import files, folder, manifest, parts

ROWS = "rows.parquet"
EVERY_S = 1.0
"""Longest that runs of small batches wait for more, so that a file is worth its while."""
WRITERS = 2
"""Parts that are written side by side, at most."""


class Journal:
    """Finished runs in a search's folder, which nobody else writes to (see `store.lock`).

    A context manager while runs are added: what still waits is written on the way out, however that
    comes.
    """

    def __init__(self, out: Path, identity: str, rows_sha256: str | None = None) -> None:
        """Take over what the folder holds; a damaged part is set aside and noted.

        identity: hash of all that decides outcomes. rows_sha256: of `rows.parquet`, where an
        earlier start was done. Raises StoreError where the disk refuses or a part belongs to
        something else.
        """
        self.out, self._parts, self._identity = out, out / folder.PARTS, identity
        self.tables: list[pa.Table] = []
        self.notes: tuple[str, ...] = ()
        rows = out / ROWS
        if rows_sha256 is not None and rows.is_file():
            if files.sha256(rows) == rows_sha256:
                self.tables.append(pq.read_table(rows))
            else:
                self.notes += (f"{rows}: its content was changed; its runs are computed again",)
        files.require_writable(self._parts)
        recorded = {part.file: part for part in manifest.recorded(out) or ()}
        there = parts.files(self._parts)
        for path in there:
            try:
                self.tables.append(parts.read(path, identity, recorded.get(path.name)))
            except parts.ForeignPart:
                raise
            except StoreError as error:
                self.notes += (folder.set_aside(out, path.name, str(error)),)
        self._next = max((parts.row_range(path)[1] + 1 for path in there), default=0)
        self._waiting: list[pa.Table] = []
        self._written = time.monotonic()
        self._behind, self._recording = BackgroundQueue(WRITERS), threading.Lock()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._behind:
            try:
                self._write()
                self._behind.finish()
            except StoreError:
                if kind is None:  # else something has ended the work before, and that is told of
                    raise

    def add(self, rows: pa.Table) -> None:
        """Keep finished runs, rows of the result table; not from two threads at once.

        Small batches wait for others: a kill loses what was computed within `EVERY_S`. Raises
        StoreError where the disk refused what was added before.
        """
        self._waiting.append(rows)
        if (
            sum(map(len, self._waiting)) >= parts.FEWEST_ROWS
            or time.monotonic() - self._written >= EVERY_S
        ):
            self._write()

    def _write(self) -> None:
        self._written = time.monotonic()
        if self._waiting:
            rows = pa.concat_tables(self._waiting).unify_dictionaries()
            self._waiting = []
            numbers = pa.array(range(self._next, self._next + len(rows)), pa.int32())
            self._next += len(rows)
            for name in ("index", "pair"):
                place = rows.schema.get_field_index(name)
                rows = rows.set_column(place, rows.schema.field(place), numbers)
            self._behind.call(self._put, rows)

    def _put(self, rows: pa.Table) -> None:
        part = parts.put(self._parts, parts.encode_table(rows, self._identity))
        with self._recording:
            manifest.record(self.out, part)

    def conclude(self, rows: pa.Table) -> str:
        """Write `rows.parquet`; its sha256. Raises StoreError where the disk refuses."""
        files.write_aside(
            self.out / ROWS, lambda path: pq.write_table(rows, path, compression="zstd")
        )
        return files.sha256(self.out / ROWS)

    def forget(self) -> None:
        """Remove the parts: `rows.parquet` holds what they hold. What cannot be removed does no
        harm.
        """
        with contextlib.suppress(OSError):
            for path in self._parts.iterdir():
                path.unlink()
            self._parts.rmdir()
            (self.out / manifest.PARTS_FILE).unlink()
