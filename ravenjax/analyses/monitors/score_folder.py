"""Scores of operations on disk: Parquet parts of some operators each, added to until there are
enough.

Each part is written aside and renamed, so whatever ends a start, finished parts stay and the next
one goes on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.analyses.monitors.operations import OperatorScores
from ravenjax.errors import StoreError, UserError
from ravenjax.store import files

FOLDER, DESIGN, PARTS = "operations", "design.json", "parts"
OPERATORS = 32
"""Of a part."""


class Peaks(NamedTuple):
    """Maxima of operations, arrays of one length."""

    unit: np.ndarray  # int64, number of the operator
    hours: np.ndarray  # in which detectors looked
    peak: np.ndarray  # float32 [operations, detectors]; NaN: a number was not finite

    def taken_from(self, mask: np.ndarray) -> Peaks:
        """Those operations."""
        return Peaks(*(values[mask] for values in self))


class ScoreFolder:
    """The operations of one design."""

    def __init__(self, folder: Path, design: dict[str, Any]) -> None:
        """Begin, or go on with, `folder`. design: as JSON; UserError where its operations are of
        another.
        """
        self.path = folder
        files.require_writable(folder)
        self._record(design)
        (folder / PARTS).mkdir(exist_ok=True)

    def _record(self, design: dict[str, Any]) -> None:
        path, text = self.path / DESIGN, json.dumps(design, indent=1) + "\n"
        if path.exists():
            before = read_design(self.path)
            if other := sorted(
                key for key in {*before, *design} if before.get(key) != json.loads(text).get(key)
            ):
                raise UserError(
                    f"{self.path} holds operations of another {' and '.join(other)}: give another"
                    " folder, or the same campaign, signals and options to go on"
                )
        else:
            files.write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"))

    def missing(self, units: int) -> Iterator[range]:
        """Operators below `units` of which no part is there, a part at a time."""
        for first in range(0, units, OPERATORS):
            wanted = range(first, min(first + OPERATORS, units))
            if self._part(first).exists():
                wanted = range(first + _operators(self._part(first)), wanted.stop)
            if wanted:
                yield wanted

    def put(self, some: Sequence[OperatorScores]) -> None:
        """Add operators, all of one part, in order; not those that another process has added
        meanwhile.
        """
        path = self._part(some[0].operator // OPERATORS * OPERATORS)
        before = [pq.read_table(path)] if path.exists() else []
        there = {number for table in before for number in table.column("operator").to_pylist()}
        table = pa.concat_tables(
            [*before, *(_table(one) for one in some if one.operator not in there)]
        )
        files.write_aside(path, lambda aside: pq.write_table(table, aside, compression="zstd"))

    def read(self, units: int) -> Peaks:
        """The operations of operators below `units`."""
        return read(self.path, units)

    def _part(self, first: int) -> Path:
        return self.path / PARTS / f"operators-{first:07d}.parquet"


def filled(
    folder: ScoreFolder, units: int, compute: Callable[[range], Iterator[OperatorScores]]
) -> Peaks:
    """The operations of operators below `units`, those that are missing computed first."""
    for wanted in folder.missing(units):
        folder.put(list(compute(wanted)))
    return folder.read(units)


def read_design(folder: Path) -> dict[str, Any]:
    """What the operations of a folder are of. Raises StoreError."""
    try:
        content = files.parsed((folder / DESIGN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StoreError(f"{folder / DESIGN}: cannot be read ({error})") from None
    if not isinstance(content, dict):
        raise StoreError(f"{folder / DESIGN}: is no design of operations")
    return content


def read(folder: Path, units: int | None = None) -> Peaks:
    """The operations in a folder, of operators below `units` if given. Raises StoreError where a
    part is unreadable.
    """
    paths = sorted((folder / PARTS).glob("operators-*.parquet"))
    if not paths:
        raise StoreError(f"{folder}: holds no operations yet")
    try:
        table = pa.concat_tables([pq.read_table(path) for path in paths])
    except (OSError, pa.ArrowException) as error:
        raise StoreError(
            f"{folder}: a part cannot be read ({error}); remove it, and the same command goes on"
        ) from None
    peak = table.column("score").combine_chunks().flatten().to_numpy(zero_copy_only=False)
    out = Peaks(
        table.column("operator").to_numpy(),
        table.column("hours").to_numpy(),
        peak.reshape(table.num_rows, -1),
    )
    return out if units is None else out.taken_from(out.unit < units)


def digest(folder: Path) -> str:
    """sha256 over the parts in order."""
    whole = hashlib.sha256()
    for path in sorted((folder / PARTS).glob("operators-*.parquet")):
        whole.update(bytes.fromhex(files.sha256(path)))
    return whole.hexdigest()


def _operators(path: Path) -> int:
    return len(np.unique(pq.read_table(path, columns=["operator"]).column(0).to_numpy()))


def _table(one: OperatorScores) -> pa.Table:
    rows, detectors = one.score.shape
    score = pa.FixedSizeListArray.from_arrays(pa.array(one.score.ravel(), pa.float32()), detectors)
    columns = {
        "operator": pa.array(np.full(rows, one.operator, np.int64)),
        "motion": pa.array([one.motion] * rows).dictionary_encode(),
        "seed": pa.array(np.full(rows, one.seed, np.int64)),
        "hours": pa.array(one.hours, pa.float64()),
        "score": score,
    }
    return pa.table(columns)
