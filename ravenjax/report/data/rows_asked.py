"""Which rows of a result folder somebody asks for, and whether rows computed anew are those that
are stored.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.errors import UserError, suggestion
from ravenjax.report.data.facts import faulty_sql
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, quoted, text

COMPARED = (
    "response",
    "hazard",
    "first_active_ms",
    "unintended_mm",
    "loss_mm",
    "tip_path_mm",
    "told_ms",
)
"""Columns that tell whether a run came out as it is stored."""


def faulty(folder: Path, group: str | None = None) -> list[int]:
    """Numbers of the valid rows with a fault, of a group or of all. Raises UserError for an unknown
    group or where there are none, StoreError as `query.open_folder`."""
    with query.open_folder(folder) as table:
        groups = [
            name
            for (name,) in table.rows(f'SELECT DISTINCT "group"::VARCHAR FROM {RESULTS} ORDER BY 1')
        ]
        if group is not None and group not in groups:
            raise UserError(
                f"--group {group!r}: unknown, expected"
                f" {', '.join(groups)}{suggestion(group, groups)}"
            )
        where = "true" if group is None else f'"group" = {text(group)}'
        condition = f"failed = '' AND {faulty_sql(list(table.types()))} AND {where}"
        rows = [
            row
            for (row,) in table.rows(f"SELECT row FROM {RESULTS} WHERE {condition} ORDER BY row")
        ]
    if not rows:
        place = f"{folder}" if group is None else f"group {group!r} of {folder}"
        raise UserError(f"{place}: no valid run with a fault, so there is nothing to explain")
    return rows


def changed(folder: Path, results: pd.DataFrame) -> int:
    """How many of these runs are stored with other outcomes; a run that is not stored is none of
    them.
    """
    names = [name for name in COMPARED if name in results]
    listed = ", ".join(map(str, results["index"].tolist()))
    with query.open_folder(folder) as table:
        columns = ", ".join(["row", *map(quoted, names)])
        stored = table.frame(f"SELECT {columns} FROM {RESULTS} WHERE row IN ({listed})").set_index(
            "row"
        )
    own = results.set_index("index").loc[stored.index, names]
    differs = np.zeros(len(own), bool)
    for name in names:
        before, after = stored[name], own[name]
        if before.dtype.kind == "f":
            differs |= ~np.isclose(before, after, rtol=0, atol=0, equal_nan=True)
        else:
            differs |= (before.astype(str) != after.astype(str)).to_numpy()
    return int(differs.sum())
