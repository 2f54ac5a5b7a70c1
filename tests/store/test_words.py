"""Columns of words."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from ravenjax.store import words


def test_words_that_occur_become_the_categories_in_their_order():
    column = words.column(np.array([3, 1, 3], np.int8), ("a", "b", "c", "d"))
    assert column.tolist() == ["d", "b", "d"] and list(column.categories) == ["b", "d"]


def test_words_are_those_of_pandas_and_of_arrow():
    places = np.array([2, 0, 2, 1], np.int8)
    column = words.column(places, ("", "b", "c", "d"))
    assert column.categorical().tolist() == column.tolist() == ["c", "", "c", "b"]
    assert column.equal("c").tolist() == [True, False, True, False] and not column.equal("d").any()
    assert column.counts() == {"c": 2, "": 1, "b": 1} and next(iter(column.counts())) == "c"
    assert column[1:3].tolist() == ["", "c"] and np.asarray(column).tolist() == column.tolist()
    chunks = pa.chunked_array(
        [words.arrow(column), words.arrow(words.column(places, ("x", "b", "", "d")))]
    )
    assert words.of_arrow(chunks).tolist() == [*column.tolist(), "", "x", "", "b"]
    assert words.of_arrow(chunks[:0]).tolist() == []


@pytest.mark.parametrize(
    "column",
    [
        pd.Series(["dac", None, "mpos", np.nan]),
        pd.Series(["dac", None, "mpos", np.nan], dtype="category"),
        pd.Categorical(["dac", None, "mpos", None], ["x", "", "mpos", "dac"]),
        np.array(["dac", "", "mpos", None], object),
    ],
)
def test_a_missing_word_is_empty(column):
    array = words.arrow(column)
    assert array.type == pa.dictionary(pa.int32(), pa.string())
    assert array.to_pylist() == ["dac", "", "mpos", ""]


def test_numbers_are_no_words():
    with pytest.raises(pa.ArrowException):
        words.arrow(np.array([1, 2]))
