"""Queries the result table of a folder by SQL, with DuckDB. The table need not fit in memory.

Every query reads from the view `results`, one row per run. Its columns are those of
`ravenjax.store.schema`, and `row`, the number of the run. Data that exceeds the given memory is
written to a temporary folder, which is deleted at the end. Only the manifest's files are read,
after a check of their checksums.
"""

import contextlib
import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax import threads
from ravenjax.errors import StoreError
from ravenjax.store import parts
from ravenjax.store.files import megabytes
from ravenjax.store.folder import PARTS, READERS, read_complete_manifest

if TYPE_CHECKING:
    import duckdb
    import pandas as pd
    import pyarrow as pa

MEMORY_MB = 1000
"""Memory that DuckDB may use, MB. Data beyond this is written to a temporary folder."""
RESULTS = "results"
"""Name of the view of the whole result table."""


class ResultTable(contextlib.ExitStack):
    """SQL queries of one result table. Use it as a context manager, or call `close`. This closes
    the connection and deletes temporary files.
    """

    connection: "duckdb.DuckDBPyConnection"

    def rows(self, sql: str, given: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query. given: values for the question marks in `sql`."""
        return self.run(sql, given).fetchall()

    def row(self, sql: str, given: Sequence[Any] = ()) -> tuple[Any, ...]:
        """Return the only row of a query."""
        (only,) = self.rows(sql, given)
        return only

    def frame(self, sql: str, given: Sequence[Any] = ()) -> "pd.DataFrame":
        """Return the result of a query as a DataFrame. The result must be small."""
        return self.run(sql, given).df()

    def types(self, name: str = RESULTS) -> dict[str, str]:
        """Return the columns of a table or view, in order, and their SQL types."""
        return {row[0]: row[1] for row in self.rows(f"DESCRIBE {quote_name(name)}")}

    def register(self, name: str, table: "pa.Table") -> None:
        """Make an Arrow table available to queries as `name`."""
        self.connection.register(name, table)

    def run(self, sql: str, given: Sequence[Any] = ()) -> "duckdb.DuckDBPyConnection":
        """Run one SQL statement; `given` replaces its question marks. May raise StoreError."""
        import duckdb

        try:
            # A name in somebody else's file must not add a second statement.
            if len(self.connection.extract_statements(sql)) > 1:
                raise StoreError("a name in the result contains SQL, so the result is forged")
            return self.connection.execute(sql, list(given))
        except duckdb.OutOfMemoryException as error:
            raise StoreError(
                "a query of the result table needs more memory than DuckDB may use:"
                f" {parts.first_line(error)}. Permit more with RAVENJAX_QUERY_MB=4000 (in MB), or"
                " free space on the disk of the result folder."
            ) from error
        # One cause is a damaged folder: the manifest states a column that the table lacks.
        except duckdb.Error as error:
            raise StoreError(
                f"a query of the result table failed: {parts.first_line(error)}. `ravenjax verify`"
                " checks the folder"
            ) from error


def open_folder(path: str | Path) -> ResultTable:
    """Open the finished rows of a result folder for queries. Raise StoreError if the folder has no
    results, or if a file is missing, damaged or too new.
    """
    path = Path(path)
    return open_parts(whole_parts(path), path)


def open_parts(files: Sequence[Path], aside: Path | None, numbered: bool = False) -> ResultTable:
    """Open the rows of these Parquet files for queries, without checks. aside: folder for temporary
    files, if it is writable; None: the system's. numbered: add the columns filename and
    file_row_number (from 0).
    """
    table = open_empty(aside)
    options = ", filename = true, file_row_number = true" if numbered else ""
    # `row` is a second name of the column `index`.
    table.run(f'CREATE VIEW {RESULTS} AS SELECT *, "index" AS row FROM {of_files(files, options)}')
    return table


def of_files(files: Sequence[Path], options: str = "") -> str:
    """Return the SQL source of the rows of Parquet files. options: further arguments of DuckDB's
    read_parquet, beginning with a comma.
    """
    # DuckDB takes *, ? and [ in a path for wildcards, except in brackets, such as [*].
    names = ", ".join(quote_text(re.sub(r"([*?\[])", r"[\1]", str(file))) for file in files)
    return f"read_parquet([{names}]{options})"


def whole_parts(path: Path) -> list[Path]:
    """Return the checked Parquet files of a result folder. Raise StoreError as `open_folder`."""
    record = read_complete_manifest(path)
    threads.map_in_threads(
        lambda part: parts.verify_part(path / PARTS / part.file, record.config_hash, part),
        record.parts,
        READERS,
    )
    return [path / PARTS / part.file for part in record.parts]


def open_empty(aside: Path | None = None, memory_mb: int | None = None) -> ResultTable:
    """Return a connection without a table. aside: folder for temporary files, if it is writable;
    None: the system's. memory_mb: memory of DuckDB, MB; None: the environment variable
    RAVENJAX_QUERY_MB, else MEMORY_MB.
    """
    import duckdb

    limit_mb = memory_mb or megabytes("RAVENJAX_QUERY_MB", MEMORY_MB)
    with ResultTable() as closing:
        parent = aside if aside is not None and os.access(aside, os.W_OK) else None
        folder = closing.enter_context(tempfile.TemporaryDirectory(prefix=".query-", dir=parent))
        connection = duckdb.connect(
            config={
                "memory_limit": f"{limit_mb}MB",
                "temp_directory": folder,
                "threads": len(os.sched_getaffinity(0)),
                # Queries state their order, and preserving the order of insertion needs memory.
                "preserve_insertion_order": False,
                "autoinstall_known_extensions": False,
            }
        )
        closing.callback(connection.close)
        # A notebook without ipywidgets has no progress bar.
        with contextlib.suppress(duckdb.InvalidInputException):
            connection.execute("SET enable_progress_bar = false")
        # With compression, intermediate tables need a third of the space.
        connection.execute("ATTACH ':memory:' AS compressed (COMPRESS)")
        connection.execute("USE compressed")
        # Without an error, the returned object is to close the connection, not this block.
        table = closing.pop_all()
        table.connection = connection
        return table


def in_words(ranges: Sequence[range]) -> str:
    """Return row ranges as text for an error: `0 to 99, 300 and 2 more ranges`."""
    most = 5
    words = [
        f"{rows.start:,}" + (f" to {rows.stop - 1:,}" if len(rows) > 1 else "")
        for rows in ranges[:most]
    ]
    more = f" and {len(ranges) - most} more ranges" if len(ranges) > most else ""
    return ", ".join(words) + more


def quote_name(name: str) -> str:
    """Return a column's name as SQL identifier."""
    return '"' + name.replace('"', '""') + '"'


def enum_type(words: Sequence[str]) -> str:
    """Return an SQL enum type of these words, which needs one byte per value."""
    return "ENUM (" + ", ".join(quote_text(word) for word in words) + ")"


def quote_text(word: str) -> str:
    """Return a word as SQL string literal."""
    return "'" + word.replace("'", "''") + "'"
