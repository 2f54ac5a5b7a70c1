"""Stores analyses of a campaign's runs, such as those of `ravenjax explain`, as Parquet files."""

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.errors import StoreError
from ravenjax.store import manifest
from ravenjax.store.files import write_aside
from ravenjax.store.manifest import Manifest

FOLDER, FILE = "explained", "explained.parquet"
"""Default folder inside a result folder, and file name, of the table of `ravenjax explain`."""
DEADLINES = Path("deadline", "deadlines.parquet")
"""Path of the table of `ravenjax deadline` inside a result folder."""
_CAMPAIGN, _CODE = b"config_hash", b"code_hash"


def add_explained(folder: Path, ticks: pd.DataFrame, record: Manifest) -> Path:
    """Add the table `ticks` of explained runs to the file in a folder. Return the file's path.
    Earlier rows of the same runs, and rows of other code or of another campaign, are removed. Raise
    StoreError if writing fails.
    """
    path, code_now = folder / FILE, manifest.code_hash(record.robot).encode()
    before = read_explained(folder, record)
    if before is not None and (pq.read_schema(path).metadata or {}).get(_CODE) == code_now:
        others = before.loc[~before["run_id"].isin(ticks["run_id"])]
        ticks = pd.concat([others, ticks], ignore_index=True).sort_values("index", kind="stable")
    write_rows(path, ticks, record)
    return path


def read_explained(folder: Path, record: Manifest) -> pd.DataFrame | None:
    """Return the explained runs of a campaign in a folder; None if the folder has none. Raises
    StoreError for a damaged file.
    """
    return read_rows(folder / FILE, record, "explain")


def read_deadlines(directory: Path) -> pd.DataFrame | None:
    """Return the table of `ravenjax deadline` in a result folder, or None if it was not computed.

    The table has a row for each harmful fault and each action:

    run, action    run id; name of the action
    deadline_ms    last time at which the action prevents the harm, ms after the fault's first
                   effect; negative: before the effect, so that the harm cannot be prevented
    effect_ms      time of the fault's first effect, ms since the run began
    visible_ms     first time at which a signal shows the fault, ms after its first effect; NaN if
                   no signal shows the fault
    margin_ms      deadline_ms minus visible_ms; NaN if no signal shows the fault
    monotone       False if an action at an earlier tried tick does not prevent the harm
    harms_alone    True if the action also causes harm without the fault

    Raise StoreError for a folder without results, and for a damaged table.
    """
    record = manifest.read_manifest(directory)
    return read_rows(directory / DEADLINES, record, "deadline")


def write_rows(path: Path, rows: pd.DataFrame, record: Manifest) -> None:
    """Write a table about runs, with hashes of campaign and code. Raise StoreError if it fails."""
    code = manifest.code_hash(record.robot).encode()
    table = pa.Table.from_pandas(rows, preserve_index=False)
    table = table.replace_schema_metadata({_CAMPAIGN: record.config_hash.encode(), _CODE: code})
    write_aside(path, lambda target: pq.write_table(table, target, compression="zstd"))


def read_rows(path: Path, record: Manifest, command: str) -> pd.DataFrame | None:
    """Return a table that `write_rows` wrote for the same campaign; None if there is none. command:
    command of ravenjax that writes the table. Raise StoreError for a damaged file.
    """
    if not path.is_file():
        return None
    try:
        if (pq.read_schema(path).metadata or {}).get(_CAMPAIGN) != record.config_hash.encode():
            return None
        return pq.read_table(path).to_pandas()
    except (pa.ArrowException, OSError) as error:
        raise StoreError(
            f"{path}: is damaged ({error}); delete it and run `ravenjax {command}` again"
        ) from error
