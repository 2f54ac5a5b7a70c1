"""Tests whether new fault-free operations still resemble those on which a monitor was calibrated.

The test uses only the first operation of each operator, result folder or log. Later operations
share the operator's motion or the robot, so they are not independent of the first. The score of
each term of the monitor is tested separately, and so is the largest score. Holm's method keeps the
error rate of all tests together at the stated level.
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.analyses.monitors import code, score_folder, writing
from ravenjax.analyses.monitors.monitor import Monitor, list_reads, name_read
from ravenjax.analyses.monitors.operations import MS_PER_HOUR
from ravenjax.analyses.monitors.writing import SCORE
from ravenjax.errors import StoreError, UserError
from ravenjax.outcomes import events
from ravenjax.report.data.facts import faulty_sql
from ravenjax.stats.conformal import shift
from ravenjax.stats.multiplicity import holm_test
from ravenjax.store import files, manifest
from ravenjax.store.access import query


def check_exchangeability(
    folder: Path, sources: Sequence[Path], level: float = 0.05, seed: int = 0
) -> pd.DataFrame:
    """Test whether new operations have the calibration's distribution of scores.

    Return a table with one row per score, the joint score first. Columns: score, place (median rank
    among the calibration's scores, 0 to 1), p, adjusted (p over all tests), martingale, shifted.
    attrs: level (probability that a score is called shifted although nothing changed), units,
    operations, hours, alarms (number of operations with an alarm).

    `folder` contains the monitor. `sources`: folders that `ravenjax monitor` or `ravenjax run`
    wrote, or logs as CSV. A log has the columns of test_vector.csv: live, and the monitor's inputs,
    one row per millisecond. Raise StoreError and UserError.
    """
    if not 0 < level < 1:
        raise UserError(f"--level is {level:g}, expected a number between 0 and 1, such as 0.05")
    if not sources:
        raise UserError("no operations to test: name result folders or logs")
    monitor, record = writing.read_monitor(folder)
    reference = pd.read_csv(folder / writing.REFERENCE).astype(np.float32)
    some = [_fresh(source, folder, monitor, record) for source in sources]
    _require_different(sources, some)
    # Units of different sources are different. Only scores that all sources have are kept.
    fresh = pd.concat(some, keys=range(len(some)), names=["source"], join="inner")
    first = fresh.groupby(["source", "unit"]).head(1)
    results = {}
    for name in fresh.columns.drop(["unit", "hours"]):
        before, after = (
            # The score of a failed operation is NaN, and counts as larger than all others.
            some_scores[name].fillna(np.inf).to_numpy()
            for some_scores in (reference, first)
        )
        both = np.concatenate([before, after])
        # A constant score cannot show a shift.
        if (both != both[0]).any():
            results[name] = shift.test_shift(before, after, seed)
    findings = holm_test({name: one.p for name, one in results.items()}, 1.0 - level)
    rows = [
        (
            name,
            one.median_rank,
            one.p,
            findings[name].adjusted,
            one.martingale,
            findings[name].rejected,
        )
        for name, one in results.items()
    ]
    columns = ["score", "place", "p", "adjusted", "martingale", "shifted"]
    table = pd.DataFrame(rows, columns=columns)
    table.attrs |= {
        "level": level,
        "units": len(first),
        "operations": len(fresh),
        "hours": float(fresh["hours"].to_numpy().sum()),
        "alarms": int((fresh[SCORE].to_numpy() > monitor.threshold).sum()),
    }
    return table


def series_scores(monitor: Monitor, live: np.ndarray, inputs: dict[str, np.ndarray]) -> np.ndarray:
    """Return the largest score of each term in each segment of a log, float32 [terms * segments].

    The score is 0 in segments in which the robot was never live. `live`: bool [milliseconds].
    `inputs`: float32 [milliseconds] by name. The arithmetic operations are those of the monitor's
    generated Python file, so the bits are the same.
    """
    numbers = {
        name: np.nan_to_num(np.asarray(v, np.float32), nan=0.0, posinf=np.inf, neginf=-np.inf)
        for name, v in inputs.items()
    }
    segment_of_tick = np.zeros(len(live), int)
    if monitor.segments.field:
        edges = np.asarray(monitor.segments.edges, np.float32)
        segment_of_tick = np.searchsorted(edges, numbers[monitor.segments.field], "right")
    out = np.zeros((len(monitor.terms), monitor.segments.count), np.float32)
    for k, term in enumerate(monitor.terms):
        own = numbers[name_read(term, term.signal)]
        with np.errstate(invalid="ignore"):  # infinity - infinity
            if term.kind == "residual":
                own = own - numbers[name_read(term, term.against)]
            elif term.kind == "rate":
                own = np.diff(own, prepend=own[:1])
        # NaN is read as 0, as in the generated file.
        size = np.nan_to_num(np.abs(own), nan=0.0, posinf=np.inf)
        for segment in range(monitor.segments.count):
            out[k, segment] = size[live & (segment_of_tick == segment)].max(initial=0.0)
    return out.ravel()


def _fresh(source: Path, folder: Path, monitor: Monitor, record: dict[str, Any]) -> pd.DataFrame:
    """Read new operations from a folder or a log, one row each.

    Columns: unit, hours, SCORE, and the available columns of `writing.score_columns`. attrs:
    origin, a text that is equal for sources with the same operators.
    """
    if (source / score_folder.FOLDER / score_folder.DESIGN).is_file():
        return _of_operations(source, folder, monitor, record)
    if (source / manifest.FILE).is_file():
        return _of_result(source, monitor, record)
    if source.suffix == ".csv":
        return _of_log(source, monitor, record)
    raise UserError(
        f"{source}: expected a folder of `ravenjax monitor operate` or `ravenjax run`, or a log"
        " whose name ends in .csv"
    )


def _of_operations(
    source: Path, folder: Path, monitor: Monitor, record: dict[str, Any]
) -> pd.DataFrame:
    # Refuses operations with other scores than the calibration's, or with the same operators.
    scores_folder, own = source / score_folder.FOLDER, folder / score_folder.FOLDER
    before, design = score_folder.read_design(own), score_folder.read_design(scores_folder)
    for key in ("signals", "segments", "code"):
        if design.get(key) != before.get(key):
            raise UserError(
                f"{source}: differs from {folder} in {key}, so their scores cannot be compared"
            )
    _require_length(source, float(design["design"]["length_s"]), record)
    if all(design["design"].get(key) == before["design"].get(key) for key in ("seed", "stream")):
        raise UserError(
            f"{source}: has the operators of the calibration, so it cannot test the calibration."
            " Simulate new operators with `ravenjax monitor operate`"
        )
    peaks = score_folder.read_scores(scores_folder)
    origin = f"operators of seed {design['design']['seed']}, stream {design['design']['stream']}"
    return _table(monitor, peaks.unit, peaks.hours, peaks.score, origin)


def _of_result(source: Path, monitor: Monitor, record: dict[str, Any]) -> pd.DataFrame:
    """Read a campaign's fault-free runs with the monitor as a detector.

    All runs count as one unit, because they have the same operator.
    """
    own = manifest.read_manifest(source)
    _require_length(source, own.duration_ms / 1e3, record)
    parts = {one["name"]: Path(one.get("file") or "") for one in own.config.get("detector", ())}
    digest = record["sha256"][code.PART]
    same = {
        name for name, file in parts.items() if file.is_file() and files.hash_file(file) == digest
    }
    numbers = (
        number
        for number, detector in enumerate(own.detectors)
        if detector.consecutive == 1 and detector.name.split("/")[0] in same
    )
    if (number := next(numbers, None)) is None:
        raise UserError(
            f"{source}: the campaign did not have the monitor as a detector (its detectors:"
            f" {', '.join(parts) or 'none'}). Run the campaign with the monitor's {code.PART} as"
            " [[detector]] file, and consecutive = 1"
        )
    with query.open_folder(source) as table:
        rows = table.rows(
            f"SELECT detector{number}_score, pedal_down_ms FROM {query.RESULTS} WHERE"
            f" {events.VALID_SQL} AND NOT {faulty_sql(list(table.types()))} ORDER BY index"
        )
    if not rows:
        raise UserError(f"{source}: has no run without a fault")
    table = pd.DataFrame(rows, columns=[SCORE, "hours"]).assign(unit=0)
    table = table.astype({SCORE: np.float32}).assign(hours=table["hours"] / MS_PER_HOUR)
    operator = json.dumps(own.config.get("operator", {}), sort_keys=True)
    table.attrs["origin"] = f"operator {operator}"
    return table


def _of_log(source: Path, monitor: Monitor, record: dict[str, Any]) -> pd.DataFrame:
    """Read a log as one operation, truncated to the length of the calibration's operations."""
    arms = record["monitor"].get("arms", ())
    if len(arms) > 1:
        raise UserError(
            f"{source}: a log has one arm, but scores of the calibration are the larger ones of the"
            f" arms {' and '.join(arms)}. Calibrate with --set 'campaign.arms=[\"NAME\"]' for the"
            " arm of the log"
        )
    names = ["live", *list_reads(monitor.terms, monitor.segments)]
    try:
        with open(source, newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            if lost := [name for name in names if name not in (rows.fieldnames or ())]:
                raise UserError(
                    f"{source}: has no column {', '.join(lost)}; {writing.VECTOR} shows the"
                    " expected columns"
                )
            table = np.array([[float(row[name]) for name in names] for row in rows], np.float64)
    except (OSError, UnicodeDecodeError) as error:
        raise StoreError(f"{source}: cannot be read ({error})") from None
    except (TypeError, ValueError) as error:
        raise UserError(
            f"{source}: line {rows.line_num}: expected a number in each column ({error})"
        ) from None
    length = round(record["promise"]["operation_s"] * 1e3)
    if len(table) < length:
        raise UserError(
            f"{source}: the log lasts {len(table)} ms, but the calibration's operations last"
            f" {length} ms, and a maximum over a shorter time cannot be compared. Use a longer log"
        )
    live = table[:length, 0] != 0
    inputs = {name: table[:length, k + 1].astype(np.float32) for k, name in enumerate(names[1:])}
    peak = series_scores(monitor, live, inputs)[None]
    hours = np.array([live.sum() / MS_PER_HOUR])
    return _table(monitor, np.zeros(1, int), hours, peak, f"log {files.hash_file(source)}")


def _table(
    monitor: Monitor, unit: np.ndarray, hours: np.ndarray, peak: np.ndarray, origin: str
) -> pd.DataFrame:
    # Returns a table with a row per operation: operator, duration, and the scores of the monitor.
    columns = writing.score_columns(monitor, peak)
    table = pd.DataFrame({"unit": unit, "hours": hours, **columns})
    table.attrs["origin"] = origin
    return table


def _require_different(sources: Sequence[Path], some: Sequence[pd.DataFrame]) -> None:
    # Raises UserError if two sources contain operations of the same operators.
    first: dict[str, Path] = {}
    for source, one in zip(sources, some, strict=True):
        origin = one.attrs["origin"]
        if origin in first:
            raise UserError(
                f"{source}: has the same operators as {first[origin]} ({origin}), but only one"
                " operation of each operator counts. Check the sources separately"
            )
        first[origin] = source


def _require_length(source: Path, seconds: float, record: dict[str, Any]) -> None:
    # Raises UserError if the operations are not as long as those of the calibration.
    wanted = record["promise"]["operation_s"]
    if abs(seconds - wanted) > 1e-6:
        raise UserError(
            f"{source}: its operations last {seconds:g} s, but the calibration's last {wanted:g} s."
            " Scores are maxima, so scores over different times cannot be compared. Run with"
            f" campaign.duration_s = {wanted:g}"
        )
