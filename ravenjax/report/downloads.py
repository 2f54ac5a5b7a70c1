"""Writes a table of the report as a CSV file.

A rate becomes the columns k, n, value, low and high.
"""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from ravenjax.store.files import without_formula


def format_csv(rows: Iterable[Any]) -> str:
    """Return rows (mappings or named tuples, possibly nested) as CSV with a header; "" for none.

    Nested values become columns joined by "_". Lists, arrays and curves belong to figures and are
    left out. NaN and infinite numbers become empty cells, and formulas become text.
    """
    flat = [dict(_flat("", row)) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    out = io.StringIO()
    writer = csv.DictWriter(out, names, lineterminator="\n", restval="")
    if flat:
        writer.writeheader()
        writer.writerows(flat)
    return out.getvalue()


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    # Yields the numbers and words of nested records, with joined names. Lists are left out.
    if isinstance(value, BaseModel):
        value = dict(value)
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        for key, part in value.items():
            # A field such as `with_` ends in "_", because its name without it is a keyword.
            word = str(key).rstrip("_")
            yield from _flat(f"{name}_{word}" if name else word, part)
    elif isinstance(value, list | tuple | np.ndarray):
        return
    elif isinstance(value, float | np.floating):
        yield name, float(value) if math.isfinite(value) else ""
    else:
        yield name, "" if value is None else without_formula(value)
