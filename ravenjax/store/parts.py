"""Reads and writes the Parquet files that together are the result table of a campaign: its *parts*.

Each part contains a range of rows. It is written completely or not at all.
"""

import bisect
import contextlib
import hashlib
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field

from ravenjax.errors import StoreError
from ravenjax.store import schema
from ravenjax.store.files import hash_file, write_aside

if TYPE_CHECKING:
    import pandas as pd

_NAME = re.compile(r"part-(\d{9})-(\d{9})\.parquet")

FEWEST_ROWS, MOST_ROWS = 1024, 65_536
"""Smallest and largest number of rows of a part, if the user chose no number.

Fewer rows take longer to write than to compute. More rows are stored too late.
"""
SINGLE_FACTOR, PARTS = 4, 32
"""Factor on FEWEST_ROWS if one process computes all and waits for the writer; parts per process."""

Row = Annotated[int, Field(ge=0, lt=10**9)]
"""Index of a row, or a number of rows. Names of parts have nine digits."""


class ForeignPart(StoreError):
    """Raised for a complete file of another campaign, of another schema, or of another program."""


class Part(BaseModel):
    """One finished part, as the manifest records it."""

    model_config = ConfigDict(frozen=True)

    file: str  # name inside the parts folder
    first: Row  # index of the first row
    last: Row  # index of the last row, inclusive
    sha256: str  # hex digest of the file
    size: int  # bytes
    # Number of runs without a valid outcome, by cause; None: not counted.
    failed: dict[str, int] | None = None

    @property
    def rows(self) -> range:
        """Row indices of the part."""
        return range(self.first, self.last + 1)


def rows_of_a_part(runs: int, workers: int | None = 1) -> int:
    """Return the number of rows of each part of a campaign of `runs` runs, if the user chose none.
    workers: number of processes that compute the campaign; None: unknown. Each process computes
    PARTS parts, unless these would have too few or too many rows.
    """
    fewest = FEWEST_ROWS * (SINGLE_FACTOR if workers == 1 else 1)
    # The quotient is rounded up. An unknown number of processes counts as 2.
    rows = -(-runs // (PARTS * (workers or 2)))
    return min(max(rows, fewest), MOST_ROWS)


class Encoded(NamedTuple):
    """A finished part that is not yet in a folder: its record, and the bytes of its file."""

    part: Part
    content: bytes


def encode_part(columns: schema.Columns, shape: schema.Shape, config_hash: str) -> Encoded:
    """Encode rows as a Parquet file. Equal rows give equal bytes. The column `index` must increase
    by 1. Raise StoreError if columns do not fit the schema.
    """
    return encode_table(schema.conform_table(columns, shape), config_hash)


def encode_table(table: pa.Table, config_hash: str) -> Encoded:
    """Encode rows of `schema.conform_table` as a Parquet file. `index` must increase by 1."""
    index = table.column("index").to_numpy()
    first, last = int(index[0]), int(index[-1])
    if not np.array_equal(index, np.arange(first, first + len(index))):
        raise StoreError(
            f"expected consecutive rows, got {len(index)} rows with index {first} to {last}"
        )
    metadata = {**table.schema.metadata, b"ravenjax.config_hash": config_hash.encode()}
    table = table.replace_schema_metadata(metadata)
    sink = pa.BufferOutputStream()
    # Dictionaries only for words and integers were measured to be faster and smaller than for all
    # columns, because floating-point numbers and ids rarely repeat. Row numbers mostly rise by 1,
    # so their differences are stored.
    rising = [name for name in ("index", "pair") if name in table.column_names]
    unrepeated = {"run_id", *rising}
    pq.write_table(
        table,
        sink,
        compression="zstd",
        use_dictionary=[  # pyright: ignore[reportArgumentType]
            column.name
            for column in table.schema
            if not pa.types.is_floating(column.type) and column.name not in unrepeated
        ],
        column_encoding=dict.fromkeys(rising, "DELTA_BINARY_PACKED"),
        write_page_checksum=True,
    )
    content = sink.getvalue().to_pybytes()
    return Encoded(
        Part(
            file=f"part-{first:09d}-{last:09d}.parquet",
            first=first,
            last=last,
            sha256=hashlib.sha256(content).hexdigest(),
            size=len(content),
            failed=count_failures(table),
        ),
        content,
    )


def put_part(folder: Path, encoded: Encoded) -> Part:
    """Write a part into `folder` atomically, and return its record. Raise StoreError if the file
    cannot be written.
    """
    write_aside(folder / encoded.part.file, lambda target: target.write_bytes(encoded.content))
    return encoded.part


def count_failures(table: pa.Table) -> dict[str, int]:
    """Return the number of rows of a result table without a valid outcome, by cause."""
    counted = table.column("failed").to_pandas().value_counts().to_dict()
    return {cause: number for cause, number in counted.items() if cause and number}


def part_files(folder: Path) -> list[Path]:
    """Return the paths of the parts in `folder`, by first row, without unfinished files."""
    return sorted(path for path in folder.glob("part-*.parquet") if _NAME.fullmatch(path.name))


def read_part(
    path: Path,
    config_hash: str | None,
    recorded: Part | None = None,
    columns: Sequence[str] | None = None,
) -> pa.Table:
    """Read and check the table of one part, or some of its columns. config_hash: hash of the
    expected campaign; None: any. recorded: record with the expected size and checksum; None: these
    are not checked. Raise StoreError if the file is damaged, has another schema, or is of another
    campaign.
    """
    with _opened(path, config_hash, recorded) as file:
        table = file.read(columns if columns is None else list(columns), use_threads=False)
    first, last = row_range(path)
    if table.num_rows != last - first + 1:
        raise _damaged(path, f"contains {table.num_rows} rows, expected rows {first} to {last}")
    return table


def verify_part(path: Path, config_hash: str, recorded: Part | None) -> Part:
    """Check that a part is complete and belongs to this campaign. Return its record. recorded: the
    expected record; None: the whole file is read. Raise StoreError as `read_part`.
    """
    if recorded is None:
        digest, size = hash_file(path), path.stat().st_size
        failed = count_failures(read_part(path, config_hash))
        first, last = row_range(path)
        return Part(file=path.name, first=first, last=last, sha256=digest, size=size, failed=failed)
    with _opened(path, config_hash, recorded):
        return recorded


@contextlib.contextmanager
def _opened(path: Path, config_hash: str | None, recorded: Part | None) -> Iterator[pq.ParquetFile]:
    """Open the file of a part. Check its size and hash, and that it belongs to this campaign.
    Errors while it is read become StoreError.
    """
    if recorded is not None and path.is_file():
        if (size := path.stat().st_size) != recorded.size:
            why = "the file is truncated or was changed"
            raise _damaged(path, f"has {size} bytes, expected {recorded.size}: {why}")
        if hash_file(path) != recorded.sha256:
            digest = recorded.sha256[:16]
            raise _damaged(path, f"its checksum is not {digest}, so its content was changed")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            metadata = file.schema_arrow.metadata or {}
            version, actual = (
                metadata.get(f"ravenjax.{name}".encode(), b"").decode()
                for name in ("schema_version", "config_hash")
            )
            if not version.isdigit():
                raise ForeignPart(
                    f"{path}: is no ravenjax result, because the file has no schema version"
                )
            require_version(path, int(version))
            if config_hash not in (None, actual):
                raise ForeignPart(
                    f"{path}: belongs to another campaign (config hash {actual[:16]}, expected"
                    f" {config_hash[:16]}). Move it away, or choose another output folder with"
                    " --out."
                )
            yield file
    # ValueError: text in a damaged footer.
    except (pa.ArrowException, OSError, ValueError) as error:
        if not path.is_file():
            raise StoreError(
                f"{path}: is missing. All other files are unchanged: start the same command again, "
                "which computes the missing runs again."
            ) from error
        size = path.stat().st_size
        raise _damaged(
            path, f"is not a readable Parquet file ({size} bytes): {first_line(error)}"
        ) from error


def concatenate_parts(tables: Sequence[pa.Table]) -> "pd.DataFrame":
    """Concatenate tables to one DataFrame with sorted categories, and only those that occur. The
    result does not depend on how the rows are divided into tables.
    """
    frame = pa.concat_tables(tables).unify_dictionaries().to_pandas()
    for name in frame.columns[frame.dtypes == "category"]:
        column = frame[name].cat.remove_unused_categories()
        frame[name] = column.cat.reorder_categories(sorted(column.cat.categories))
    return frame


def missing_rows(done: Iterable[Part], due: Iterable[range], chunk: int = 2**62) -> Iterator[range]:
    """Yield the rows of `due` (disjoint ranges in order) that no finished part contains. Ranges are
    divided at multiples of `chunk`, so that the same rows always give the same files.
    """
    held = sorted((part.rows for part in done), key=lambda rows: rows.start)
    for rows in due:
        row = rows.start
        # The empty last block marks the end.
        blocks = [*(block for block in held if block.stop > row), range(rows.stop, rows.stop)]
        for block in blocks:
            # Rows until the next finished block, or until the end, are missing.
            until = min(block.start, rows.stop)
            while row < until:
                next_multiple = row - row % chunk + chunk
                stop = min(until, next_multiple)
                yield range(row, stop)
                row = stop
            row = max(row, block.stop)


def without_overlaps(
    found: Sequence[Part], trusted: Collection[str] = ()
) -> tuple[list[Part], list[Part]]:
    """Return (parts whose rows are disjoint, parts that share rows with one of these). trusted:
    names of files that are kept rather than others.
    """
    disjoint: list[Part] = []
    overlapping: list[Part] = []
    for part in sorted(found, key=lambda part: (part.file not in trusted, part.first, part.last)):
        position = bisect.bisect(disjoint, part.first, key=lambda other: other.first)
        # A part that shares rows with some of `disjoint` also shares rows with a neighbour.
        near = disjoint[max(0, position - 1) : position + 1]
        if any(other.first <= part.last and part.first <= other.last for other in near):
            overlapping.append(part)
        else:
            disjoint.insert(position, part)
    return disjoint, overlapping


def row_range(path: Path) -> tuple[int, int]:
    """Return first and last row of a part, by its name. Raises StoreError for other names."""
    match = _NAME.fullmatch(path.name)
    if match is None:
        raise StoreError(
            f"{path}: expected a name like part-000000000-000000255.parquet (first and last row)"
        )
    return int(match[1]), int(match[2])


def require_version(path: Path, version: int) -> None:
    """Raise StoreError if `version`, which `path` states, is not this program's schema version."""
    if version != schema.VERSION:
        raise ForeignPart(
            f"{path}: has schema version {version}, but this ravenjax reads {schema.VERSION}. Read"
            " the file with the version of ravenjax that wrote it (see manifest.json), or upgrade"
            " ravenjax."
        )


def _damaged(path: Path, what: str) -> StoreError:
    return StoreError(
        f"{path}: {what}. All other files are unchanged: start the same command again, which moves"
        " this file away and computes only its runs again."
    )


def first_line(error: BaseException) -> str:
    """Return the first line of an error's message, or its class if it has none."""
    return (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
