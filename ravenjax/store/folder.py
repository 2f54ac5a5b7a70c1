"""A campaign's result folder: manifest.json beside parts/. Checked before any work, resumed after any interruption."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import pandas as pd

from ravenjax.store import manifest as manifests
from ravenjax.store import parts, schema
from ravenjax.store.files import StoreError, require_writable
from ravenjax.store.manifest import Manifest

PARTS = "parts"
READERS = 4
"""Parts that are read side by side."""

T = TypeVar("T")
R = TypeVar("R")


class ResultFolder:
    """An open result folder. Only `open` makes one; it is then safe to add parts, also from several threads."""

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self.path = path
        self._manifest, self._parts = manifest, list(manifest.parts)
        self._lock = threading.Lock()

    @property
    def manifest(self) -> Manifest:
        """Its record as of now."""
        return self._manifest.model_copy(update={"parts": tuple(sorted(self._parts, key=lambda part: part.first))})

    @staticmethod
    def open(path: Path, wanted: Manifest) -> ResultFolder:
        """Start or resume campaign `wanted` in folder `path`.

        Whole parts of the same campaign are taken over. StoreError, before any work, where the folder cannot be
        written to, holds another campaign, or holds a damaged part.
        """
        require_writable(path / PARTS)
        kept = wanted
        if (path / manifests.FILE).exists():
            kept = manifests.read(path)
            _require_same(path, kept, wanted)
            kept = kept.model_copy(update={"starts": kept.starts + 1})
        recorded = {part.file: part for part in kept.parts}
        there = parts.files(path / PARTS)
        found = _side_by_side(lambda file: _finished(file, recorded.get(file.name), wanted.config_hash), there)
        parts.require_disjoint(path / PARTS, found)
        whole = sum(len(part.rows) for part in found) == kept.runs
        finished = kept.finished if whole else None  # a part that was lost is computed again
        folder = ResultFolder(path, kept.model_copy(update={"parts": tuple(found), "finished": finished}))
        manifests.write(path, folder.manifest)
        return folder

    @property
    def done(self) -> int:
        """How many rows are finished."""
        with self._lock:
            return sum(len(part.rows) for part in self._parts)

    def missing(self, chunk: int) -> Iterator[range]:
        """Row ranges still to compute, each of at most `chunk` rows."""
        return parts.gaps(self._parts, self._manifest.runs, chunk)

    def add(self, rows: schema.Columns) -> None:
        """Store finished rows, consecutive by `index`, as one part."""
        part = parts.write(self.path / PARTS, rows, self._manifest.shape, self._manifest.config_hash)
        with self._lock:
            manifests.record(self.path, part)
            self._parts.append(part)

    def close(self, compile_s: float, run_s: float, rows: int) -> None:
        """Record the times of this start (s) and the rows it computed; the finish time once no row is missing."""
        if rows:
            rate = rows / run_s if run_s else None
            self._manifest = self._manifest.model_copy(
                update={"compile_s": compile_s, "run_s": run_s, "runs_per_s": rate}
            )
        if self._manifest.finished is None and self.done == self._manifest.runs:
            self._manifest = self._manifest.model_copy(update={"finished": manifests.now()})
        manifests.write(self.path, self.manifest)


def read_all(path: str | Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Every finished row of a result folder, ordered by `index`, each part checked against the manifest.

    columns: only these, None for all. Raises StoreError where the folder holds no result, a part is missing or damaged,
    or the table has no such column.
    """
    path = Path(path)
    manifest = manifests.read(path)
    if not manifest.parts:
        raise StoreError(f"{path}: holds no finished part yet; start or resume it with `ravenjax run`")
    if manifest.finished is not None and manifest.done < manifest.runs:
        raise StoreError(
            f"{path / manifests.PARTS_FILE}: names parts of {manifest.done} of the {manifest.runs} finished runs. "
            "Start the same `ravenjax run` again: it takes over whole parts and computes what is missing."
        )
    parts.require_disjoint(path / PARTS, manifest.parts)
    schema.require_columns(manifest.shape, columns or ())
    ordered = sorted(manifest.parts, key=lambda part: part.first)
    return parts.concatenate(
        _side_by_side(lambda part: parts.read(path / PARTS / part.file, manifest.config_hash, part, columns), ordered)
    )


def _finished(file: Path, recorded: parts.Part | None, config_hash: str) -> parts.Part:
    """Record of a whole part; one that was renamed but not yet recorded when the power went is taken over."""
    if recorded is None:
        return parts.inspect(file, config_hash)
    parts.verify(file, config_hash, recorded)
    return recorded


def _side_by_side(work: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """What `work` makes of each item, in order; the first error is raised and what has not begun is left."""
    with ThreadPoolExecutor(READERS) as pool:
        try:
            return list(pool.map(work, items))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _require_same(path: Path, kept: Manifest, wanted: Manifest) -> None:
    differences = kept.differences(wanted)
    if differences:
        lines = "\n".join(f"  {line}" for line in differences[:8])
        more = f"\n  and {len(differences) - 8} more" if len(differences) > 8 else ""
        raise StoreError(
            f"{path}: holds {kept.done} of {kept.runs} runs of campaign {kept.campaign!r}, which differs:\n"
            f"{lines}{more}\nNothing was changed. To keep it, choose another --out; "
            f"to start anew, delete the folder: rm -r {path}"
        )
