"""Columns of words: a small number a row, and the words that the numbers stand for. No row is
ever a Python string.

Beside them, NumPy's arrays as Arrow's by their memory: `pyarrow.array` asks pandas whether what it
gets is one of its own, and imports it for that, which takes a third of a second.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa


@dataclasses.dataclass(frozen=True, eq=False)
class WordColumn:
    """Words [rows] by their places among `categories`, as pandas' Categorical has them."""

    codes: np.ndarray  # whole numbers from 0, [rows]
    categories: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def __getitem__(self, rows: slice | np.ndarray) -> WordColumn:
        """The words of these rows."""
        return WordColumn(self.codes[rows], self.categories)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.categories, object)[self.codes]

    @property
    def dtype(self) -> str:
        """As a schema names it."""
        return "category"

    def equal(self, word: str) -> np.ndarray:
        """Which rows have this word, bool [rows]."""
        if word not in self.categories:
            return np.zeros(len(self), bool)
        return self.codes == self.categories.index(word)

    def tolist(self) -> list[str]:
        """The word of each row."""
        return [self.categories[code] for code in self.codes.tolist()]

    def counts(self) -> dict[str, int]:
        """How many rows have each word, the most frequent first."""
        numbers = np.bincount(self.codes, minlength=len(self.categories)).tolist()
        return dict(sorted(zip(self.categories, numbers, strict=True), key=lambda one: -one[1]))

    def categorical(self) -> Any:
        """The same as a Categorical of pandas."""
        import pandas as pd  # a fifth of a second that only who asks for it should pay

        return pd.Categorical.from_codes(
            self.codes, pd.Index(self.categories, dtype="str"), validate=False
        )  # pyright: ignore[reportArgumentType]


def column(places: np.ndarray, known: Sequence[str]) -> WordColumn:
    """Words by their places in `known`, integers from 0; those that occur become the categories,
    in that order.
    """
    code, categories = numbered(known, np.bincount(places, minlength=len(known)) > 0)
    return WordColumn(code[places], categories)


def numbered(known: Sequence[str], occurs: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Codes of the words of `known` that occur, bool [known], by their places in `known`; and
    those words.
    """
    code = (np.cumsum(occurs) - 1).astype(np.min_scalar_type(-len(known)))
    return code, tuple(word for word, there in zip(known, occurs, strict=True) if there)


def arrow(words: Any) -> pa.DictionaryArray:
    """Words [rows], categorical or not, as a dictionary-encoded Arrow array; a missing word is
    "".
    """
    if not isinstance(words, WordColumn):
        words = _categorised(words)
    codes = arrow_numbers(words.codes.astype(np.int32))
    if not all(isinstance(word, str) for word in words.categories):
        raise pa.ArrowTypeError(f"got {words.categories[0]!r}, expected words")
    return pa.DictionaryArray.from_arrays(codes, arrow_texts(words.categories))


def of_arrow(column: pa.ChunkedArray) -> WordColumn:
    """A dictionary-encoded Arrow column [rows], without missing words."""
    chunks = column.unify_dictionaries().chunks
    if not chunks:
        return WordColumn(np.zeros(0, np.int32), ())
    codes = numpy_numbers([chunk.indices for chunk in chunks])
    return WordColumn(codes, tuple(chunks[0].dictionary.to_pylist()))


def _categorised(words: Any) -> WordColumn:
    import pandas as pd  # whoever has such words has imported it

    values = pd.Categorical(words)
    categories = list(values.categories)
    codes = values.codes.astype(np.int32)
    if (codes < 0).any():
        categories = categories if "" in categories else [*categories, ""]
        codes = np.where(codes < 0, categories.index(""), codes).astype(np.int32)
    return WordColumn(codes, tuple(categories))


_PLAIN = "iuf"
"""Kinds of types whose numbers stand in Arrow as they do in NumPy."""


def arrow_numbers(values: np.ndarray) -> pa.Array | None:
    """Numbers or truth values [rows]; None where their memory is not Arrow's."""
    if values.ndim != 1 or not values.dtype.isnative:
        return None
    if values.dtype.kind == "b":
        packed = np.packbits(values, bitorder="little")
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, pa.py_buffer(packed)])
    if values.dtype.kind not in _PLAIN or values.dtype.itemsize > 8:
        return None
    kind = pa.type_for_alias(values.dtype.name)
    return pa.Array.from_buffers(
        kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))]
    )


def numpy_numbers(arrays: Sequence[pa.Array]) -> np.ndarray:
    """The numbers [rows] of some arrays of one type, one after the other, of which none is
    missing.
    """
    kind = np.dtype(arrays[0].type.to_pandas_dtype())
    return np.concatenate(
        [np.frombuffer(a.buffers()[1], kind, len(a), a.offset * kind.itemsize) for a in arrays]
    )


def arrow_texts(values: Sequence[str]) -> pa.StringArray:
    """Words [rows]."""
    encoded = [value.encode() for value in values]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(encoded), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded))
    )
