"""Columns of words: a small number a row, and the words that the numbers stand for. No row is ever a Python string."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa


def column(places: np.ndarray, known: Sequence[str]) -> pd.Categorical:
    """Words by their places in `known`, integers from 0; those that occur become the categories, in that order."""
    occurs = np.bincount(places, minlength=len(known)) > 0
    code = (np.cumsum(occurs) - 1).astype(np.min_scalar_type(-len(known)))
    words = [word for word, there in zip(known, occurs, strict=True) if there]
    return pd.Categorical.from_codes(code[places], pd.Index(words, dtype="str"), validate=False)


def arrow(words: Any) -> pa.DictionaryArray:
    """Words [rows], categorical or not, as a dictionary-encoded Arrow array; a missing word is ""."""
    values = pd.Categorical(words)
    categories = list(values.categories)
    codes = values.codes.astype(np.int32)
    if (codes < 0).any():
        categories = categories if "" in categories else [*categories, ""]
        codes = np.where(codes < 0, categories.index(""), codes).astype(np.int32)
    return pa.DictionaryArray.from_arrays(pa.array(codes), pa.array(categories, pa.string()))
