"""What a stop rule sees of a campaign: each group as a stratum of draws, and a few bits of each row
that is finished, so that no look reads a row again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from ravenjax.campaign.faults import design, sampled_order
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.stats.sample_size.sequential import Sequential, Stratum
from ravenjax.store import manifest, parts
from ravenjax.store.access.results import Results
from ravenjax.store.folder import PARTS


class GroupDraws(NamedTuple):
    """The draws of one group in the fault table, as `sampled_order` puts them."""

    first: int  # row of the first
    number: int
    rows: int  # rows of each

    def range(self, taken: int) -> range:
        """Rows of the first `taken` draws."""
        return range(self.first, self.first + taken * self.rows)


def group_draws(config: CampaignConfig) -> tuple[GroupDraws, ...]:
    """Of each group in the order of the table."""
    result, first = [], 0
    for group in config.group:
        rows = design.count(config.model_copy(update={"group": (group,)}))
        each = sampled_order.rows_of_a_draw(config, group)
        result.append(GroupDraws(first, rows // each, each))
        first += rows
    return tuple(result)


def stop_rule(config: CampaignConfig) -> Sequential:
    """The stop rule of a campaign that has one."""
    if (stop := config.stop) is None:
        raise ValueError(f"campaign {config.campaign.name!r} has no [stop] section")
    strata = tuple(
        Stratum(group.name, of.number, bool(group.fault))
        for group, of in zip(config.group, group_draws(config), strict=True)
    )
    return Sequential(
        strata, stop.rates, stop.half_width, stop.looks, stop.confidence, stop.of, stop.allocation
    )


class EventBitmaps:
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

    def counts(
        self, draws: Sequence[GroupDraws], taken: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
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
