"""The fault table: one row per run, every input of the run in NumPy columns."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

Column: TypeAlias = "np.ndarray | pd.Categorical"
"""A column of numbers or of words, [rows]."""


@dataclasses.dataclass(frozen=True, eq=False)
class FaultTable:
    """Columns of equal length by name, as in `ravenjax.store.schema`."""

    columns: Mapping[str, Column]

    @staticmethod
    def of(frame: pd.DataFrame) -> FaultTable:
        """Make the table from a DataFrame that `frame` made, or from some of its rows."""
        columns: dict[str, Any] = {
            str(name): values.array if values.dtype == "category" else values.to_numpy()
            for name, values in frame.items()
        }
        return FaultTable(columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def numbers(self, name: str) -> np.ndarray:
        """Return a column of numbers."""
        values = self.columns[name]
        assert isinstance(values, np.ndarray), name
        return values

    def words(self, name: str) -> pd.Categorical:
        """Return a column of words."""
        values = self.columns[name]
        assert not isinstance(values, np.ndarray), name
        return values

    def take(self, rows: slice | np.ndarray) -> FaultTable:
        """Return the table of these rows, in this order."""
        return FaultTable({name: values[rows] for name, values in self.columns.items()})

    def records(self) -> list[dict[str, Any]]:
        """Return each row as a dict from column name to plain Python value."""
        columns = [values.tolist() for values in self.columns.values()]
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*columns, strict=True)]

    def replaced(self, **columns: Column) -> FaultTable:
        """Return a copy in which these columns are replaced."""
        return FaultTable({**self.columns, **columns})

    def frame(self) -> pd.DataFrame:
        """Return the table as a DataFrame, with categorical columns of words."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns), copy=False)
