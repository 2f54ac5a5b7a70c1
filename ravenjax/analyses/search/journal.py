"""Stores finished runs of a search, so that the same command continues an interrupted search.

A search consists of batches. Each batch depends on the outcomes of earlier batches. After an
interruption, the search repeats the same batches. It reads finished runs from this store and
computes the others. The store consists of numbered files, like the parts of a campaign
(`store.parts`). At the end of the search, `rows.parquet` contains all runs.
"""

import contextlib
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.errors import StoreError
from ravenjax.store import files, folder, manifest, parts

ROWS = "rows.parquet"


class Journal:
    """The finished runs in the folder of a search. No other process may write into the folder."""

    def __init__(self, out: Path, identity: str, rows_sha256: str | None = None):
        """Read the finished runs of the folder. Damaged files are renamed and reported.

        `identity`: hash of everything on which outcomes depend. `rows_sha256`: hash of
        `rows.parquet`, if the search has finished before. Raise StoreError if a file cannot be
        read or written, or belongs to another search.
        """
        self.out, self._parts, self._identity = out, out / folder.PARTS, identity
        self.tables: list[pa.Table] = []
        self.notes: tuple[str, ...] = ()
        rows = out / ROWS
        if rows_sha256 is not None and rows.is_file():
            if files.hash_file(rows) == rows_sha256:
                self.tables.append(pq.read_table(rows))
            else:
                self.notes += (f"{rows}: the file was changed, so its runs are computed again",)
        files.require_writable(self._parts)
        recorded = {part.file: part for part in manifest.read_parts(out) or ()}
        part_files = parts.part_files(self._parts)
        for path in part_files:
            try:
                self.tables.append(parts.read_part(path, identity, recorded.get(path.name)))
            except parts.ForeignPart:
                raise
            except StoreError as error:
                self.notes += (folder.set_aside(out, path.name, str(error)),)
        last_rows = (parts.row_range(path)[1] for path in part_files)
        self._next_row = 1 + max(last_rows, default=-1)

    def add(self, rows: pa.Table) -> None:
        """Store finished runs (rows of the result table). Raise StoreError if that fails."""
        # Rows are numbered in the order in which they are stored. A search has no crossed
        # parameters, so each run is its own pair.
        end = self._next_row + len(rows)
        numbers = pa.array(range(self._next_row, end), pa.int32())
        self._next_row = end
        for name in ("index", "pair"):
            index = rows.schema.get_field_index(name)
            rows = rows.set_column(index, rows.schema.field(index), numbers)
        part = parts.put_part(self._parts, parts.encode_table(rows, self._identity))
        manifest.record_part(self.out, part)

    def conclude(self, rows: pa.Table) -> str:
        """Write all runs to `rows.parquet`. Return its sha256. Raise StoreError if that fails."""
        files.write_aside(
            self.out / ROWS, lambda path: pq.write_table(rows, path, compression="zstd")
        )
        return files.hash_file(self.out / ROWS)

    def forget(self) -> None:
        """Delete the numbered files, if possible. `rows.parquet` contains their runs, too."""
        with contextlib.suppress(OSError):
            for path in self._parts.iterdir():
                path.unlink()
            self._parts.rmdir()
            (self.out / manifest.PARTS_FILE).unlink()
