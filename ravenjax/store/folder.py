"""Creates, opens and extends the result folder of a campaign: manifest.json and parts/.

The folder is checked before any run is computed. A campaign can be resumed after any interruption.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa

from ravenjax import threads
from ravenjax.errors import StoreError, list_lines
from ravenjax.store import manifest as manifests
from ravenjax.store import parts, schema
from ravenjax.store.files import disk_errors, path_inside, require_writable
from ravenjax.store.manifest import Manifest

if TYPE_CHECKING:
    import pandas as pd

Measured = TypeVar("Measured")

PARTS, SET_ASIDE = "parts", "set-aside"
"""Folders of valid files, and of damaged or foreign files.

Other programs may read all files of the first folder, so it contains only valid files.
"""
READERS = max(4, min(16, len(os.sched_getaffinity(0))))
"""Number of files that are read and hashed in parallel."""


class ResultFolder:
    """An open result folder, from `open`. Several threads may add parts (Parquet files)."""

    def __init__(self, path: Path, manifest: Manifest, notes: tuple[str, ...] = ()):
        self.path, self.notes = path, notes
        self._manifest, self._parts = manifest, list(manifest.parts)
        self._lock = threading.Lock()

    @property
    def manifest(self) -> Manifest:
        """The current manifest of the folder."""
        parts_in_order = tuple(sorted(self._parts, key=lambda part: part.first))
        return self._manifest.model_copy(update={"parts": parts_in_order})

    @staticmethod
    def open(path: Path, wanted: Manifest) -> "ResultFolder":
        """Start or resume the campaign `wanted` in the folder `path`, which must be locked.

        Complete files of the same campaign are kept. Files that are damaged, of another campaign or
        overlap another file are moved to `SET_ASIDE`, with a note. Raise StoreError, before any
        change, if the folder cannot be written to or contains another campaign.
        """
        require_writable(path_inside(path, PARTS))
        there = parts.part_files(path / PARTS)
        # A folder without results may be used for another campaign.
        record, resumes = wanted, bool(there) and (path / manifests.FILE).exists()
        if resumes:
            record = manifests.read_manifest(path)
            if differences := record.differences(wanted):
                raise StoreError(
                    f"{path}: contains {record.done} of {record.runs} runs of campaign"
                    f" {record.campaign!r}, which differs from the campaign you are starting:\n"
                    f"{list_lines(differences)}\nNothing was changed. To keep these results, choose"
                    " another --out. To replace them, delete the folder first: rm -r"
                    f" {path}"
                )
            rows = manifests.join_ranges(record.rows, wanted.rows)
            resumed = {"command": wanted.command, "rows": rows, "starts": record.starts + 1}
            record = record.model_copy(update=resumed)
        known = {part.file: part for part in record.parts}
        finished = threads.map_in_threads(
            lambda file: _finished(file, known.get(file.name), wanted.config_hash), there, READERS
        )
        # Without a manifest, these files may be the only copy of another campaign's results.
        if not resumes:
            for what in finished:
                if isinstance(what, parts.ForeignPart):
                    raise what
        read = [part for part in finished if isinstance(part, parts.Part)]
        whole, over = parts.without_overlaps(read, known)
        useless = {
            file.name: str(why)
            for file, why in zip(there, finished, strict=True)
            if isinstance(why, StoreError)
        }
        useless |= {
            part.file: f"{path / PARTS / part.file}: contains runs that another file contains, too"
            for part in over
        }
        notes = tuple(set_aside(path, name, why) for name, why in useless.items())
        for torn in (path / PARTS).glob(".part-*.tmp"):
            torn.unlink(missing_ok=True)
        record = record.model_copy(update={"parts": tuple(whole)})
        folder = ResultFolder(path, record, notes)
        # The campaign is not finished if a file was lost, or if more runs are wanted now.
        if not folder.complete:
            folder._manifest = record.model_copy(update={"finished": None})
        manifests.write_manifest(path, folder.manifest)
        return folder

    @property
    def complete(self) -> bool:
        """Whether all wanted rows are stored."""
        return next(self.missing(self._manifest.runs), None) is None

    def missing(self, chunk: int) -> Iterator[range]:
        """Yield the row ranges that are still to be computed, divided at multiples of `chunk`."""
        return parts.missing_rows(self._parts, self._manifest.wanted, chunk)

    def add(self, rows: schema.Columns) -> None:
        """Store finished rows, consecutive by `index`, as one part."""
        self.put(parts.encode_part(rows, self._manifest.shape, self._manifest.config_hash))

    def put(self, encoded: parts.Encoded) -> None:
        """Store a finished part."""
        part = parts.put_part(self.path / PARTS, encoded)
        with self._lock:
            manifests.record_part(self.path, part)
            self._parts.append(part)

    def close(self, compile_s: float, run_s: float, rows: int, notes: Sequence[str] = ()) -> None:
        """Write into the manifest the compile time and run time (s) since the last start, the runs
        per second, and `notes` for the user. rows: number of rows computed since the last start; if
        0, only the notes are written. If all wanted rows are stored, also write the finish time.
        """
        notices = tuple(dict.fromkeys((*self._manifest.notices, *notes)))
        update: dict[str, Any] = {"notices": notices}
        if rows:
            rate = rows / run_s if run_s else None
            update |= {"compile_s": compile_s, "run_s": run_s, "runs_per_s": rate}
        if self._manifest.finished is None and self.complete:
            update["finished"] = manifests.utc_now()
        self._manifest = self._manifest.model_copy(update=update)
        manifests.write_manifest(self.path, self.manifest)


def read_complete_manifest(path: Path) -> Manifest:
    """Return the manifest of a folder with results. Raise StoreError if the folder has no results,
    or lacks files that the manifest lists.
    """
    record = manifests.read_manifest(path)
    if not record.parts:
        raise StoreError(f"{path}: contains no results yet; start or resume it with `ravenjax run`")
    _, overlapping = parts.without_overlaps(record.parts)
    if overlapping:
        raise StoreError(
            f"{path / PARTS / overlapping[0].file}: contains runs that another file contains, too."
            " Start the same `ravenjax run` again, which moves one of the files away."
        )
    if record.finished is not None and record.done < record.due:
        raise StoreError(
            f"{path / manifests.PARTS_FILE}: the listed files contain {record.done} runs, but"
            f" {record.due} were finished. Start the same `ravenjax run` again: it keeps complete"
            " files and computes missing runs."
        )
    return record


def read_all(path: str | Path, columns: Sequence[str] | None = None) -> "pd.DataFrame":
    """Return all finished rows of a result folder, ordered by `index`. Each file is checked.
    columns: columns to read; None: all. Raise StoreError if the folder has no results, a file is
    missing or damaged, or the table has no such column.
    """
    return parts.concatenate_parts(read_parts(Path(path), columns, lambda table: table))


def read_parts(
    path: Path, columns: Sequence[str] | None, measure: Callable[[pa.Table], Measured]
) -> list[Measured]:
    """Apply `measure` to the table of each file, with these columns. Return the results in order.
    Raise StoreError as `read_all`.
    """
    record = read_complete_manifest(path)
    schema.require_columns(record.shape, columns or ())

    def measured(part: parts.Part) -> Measured:
        return measure(parts.read_part(path / PARTS / part.file, record.config_hash, part, columns))

    in_order = sorted(record.parts, key=lambda part: part.first)
    return threads.map_in_threads(measured, in_order, READERS)


@dataclass(frozen=True)
class Results:
    """A result table with one row per run, ordered by `index`, and the columns of `schema`."""

    shape: schema.Shape  # which repeated columns the table has
    path: Path  # result folder

    def frame(self, columns: Sequence[str] | None = None) -> "pd.DataFrame":
        """Return the table, or some of its columns. Raises StoreError as `read_all`."""
        return read_all(self.path, columns)

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns, as Arrow. Raises as `read_all`."""
        tables = read_parts(self.path, columns, lambda table: table)
        return pa.concat_tables(tables).unify_dictionaries()


def _finished(file: Path, recorded: parts.Part | None, config_hash: str) -> parts.Part | StoreError:
    """Return the record of a complete file, or the reason why it cannot be used. A complete file
    may lack a record if the power failed before it was recorded.
    """
    # An error of the disk is raised. An error in the file's content is returned.
    with disk_errors(f"{file}: cannot be read", ". Nothing was changed."):
        try:
            return parts.verify_part(file, config_hash, recorded)
        except StoreError as error:
            return error


def set_aside(path: Path, name: str, why: str) -> str:
    """Move the part `name` of a result folder to its folder SET_ASIDE, and overwrite no file there.
    why: the reason, as text. Return a sentence for the user. Raise StoreError if this fails.
    """
    folder = path_inside(path, SET_ASIDE)
    target, number = folder / name, 1
    while target.exists():
        number += 1
        target = folder / f"{name}.{number}"
    with disk_errors(f"{target}: cannot be written", f". {why}"):
        folder.mkdir(exist_ok=True)
        (path / PARTS / name).rename(target)
    return f"a file was moved to {target}, and its runs are computed again: {why}"
