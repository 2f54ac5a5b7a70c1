"""The result table of a campaign that has run: in its folder, or in memory; nothing is read before it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa

from ravenjax.store import folder, parts, schema


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
        return parts.concatenate([table if columns is None else table.select(columns) for table in self.tables])

    def verdicts(self) -> dict[str, int]:
        """How many of the faulty runs have each verdict, most frequent first; "" is that of failed runs."""
        sites = [f"fault{slot}_site" for slot in range(self.shape.slots)]
        frame = self.frame(["verdict", *sites])
        faulty = (frame[sites] != "").any(axis=1)
        return {
            str(verdict): int(runs) for verdict, runs in frame.loc[faulty, "verdict"].value_counts().items() if runs
        }
