"""The result table of a campaign that has run; nothing is read before it is asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pyarrow as pa

from ravenjax import threads
from ravenjax.store import folder, parts, schema, words

if TYPE_CHECKING:
    import pandas as pd


Measured = TypeVar("Measured")


@dataclass(frozen=True)
class Results:
    """One row a run, ordered by `index`, columns as in `schema`."""

    shape: schema.Shape  # which repeated columns the table has
    path: Path  # result folder

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """The table, or some of its columns. Raises StoreError as `folder.read_all`."""
        return folder.read_all(self.path, columns)

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """The table, or some of its columns, as Arrow. Raises StoreError as `folder.read_all`."""
        schema.require_columns(self.shape, columns or ())
        tables = self._of_parts(lambda table: table, columns)
        return pa.concat_tables(tables).unify_dictionaries()

    def verdicts(self) -> dict[str, int]:
        """How many of the faulty runs have each verdict, most frequent first; "" is that of failed
        runs.

        Counted part by part, so that memory does not grow with the table. Raises StoreError as
        `folder.read_all`.
        """
        sites = [f"fault{slot}_site" for slot in range(self.shape.slots)]

        def count(table: pa.Table) -> dict[str, int]:
            faulty = np.zeros(table.num_rows, bool)
            for site in sites:
                faulty |= ~words.of_arrow(table.column(site)).equal("")
            return words.of_arrow(table.column("verdict"))[faulty].counts()

        counts: Counter[str] = Counter()
        for part in self._of_parts(count, ["verdict", *sites]):
            counts.update(part)
        return {verdict: number for verdict, number in counts.most_common() if number}

    def _of_parts(
        self, measure: Callable[[pa.Table], Measured], columns: Sequence[str] | None
    ) -> list[Measured]:
        """What `measure` makes of the columns of each part, by the first row; None: of all."""
        path = self.path
        record = folder.read_complete_manifest(path)
        return threads.mapped(
            lambda part: measure(
                parts.read(path / folder.PARTS / part.file, record.config_hash, part, columns)
            ),
            sorted(record.parts, key=lambda part: part.first),
            folder.READERS,
        )
