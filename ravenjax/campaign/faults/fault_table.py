"""The fault table: one row a run, every input of the run in columns of NumPy's."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

Column: TypeAlias = "np.ndarray | pd.Categorical"
"""Numbers or words, [rows]."""


@dataclasses.dataclass(frozen=True, eq=False)
class FaultTable:
    """Columns by name, as in `ravenjax.store.schema`, all of the same rows."""

    columns: Mapping[str, Column]

    @staticmethod
    def of(frame: pd.DataFrame) -> FaultTable:
        """The table of a DataFrame that `frame` made, or of some of its rows."""
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
        """A column of numbers."""
        values = self.columns[name]
        assert isinstance(values, np.ndarray), name
        return values

    def words(self, name: str) -> pd.Categorical:
        """A column of words."""
        values = self.columns[name]
        assert not isinstance(values, np.ndarray), name
        return values

    def take(self, rows: slice | np.ndarray) -> FaultTable:
        """These rows, in this order."""
        return FaultTable({name: values[rows] for name, values in self.columns.items()})

    def records(self) -> list[dict[str, Any]]:
        """Each row by columns, in plain values."""
        columns = [values.tolist() for values in self.columns.values()]
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*columns, strict=True)]

    def replaced(self, **columns: Column) -> FaultTable:
        """The table with other columns in their places."""
        return FaultTable({**self.columns, **columns})

    def frame(self) -> pd.DataFrame:
        """As a DataFrame; words are categorical."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns), copy=False)
