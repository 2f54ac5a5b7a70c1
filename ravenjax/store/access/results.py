"""The result table of a campaign that has run: in its folder, or in memory; nothing is read
before it is asked for.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ravenjax.store import folder, parts, schema, words

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Results:
    """One row a run, ordered by `index`, columns as in `schema`."""

    shape: schema.Shape  # which repeated columns the table has
    path: Path | None  # result folder, None where `tables` hold it
    tables: Sequence[pa.Table] = ()  # of the parts, in order

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """The table, or some of its columns. Raises StoreError as `folder.read_all`."""
        if self.path is not None:
            return folder.read_all(self.path, columns)
        schema.require_columns(self.shape, columns or ())
        return parts.concatenate(
            [table if columns is None else table.select(columns) for table in self.tables]
        )

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """The table, or some of its columns, as Arrow. Raises StoreError as `folder.read_all`."""
        schema.require_columns(self.shape, columns or ())
        names = None if columns is None else list(columns)
        return pa.concat_tables(self._parts(names)).unify_dictionaries()

    def verdicts(self) -> dict[str, int]:
        """How many of the faulty runs have each verdict, most frequent first; "" is that of failed
        runs.

        Read part by part, so that memory does not grow with the table. Raises StoreError as
        `folder.read_all`.
        """
        sites = [f"fault{slot}_site" for slot in range(self.shape.slots)]
        counts: Counter[str] = Counter()
        for table in self._parts(["verdict", *sites]):
            faulty = np.zeros(table.num_rows, bool)
            for site in sites:
                faulty |= ~words.of_arrow(table.column(site)).equal("")
            counts.update(words.of_arrow(table.column("verdict"))[faulty].counts())
        return {verdict: number for verdict, number in counts.most_common() if number}

    def _parts(self, columns: list[str] | None) -> Iterator[pa.Table]:
        """Columns of each part, by the first row; None: all of them."""
        if self.path is None:
            yield from (
                table if columns is None else table.select(columns) for table in self.tables
            )
            return
        record = folder.read_complete_manifest(self.path)
        due = deque(sorted(record.parts, key=lambda part: part.first))
        coming: deque[Future[pa.Table]] = deque()
        with ThreadPoolExecutor(folder.READERS) as pool:
            while due or coming:
                while due and len(coming) < folder.READERS:
                    part, place = due.popleft(), self.path / folder.PARTS
                    coming.append(
                        pool.submit(
                            parts.read, place / part.file, record.config_hash, part, columns
                        )
                    )
                yield coming.popleft().result()
