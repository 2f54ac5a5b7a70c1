"""Stores scores of operations, one Parquet file per operator.

Each file is written under a temporary name and renamed. After an interruption the next start keeps
the finished operators and computes the others.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.analyses.monitors.operations import OperatorScores
from ravenjax.errors import StoreError, UserError
from ravenjax.stats.conformal.threshold import OperationScores
from ravenjax.store import files

FOLDER, DESIGN, PARTS = "operations", "design.json", "parts"


def open_folder(folder: Path, design: dict[str, Any]) -> None:
    """Create or continue a folder of operations. Raise UserError if it has another design."""
    (folder / PARTS).mkdir(parents=True, exist_ok=True)
    files.require_writable(folder)
    path, text = folder / DESIGN, json.dumps(design, indent=1) + "\n"
    if not path.exists():
        files.write_text(path, text)
    before, after = read_design(folder), json.loads(text)
    if other := sorted(key for key in {*before, *after} if before.get(key) != after.get(key)):
        raise UserError(
            f"{folder} contains operations with another {' and '.join(other)}: name another"
            " folder, or continue with the same campaign, signals and options"
        )


def list_missing(folder: Path, units: int) -> list[int]:
    """Return the operators below `units` that are not in the folder."""
    return [number for number in range(units) if not _file(folder, number).exists()]


def add_scores(folder: Path, operator: OperatorScores) -> None:
    """Store the operations of an operator."""
    columns = {"hours": operator.hours} | {
        f"score{number}": scores for number, scores in enumerate(operator.score.T)
    }
    table = pd.DataFrame(columns).assign(
        operator=operator.operator, motion=operator.motion, seed=operator.seed
    )
    files.write_aside(
        _file(folder, operator.operator), lambda path: table.to_parquet(path, index=False)
    )


def read_scores(folder: Path, units: int | None = None) -> OperationScores:
    """Return the scores of the operations in a folder, of operators with numbers below `units`.

    score: float32 [operations, detectors]; NaN for a failed run. Raise StoreError if the folder
    has no operations or a damaged file.
    """
    paths = sorted((folder / PARTS).glob("operator-*.parquet"))
    if not paths:
        raise StoreError(f"{folder}: contains no operations yet")
    try:
        table = pd.concat([files.read_table(path) for path in paths], ignore_index=True)
    except UserError as error:
        raise StoreError(f"{error}; delete the file, and the same command continues") from None
    score = table.filter(regex=r"^score\d+$").to_numpy(np.float32)
    peaks = OperationScores(table["operator"].to_numpy(), score, table["hours"].to_numpy())
    return peaks if units is None else peaks.taken_from(np.arange(units))


def read_design(folder: Path) -> dict[str, Any]:
    """Return the design of a folder's operations. Raises StoreError."""
    try:
        content = files.parse_json((folder / DESIGN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StoreError(f"{folder / DESIGN}: cannot be read ({error})") from None
    if not isinstance(content, dict):
        raise StoreError(
            f"{folder / DESIGN}: is not the JSON object that `ravenjax monitor calibrate` writes"
        )
    return content


def _file(folder: Path, operator: int) -> Path:
    return folder / PARTS / f"operator-{operator:07d}.parquet"
