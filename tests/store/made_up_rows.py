"""Rows of any shape with any content that the schema allows, for tests that care about neither."""

import numpy as np
import pandas as pd

from ravenjax.store import schema

WORDS = ("", "a", "usb_out", "Ω≠ß", "with space", "x" * 300, "\t\n", "nan")


def frame(shape: schema.Shape, rows: int, seed: int = 0) -> pd.DataFrame:
    """`rows` rows: the least and the greatest number of every type among them, NaN and infinity
    too.
    """
    random = np.random.default_rng(seed)
    found = {}
    for column in schema.table_columns(shape):
        if column.dtype == "bool":
            values = random.random(rows) < 0.5
        elif column.dtype == "category":
            values = random.choice(np.array(WORDS, object), rows)
        elif column.dtype == "string":
            values = np.array(
                [f"{number:016x}" for number in random.integers(0, 2**63, rows)], object
            )
        elif column.dtype.startswith("int"):
            ends = np.iinfo(column.dtype)
            values = random.integers(ends.min, ends.max, rows, column.dtype, endpoint=True)
            values[random.random(rows) < 0.1] = random.choice([ends.min, ends.max, 0, -1])
        else:
            values = random.normal(size=rows).astype(column.dtype)
            values[random.random(rows) < 0.2] = random.choice(
                [np.nan, np.inf, -np.inf, -0.0, 1e-40]
            )
        found[column.name] = values
    return pd.DataFrame(found | {"index": np.arange(rows, dtype=np.int32)})
