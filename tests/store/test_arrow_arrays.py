"""Arrow arrays by NumPy's memory are those that Arrow makes of the same values."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from ravenjax.store import arrow_arrays


@pytest.mark.parametrize(
    "dtype", ["bool", "int8", "int32", "int64", "uint32", "uint64", "float32", "float64"]
)
@pytest.mark.parametrize("rows", [0, 1, 13])
def test_numbers(dtype, rows):
    values = (np.arange(-3, 30)[: 2 * rows : 2] * 1.25).astype(np.int64).astype(dtype)
    if values.dtype.kind == "f":
        values[:1] = np.nan
    made, wanted = arrow_arrays.numbers(values), pa.array(values, from_pandas=False)
    made.validate(full=True)
    assert made.type == wanted.type and made.null_count == 0
    np.testing.assert_array_equal(
        made.to_numpy(zero_copy_only=False), wanted.to_numpy(zero_copy_only=False)
    )


def test_numbers_side_by_side_are_taken_together():
    assert arrow_arrays.numbers(np.arange(10, dtype=np.int32)[::3]).to_pylist() == [0, 3, 6, 9]


@pytest.mark.parametrize(
    "values",
    [
        np.array(["a"]),
        np.array([1, None]),
        np.ones((2, 2)),
        np.ones(2, ">f4"),
        np.array(["2020"], "M8[D]"),
    ],
)
def test_other_values_are_left_to_arrow(values):
    assert arrow_arrays.numbers(values) is None


@pytest.mark.parametrize("dtype", ["int8", "int32", "uint64", "float32"])
def test_numbers_come_back(dtype):
    arrays = [pa.array(np.arange(n).astype(dtype)) for n in (5, 0, 7)]
    arrays[2] = arrays[2][3:]
    read = arrow_arrays.plain(arrays)
    assert read.dtype == dtype and read.tolist() == [0, 1, 2, 3, 4, 3, 4, 5, 6]


@pytest.mark.parametrize("words", [(), ("",), ("gold", "", "wrist", "µm")])
def test_words(words):
    made = arrow_arrays.texts(words)
    made.validate(full=True)
    assert made.equals(pa.array(words, pa.string()))
