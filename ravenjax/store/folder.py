"""Creates, opens and extends the result folder of a campaign: manifest.json and parts/.

The folder is checked before any run is computed. A campaign can be resumed after any interruption.
"""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa

from ravenjax import threads
from ravenjax.errors import StoreError, list_lines
from ravenjax.store import manifest as manifests
from ravenjax.store import parts, schema
from ravenjax.store.files import disk_errors, require_writable
from ravenjax.store.manifest import Manifest

if TYPE_CHECKING:
    import pandas as pd

Measured = TypeVar("Measured")

PARTS, SET_ASIDE = "parts", "set-aside"
"""Folders of valid parts, and of parts that could not be used.

The second is not inside the first, because other tools may read the first as a whole.
"""
READERS = max(4, min(16, len(os.sched_getaffinity(0))))
"""Number of parts that are read in parallel.

Each is hashed, which a core does at half a gigabyte per second or more.
"""


class ResultFolder:
    """An open result folder, made by `open`. Parts may be added from several threads."""

    def __init__(self, path: Path, manifest: Manifest, notes: tuple[str, ...] = ()) -> None:
        self.path, self.notes = path, notes
        self._manifest, self._parts = manifest, list(manifest.parts)
        self._lock = threading.Lock()

    @property
    def manifest(self) -> Manifest:
        """Its current manifest."""
        return self._manifest.model_copy(
            update={"parts": tuple(sorted(self._parts, key=lambda part: part.first))}
        )

    @staticmethod
    def open(path: Path, wanted: Manifest) -> ResultFolder:
        """Start or resume campaign `wanted` in folder `path`, to which nobody else writes (see
        `lock`).

        Complete parts of the same campaign are kept. Parts that are damaged, foreign or overlap
        another are moved to `SET_ASIDE` and noted. Raises StoreError, before any change, if the
        folder cannot be written to or holds another campaign.
        """
        if (path / PARTS).is_symlink():
            raise StoreError(f"{path / PARTS}: is a link; expected a folder inside {path}")
        require_writable(path / PARTS)
        there = parts.part_files(path / PARTS)
        # A start that stored nothing, as of a campaign with a mistake, does not decide the folder.
        record, resumes = wanted, bool(there) and (path / manifests.FILE).exists()
        if resumes:
            record = manifests.read_manifest(path)
            if differences := record.differences(wanted):
                raise StoreError(
                    f"{path}: holds {record.done} of {record.runs} runs of campaign"
                    f" {record.campaign!r}, which differs from the campaign you are starting:\n"
                    f"{list_lines(differences)}\nNothing was changed. To keep these results, choose"
                    " another --out. To replace them, delete the folder first: rm -r"
                    f" {path}"
                )
            record = record.model_copy(
                update={
                    "command": wanted.command,
                    "rows": manifests.join_ranges(record.rows, wanted.rows),
                    "starts": record.starts + 1,
                }
            )
        recorded = {part.file: part for part in record.parts}
        finished = threads.map_in_threads(
            lambda file: _finished(file, recorded.get(file.name), wanted.config_hash),
            there,
            READERS,
        )
        # Foreign parts may then be the only copy of another campaign.
        if not resumes:
            for what in finished:
                if isinstance(what, parts.ForeignPart):
                    raise what
        whole, over = parts.without_overlaps(
            [part for part in finished if isinstance(part, parts.Part)], recorded
        )
        useless = {
            file.name: str(why)
            for file, why in zip(there, finished, strict=True)
            if isinstance(why, StoreError)
        }
        useless |= {
            part.file: f"{path / PARTS / part.file}: holds rows that another part holds, too"
            for part in over
        }
        notes = tuple(set_aside(path, name, why) for name, why in useless.items())
        for torn in (path / PARTS).glob(".part-*.tmp"):
            torn.unlink(missing_ok=True)
        record = record.model_copy(update={"parts": tuple(whole)})
        folder = ResultFolder(path, record, notes)
        # The campaign is not finished if a part was lost, or if more rows are wanted now.
        if not folder.complete:
            folder._manifest = record.model_copy(update={"finished": None})
        manifests.write_manifest(path, folder.manifest)
        return folder

    @property
    def complete(self) -> bool:
        """Whether no row is missing."""
        return next(self.missing(self._manifest.runs), None) is None

    def missing(self, chunk: int) -> Iterator[range]:
        """Yield the row ranges still to compute, cut at the multiples of `chunk`."""
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
        """Record the times of this start (s), the number of rows it computed, and its notes.

        Records the finish time once no row is missing.
        """
        told: dict[str, Any] = {"notices": tuple(dict.fromkeys((*self._manifest.notices, *notes)))}
        if rows:
            rate = rows / run_s if run_s else None
            told |= {"compile_s": compile_s, "run_s": run_s, "runs_per_s": rate}
        if self._manifest.finished is None and self.complete:
            told["finished"] = manifests.utc_now()
        self._manifest = self._manifest.model_copy(update=told)
        manifests.write_manifest(self.path, self.manifest)


def read_complete_manifest(path: Path) -> Manifest:
    """Return the manifest of a folder that holds rows to read.

    Raises StoreError if it holds none, or lacks parts that the manifest names as finished.
    """
    record = manifests.read_manifest(path)
    if not record.parts:
        raise StoreError(
            f"{path}: holds no finished part yet; start or resume it with `ravenjax run`"
        )
    if over := parts.without_overlaps(record.parts)[1]:
        raise StoreError(
            f"{path / PARTS / over[0].file}: holds rows that another part holds, too. "
            "Start the same `ravenjax run` again, which sets one of them aside."
        )
    if record.finished is not None and record.done < record.due:
        raise StoreError(
            f"{path / manifests.PARTS_FILE}: names parts of {record.done} of the {record.due}"
            " finished runs. Start the same `ravenjax run` again: it takes over whole parts and"
            " computes what is missing."
        )
    return record


def read_all(path: str | Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Return every finished row of a result folder, ordered by `index`, with each part checked
    against the manifest.

    columns: only these; None: all. Raises StoreError if the folder holds no result, a part is
    missing or damaged, or the table has no such column.
    """
    return parts.concatenate_parts(read_parts(Path(path), columns, lambda table: table))


def read_parts(
    path: Path, columns: Sequence[str] | None, measure: Callable[[pa.Table], Measured]
) -> list[Measured]:
    """Return `measure` of these columns of each part, by row. Raises as `read_all`."""
    record = read_complete_manifest(path)
    schema.require_columns(record.shape, columns or ())
    return threads.map_in_threads(
        lambda part: measure(
            parts.read_part(path / PARTS / part.file, record.config_hash, part, columns)
        ),
        sorted(record.parts, key=lambda part: part.first),
        READERS,
    )


@dataclass(frozen=True)
class Results:
    """A result table with one row per run, ordered by `index`, and the columns of `schema`."""

    shape: schema.Shape  # which repeated columns the table has
    path: Path  # result folder

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return the table, or some of its columns. Raises StoreError as `read_all`."""
        return read_all(self.path, columns)

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns, as Arrow. Raises as `read_all`."""
        tables = read_parts(self.path, columns, lambda table: table)
        return pa.concat_tables(tables).unify_dictionaries()

    def verdicts(self, acted: bool = True) -> dict[str, int]:
        """Return how many of the faulty runs have each verdict, most frequent first; "" means
        failed runs. acted: of runs whose fault changed at least one bit, else of all others.

        Parts are counted one by one, so that memory does not grow with the table. Raises StoreError
        as `read_all`.
        """
        sites = [f"fault{slot}_site" for slot in range(self.shape.slots)]

        def count(table: pa.Table) -> dict[str, int]:
            frame = table.to_pandas()
            counted = (frame["activated"] | (frame["verdict"] == "")) == acted
            faulty = (frame[sites] != "").any(axis=1)
            return frame.loc[faulty & counted, "verdict"].value_counts().to_dict()

        counts: Counter[str] = Counter()
        for part in read_parts(self.path, ["activated", "verdict", *sites], count):
            counts.update(part)
        return {verdict: number for verdict, number in counts.most_common() if number}


def _finished(file: Path, recorded: parts.Part | None, config_hash: str) -> parts.Part | StoreError:
    """Return the record of a complete part, or the reason why it cannot be used.

    A part that was renamed but not yet recorded when the power failed is complete as well.
    """
    # An error of the disk, not of the file's content, is raised.
    with disk_errors(f"{file}: cannot be read", ". Nothing was changed."):
        try:
            return parts.verify_part(file, config_hash, recorded)
        except StoreError as error:
            return error


def set_aside(path: Path, name: str, why: str) -> str:
    """Move a part aside without overwriting anything. Return a sentence for the user.

    Raises StoreError if the disk refuses.
    """
    place = path / SET_ASIDE
    target, number = place / name, 1
    while target.exists():
        number += 1
        target = place / f"{name}.{number}"
    with disk_errors(f"{target}: cannot be written", f". {why}"):
        place.mkdir(exist_ok=True)
        (path / PARTS / name).rename(target)
    return f"set aside as {target}, to be computed again: {why}"
