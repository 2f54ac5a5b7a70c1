"""Stores scores of operations, one Parquet file per operator.

Each file is written under a temporary name and renamed. After an interruption the next start keeps
the finished operators and computes the others.
"""

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
    """Create or continue a folder of operations. Raise UserError if it has another design.
    `design`: everything on which the scores depend, as JSON values. It is stored in the folder.
    """
    (folder / PARTS).mkdir(parents=True, exist_ok=True)
    files.require_writable(folder)
    path, text = folder / DESIGN, json.dumps(design, indent=1) + "\n"
    if not path.exists():
        files.write_text(path, text)
    # Both designs are parsed from JSON, because JSON makes lists of tuples.
    stored, requested = read_design(folder), json.loads(text)
    keys = sorted({*stored, *requested})
    if different := [key for key in keys if stored.get(key) != requested.get(key)]:
        raise UserError(
            f"{folder} contains operations with another {' and '.join(different)}: name another"
            " folder, or continue with the same campaign, signals and options"
        )


def list_missing(folder: Path, units: int) -> list[int]:
    """Return which of the operators 0 to `units` - 1 have no operations in the folder yet."""
    return [number for number in range(units) if not _file(folder, number).exists()]


def add_scores(folder: Path, operator: OperatorScores) -> None:
    """Write an operator's operations to a file, one row each. Column score<d> is of detector d."""
    table = pd.DataFrame({"hours": operator.hours})
    for detector, scores in enumerate(operator.score.T):
        table[f"score{detector}"] = scores
    table = table.assign(operator=operator.operator, motion=operator.motion, seed=operator.seed)
    files.write_aside(
        _file(folder, operator.operator), lambda path: table.to_parquet(path, index=False)
    )


def read_scores(folder: Path, units: int | None = None) -> OperationScores:
    """Return the scores of a folder's operations. `units`: use the operators 0 to `units` - 1;
    None: all. Scores are float32 [operations, detectors], NaN for a failed run. Raise StoreError if
    the folder has no operations or a damaged file.
    """
    paths = sorted((folder / PARTS).glob("operator-*.parquet"))
    if not paths:
        raise StoreError(f"{folder}: contains no operations yet")
    try:
        table = pd.concat([files.read_table(path) for path in paths], ignore_index=True)
    except UserError as error:
        raise StoreError(f"{error}; delete the file, and the same command continues") from None
    score = table.filter(regex=r"^score\d+$").to_numpy(np.float32)
    scores = OperationScores(table["operator"].to_numpy(), score, table["hours"].to_numpy())
    return scores if units is None else scores.taken_from(np.arange(units))


def read_design(folder: Path) -> dict[str, Any]:
    """Return the stored design of a folder. Raise StoreError if it is missing or damaged."""
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
