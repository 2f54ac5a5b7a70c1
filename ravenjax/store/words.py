"""Stores columns of words compactly, as categories of pandas or Arrow instead of Python strings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

if TYPE_CHECKING:
    import pandas as pd


def word_column(places: np.ndarray, known: Sequence[str]) -> pd.Categorical:
    """Return words from their indices `places` in the list `known`.

    Words that occur become the categories, in the order of `known`.
    """
    import pandas as pd

    codes, categories = pd.factorize(np.array(known, object))
    return pd.Categorical.from_codes(codes[places], categories).remove_unused_categories()


def arrow_words(words: Any) -> pa.DictionaryArray:
    """Return words [rows], categorical or not, as a dictionary-encoded Arrow array.

    A missing word becomes "".
    """
    import pandas as pd

    column = pd.Categorical(words)
    if (column.codes < 0).any():
        column = column.add_categories([""] if "" not in column.categories else [])
        column = column.fillna("")
    if not all(isinstance(word, str) for word in column.categories):
        raise pa.ArrowTypeError(f"got {column.categories[0]!r}, expected words")
    words = pa.array(column.categories, pa.string())
    return pa.DictionaryArray.from_arrays(column.codes.astype(np.int32), words)
