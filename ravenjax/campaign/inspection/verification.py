"""Verifies a result folder: checks its files, and computes a random sample of its runs again.

A campaign's results follow from its file, its seed, the code and the engine. The fault table is
therefore expanded again, and its ids must equal those in the folder. With the same engine, device,
code and packages, the runs must be equal to the bit. On another engine numbers may differ, and the
result states by how much. Runs are computed from their beginning, not from snapshots.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.campaign import compile_cache, outcomes
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.faults import run_id
from ravenjax.campaign.inspection.replay import original_engine
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.plan import Plan, make_plan
from ravenjax.engines.interface import Engine
from ravenjax.errors import StoreError, UserError
from ravenjax.store import manifest, schema
from ravenjax.store.access import checking
from ravenjax.store.access.checking import FolderCheck
from ravenjax.store.folder import PARTS
from ravenjax.store.manifest import Manifest
from ravenjax.store.parts import Part

SAMPLE = 64
"""Number of runs that are computed again if the caller gives none."""


class ColumnAgreement(NamedTuple):
    """Agreement of one column between the recomputed runs and the stored ones."""

    name: str
    equal: int  # rows that are equal bit by bit
    largest: float  # largest difference, in the column's unit; NaN for words, or if a number is NaN


class Rerun(NamedTuple):
    """A sample of runs that were computed again."""

    engine: str  # engine and device, as text
    # Changes of engine, device, code or packages since the folder was computed. If there are any,
    # differences in numbers are no error.
    changes: list[str]
    rows: np.ndarray  # indices of the recomputed runs, ascending
    verdicts: int  # number of rows with the same verdict
    columns: list[ColumnAgreement]  # every column of the result table

    @property
    def differing(self) -> list[ColumnAgreement]:
        """Return the columns that are not equal in every row, those with most differences first."""
        sorted_columns = sorted(self.columns, key=lambda column: column.equal)
        return [column for column in sorted_columns if column.equal < len(self.rows)]


class Verification(NamedTuple):
    """Result of a verification."""

    checks: list[FolderCheck]
    rerun: Rerun | None  # None: no run was requested, or none could be computed

    @property
    def fine(self) -> bool:
        """Whether no error was found."""
        return all(check.fine for check in self.checks)


def verify_folder(
    folder: Path, sample: int = SAMPLE, engine: str = "auto", seed: int = 0
) -> Verification:
    """Check a result folder and compute `sample` of its runs again, drawn with `seed`; 0: none.
    engine: "auto" means the engine that computed the folder; for a folder from a GPU, the fastest
    engine here. Raise StoreError if there is no result, and UserError for an unavailable engine.
    """
    if sample < 0:
        raise UserError(f"--sample {sample}: expected 0 or more, the number of runs to recompute")
    record = manifest.read_manifest(folder)
    if not record.parts:
        raise StoreError(f"{folder}: contains no finished part yet; resume it with `ravenjax run`")
    parts, whole = checking.check_files(folder, record)
    checks = [parts, checking.check_rows(record), *checking.check_values(folder, record, whole)]
    try:
        plan = make_plan(validate_tables(record.config, folder / manifest.FILE))
    except UserError as error:
        what = "the manifest's campaign, expanded again"
        return Verification([*checks, FolderCheck("campaign", what, [str(error)])], None)
    checks.append(_check_campaign(folder, record, plan, whole))
    # Runs can be compared only if the campaign still has the stored runs, in undamaged files.
    if not sample or not checks[-1].fine or not whole:
        return Verification(checks, None)
    stored = np.concatenate([np.asarray(part.rows) for part in whole])
    drawn = np.random.default_rng(seed).choice(stored, min(sample, len(stored)), replace=False)
    rerun = _recompute(folder, record, plan, np.sort(drawn), engine)
    return Verification([*checks, _check_rerun(rerun, plan)], rerun)


def _check_campaign(folder: Path, record: Manifest, plan: Plan, whole: list[Part]) -> FolderCheck:
    # Checks that the campaign file expands to the runs in the manifest and in the stored parts.
    ids = plan.rows["run_id"].to_numpy()
    config_hash = manifest.campaign_hash(record.config, record.operator, run_id.hash_run_ids(ids))
    if plan.runs != record.runs:
        problems = [f"the campaign expands to {plan.runs} runs, the manifest states {record.runs}"]
    elif record.config_hash != config_hash:
        problems = [f"{manifest.FILE}: config_hash is not that of its config and its runs"]
    else:
        problems = [
            f"{part.file}: its run ids are not those of the campaign's rows {part.first} to"
            f" {part.last}"
            for part in whole
            if pq.read_table(folder / PARTS / part.file, columns=["run_id"])[0].to_pylist()
            != run_id.format_run_ids(ids[part.first : part.last + 1]).to_pylist()
        ]
    rows = sum(len(part.rows) for part in whole)
    looked_at = f"expanded again, {rows:,} run ids and the config hash compared"
    return FolderCheck("campaign", looked_at, problems[: checking.MOST])


def _recompute(folder: Path, record: Manifest, plan: Plan, rows: np.ndarray, engine: str) -> Rerun:
    # Computes some rows again and compares every column with the stored one.
    name, precision = original_engine(record, engine), plan.program.setup.precision
    backend = compile_cache.cached_engine(name, precision)
    words = f"{backend.name} on {backend.device}"
    computation = Computation(plan, backend, whole=True)
    columns, golden_runs = computation.tables([range(row, row + 1) for row in rows.tolist()])
    computed = outcomes.result_columns(plan.config, plan.rows.iloc[rows], columns, golden_runs)
    new = schema.conform_table(computed, record.shape)
    tables = []
    for part in sorted(record.parts, key=lambda part: part.first):
        in_part = rows[(rows >= part.first) & (rows <= part.last)]
        if len(in_part):
            tables.append(pq.read_table(folder / PARTS / part.file).take(in_part - part.first))
    old = pa.concat_tables(tables).unify_dictionaries()
    agreements = [_column(name, old.column(name), new.column(name)) for name in old.column_names]
    verdicts = next(column.equal for column in agreements if column.name == "verdict")
    return Rerun(words, _list_changes(record, plan, backend), rows, verdicts, agreements)


def _list_changes(record: Manifest, plan: Plan, engine: Engine) -> list[str]:
    # Lists changes since the folder was computed that may change the last digits of numbers.
    device = f"{engine.device} ({'+'.join(plan.program.setup.arms)})"
    settings = compile_cache.engine_settings(engine.name)
    return [
        words
        for words, differs in (
            (f"originally engine {record.engine}", engine.name != record.engine),
            (f"originally device {record.device}", device not in record.device.split("; ")),
            ("another version of the code", manifest.code_hash(record.robot) != record.code_hash),
            ("other package versions", manifest.package_versions() != record.versions),
            ("other settings of JAX", settings != record.settings),
        )
        if differs
    ]


def _column(name: str, stored: pa.ChunkedArray, new: pa.ChunkedArray) -> ColumnAgreement:
    # Counts equal rows of a column. NaN equals NaN, but 0 does not equal -0.
    if pa.types.is_dictionary(stored.type) or pa.types.is_string(stored.type):
        same = np.array(stored.to_pylist(), object) == np.array(new.to_pylist(), object)
        return ColumnAgreement(name, int(same.sum()), np.nan)
    x, y = stored.to_numpy(), new.to_numpy()
    equal = (x == y) & (np.signbit(x) == np.signbit(y))
    # Only NaN differs from itself.
    same = equal | ((x != x) & (y != y))
    difference = np.abs(x[~same].astype(float) - y[~same].astype(float))
    largest = float(difference.max()) if len(difference) else 0.0
    return ColumnAgreement(name, int(same.sum()), largest)


def _check_rerun(rerun: Rerun, plan: Plan) -> FolderCheck:
    """Return the errors found by a rerun. A difference in a run's inputs is always an error. A
    difference in outcomes is an error only if engine, device, code and packages are the same.
    """
    n, inputs = len(rerun.rows), set(plan.rows)
    problems = [
        f"{column.name}: differs in {n - column.equal} of {n} rows"
        for column in rerun.differing
        if not rerun.changes or column.name in inputs
    ]
    if (more := len(problems) - checking.MOST) > 0:
        problems[checking.MOST :] = [f"and {more} more columns"]
    equal = len(rerun.columns) - len(rerun.differing)
    looked_at = (
        f"{n} run{'s' if n > 1 else ''} on {rerun.engine}: {equal} of {len(rerun.columns)} columns"
        f" equal in all bits, {rerun.verdicts} of {n} verdicts equal"
    )
    if rerun.changes:
        looked_at += f" ({'; '.join(rerun.changes)}, so numbers may differ)"
    return FolderCheck("recomputed runs", looked_at, problems)
