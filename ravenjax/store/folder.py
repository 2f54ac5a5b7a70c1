"""A campaign's result folder: manifest.json beside parts/. Checked before any work, resumed after any interruption."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ravenjax.store import manifest as manifests
from ravenjax.store import parts
from ravenjax.store.files import StoreError, require_writable
from ravenjax.store.manifest import Manifest

PARTS = "parts"


@dataclass
class ResultFolder:
    """An open result folder. Only `open` makes one; it is then safe to add parts."""

    path: Path
    manifest: Manifest

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
        found = [_finished(file, recorded.get(file.name), wanted.config_hash) for file in parts.files(path / PARTS)]
        parts.require_disjoint(path / PARTS, found)
        folder = ResultFolder(path, kept.model_copy(update={"parts": tuple(found)}))
        manifests.write(path, folder.manifest)
        return folder

    @property
    def done(self) -> int:
        """How many rows are finished."""
        return self.manifest.done

    def missing(self, chunk: int) -> Iterator[range]:
        """Row ranges still to compute, each of at most `chunk` rows."""
        return parts.gaps(self.manifest.parts, self.manifest.runs, chunk)

    def add(self, frame: pd.DataFrame) -> None:
        """Store finished rows, consecutive by `index`, as one part."""
        part = parts.write(self.path / PARTS, frame, self.manifest.shape, self.manifest.config_hash)
        self.manifest = self.manifest.model_copy(update={"parts": (*self.manifest.parts, part)})
        manifests.write(self.path, self.manifest)

    def close(self, compile_s: float, run_s: float, rows: int) -> None:
        """Record the times of this start (s) and the rows it computed; the finish time once no row is missing."""
        if rows:
            rate = rows / run_s if run_s else None
            self.manifest = self.manifest.model_copy(
                update={"compile_s": compile_s, "run_s": run_s, "runs_per_s": rate}
            )
        if self.manifest.finished is None and self.done == self.manifest.runs:
            self.manifest = self.manifest.model_copy(update={"finished": manifests.now()})
        manifests.write(self.path, self.manifest)


def read_all(path: str | Path) -> pd.DataFrame:
    """Every finished row of a result folder, ordered by `index`, each part checked against the manifest.

    Raises StoreError where the folder holds no result or a part is missing or damaged.
    """
    path = Path(path)
    manifest = manifests.read(path)
    if not manifest.parts:
        raise StoreError(f"{path}: holds no finished part yet; start or resume it with `ravenjax run`")
    parts.require_disjoint(path / PARTS, manifest.parts)
    return parts.concatenate([parts.read(path / PARTS / p.file, manifest.config_hash, p) for p in manifest.parts])


def _finished(file: Path, recorded: parts.Part | None, config_hash: str) -> parts.Part:
    """Record of a whole part; one that was renamed but not yet recorded when the power went is taken over."""
    if recorded is None:
        return parts.inspect(file, config_hash)
    parts.read(file, config_hash, recorded)
    return recorded


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
