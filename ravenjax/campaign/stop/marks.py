"""What a stop rule keeps of the rows that are finished: a few bits of each, so that no look
reads a row again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from ravenjax.campaign.stop.strata import Draws
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.store import manifest, parts
from ravenjax.store.access.results import Results
from ravenjax.store.folder import PARTS


class Marks:
    """Which of a table's rows have an outcome, and of which rates each is a case."""

    def __init__(self, rows: int, rates: Sequence[str], rules: Rules) -> None:
        self.rates, self.rules = tuple(rates), rules
        self.seen, self.valid = np.zeros(rows, bool), np.zeros(rows, bool)
        self.cases = np.zeros((len(self.rates), rows), bool)
        self._columns = ["index", *events.columns(self.rates, rules)]
        self._read: set[str] = set()

    def take(self, results: Results) -> None:
        """Mark the rows of `results` that are not marked yet. Raises StoreError for parts that
        cannot be read.
        """
        tables = results.tables if results.path is None else self._new(results.path)
        for table in tables:
            self._mark(table)

    def cover(self, rows: Sequence[range]) -> bool:
        """Whether all these rows are marked."""
        return all(self.seen[span.start : span.stop].all() for span in rows)

    def counts(self, draws: Sequence[Draws], taken: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(cases [rates, groups], valid draws [groups]) of the first taken[group] draws of each
        group.

        A draw is what its first row with an outcome says: of repeats the first, of crossed variants
        the first.
        """
        k, n = np.zeros((len(self.rates), len(draws)), np.int64), np.zeros(len(draws), np.int64)
        for g, (of, number) in enumerate(zip(draws, taken.tolist(), strict=True)):
            rows = of.range(number)
            valid = self.valid[rows.start : rows.stop].reshape(number, of.rows)
            valid_draws = np.flatnonzero(valid.any(axis=1))
            first = rows.start + valid_draws * of.rows + valid[valid_draws].argmax(axis=1)
            k[:, g], n[g] = self.cases[:, first].sum(axis=1), len(valid_draws)
        return k, n

    def _new(self, folder: Path) -> Iterator[pa.Table]:
        record = manifest.read(folder)
        columns = self._columns
        for part in record.parts:
            if part.file not in self._read:
                self._read.add(part.file)
                yield parts.read(folder / PARTS / part.file, record.config_hash, part, columns)

    def _mark(self, table: pa.Table) -> None:
        index = table.column("index").to_numpy()
        valid, *cases = events.happened(table.select(self._columns), self.rates, self.rules)
        self.seen[index], self.valid[index] = True, valid
        self.cases[:, index] = cases
