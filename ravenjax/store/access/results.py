"""The result table of a finished campaign. Nothing is read before it is needed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from ravenjax.store import folder, schema

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Results:
    """A result table with one row per run, ordered by `index`, and the columns of `schema`."""

    shape: schema.Shape  # which repeated columns the table has
    path: Path  # result folder

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return the table, or some of its columns. Raises StoreError as `folder.read_all`."""
        return folder.read_all(self.path, columns)

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the table, or some of its columns, as Arrow. Raises StoreError as
        `folder.read_all`.
        """
        tables = folder.read_parts(self.path, columns, lambda table: table)
        return pa.concat_tables(tables).unify_dictionaries()

    def verdicts(self, acted: bool = True) -> dict[str, int]:
        """Return how many of the faulty runs have each verdict, most frequent first; "" means
        failed runs. acted: of runs whose fault changed at least one bit, else of all others.

        Parts are counted one by one, so that memory does not grow with the table. Raises StoreError
        as `folder.read_all`.
        """
        sites = [f"fault{slot}_site" for slot in range(self.shape.slots)]

        def count(table: pa.Table) -> dict[str, int]:
            frame = table.to_pandas()
            counted = (frame["activated"] | (frame["verdict"] == "")) == acted
            faulty = (frame[sites] != "").any(axis=1)
            return frame.loc[faulty & counted, "verdict"].value_counts().to_dict()

        counts: Counter[str] = Counter()
        for part in folder.read_parts(self.path, ["activated", "verdict", *sites], count):
            counts.update(part)
        return {verdict: number for verdict, number in counts.most_common() if number}
