"""Arrow arrays of NumPy's, by their memory.

`pyarrow.array` asks pandas whether what it gets is one of its own, and imports it for that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

_PLAIN = "iuf"
"""Kinds of types whose numbers stand in Arrow as they do in NumPy."""


def numbers(values: np.ndarray) -> pa.Array | None:
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


def plain(arrays: Sequence[pa.Array]) -> np.ndarray:
    """The numbers [rows] of some arrays of one type, one after the other, of which none is
    missing.
    """
    kind = np.dtype(arrays[0].type.to_pandas_dtype())
    return np.concatenate(
        [np.frombuffer(a.buffers()[1], kind, len(a), a.offset * kind.itemsize) for a in arrays]
    )


def texts(values: Sequence[str]) -> pa.StringArray:
    """Words [rows]."""
    encoded = [value.encode() for value in values]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(encoded), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded))
    )
