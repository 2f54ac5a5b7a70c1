"""Tests whether new fault-free operations still resemble those on which a monitor was calibrated.

The test uses one operation of each simulated operator, because other operations of this operator
have the same motion. It also uses one operation of each result folder of `ravenjax run`, which has
only one operator, and of each log. A monitor computes several scores. Each score is tested
separately, and so is their maximum. Holm's method limits the probability that any of these tests
finds a change that does not exist.
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.analyses.monitors import code, score_folder, writing
from ravenjax.analyses.monitors.monitor import Monitor, input_expressions, input_name
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
    """Test whether the scores of new operations have the same distribution as in the calibration.

    Return a table with one row per score, the joint score first. Columns: score, place (median rank
    among the scores of the calibration, 0 to 1), p, adjusted (p over all tests), martingale,
    shifted. attrs: level (probability that a score is called shifted although nothing changed),
    units, operations, hours, alarms (number of operations with an alarm).

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
    tables = [_read_operations(source, folder, monitor, record) for source in sources]
    _require_different(sources, tables)
    # Units of different sources are different. Only scores that all sources have are kept.
    operations = pd.concat(tables, keys=range(len(tables)), names=["source"], join="inner")
    first_operations = operations.groupby(["source", "unit"]).head(1)
    shifts = {}
    for name in operations.columns.drop(["unit", "hours"]):
        # The score of a failed operation is NaN, and counts as larger than all others.
        calibration_scores = reference[name].fillna(np.inf).to_numpy()
        new_scores = first_operations[name].fillna(np.inf).to_numpy()
        all_scores = np.concatenate([calibration_scores, new_scores])
        # A constant score cannot show a shift.
        if (all_scores != all_scores[0]).any():
            shifts[name] = shift.test_shift(calibration_scores, new_scores, seed)
    findings = holm_test({name: result.p for name, result in shifts.items()}, 1.0 - level)
    rows = [
        (
            name,
            result.median_rank,
            result.p,
            findings[name].adjusted,
            result.martingale,
            findings[name].rejected,
        )
        for name, result in shifts.items()
    ]
    columns = ["score", "place", "p", "adjusted", "martingale", "shifted"]
    table = pd.DataFrame(rows, columns=columns)
    table.attrs |= {
        "level": level,
        "units": len(first_operations),
        "operations": len(operations),
        "hours": float(operations["hours"].to_numpy().sum()),
        "alarms": int((operations[SCORE].to_numpy() > monitor.threshold).sum()),
    }
    return table


def series_scores(monitor: Monitor, live: np.ndarray, inputs: dict[str, np.ndarray]) -> np.ndarray:
    """Return the largest score of each term in each segment of a log, float32 [terms * segments].

    The score is 0 in segments in which the robot was never live. `live`: bool [milliseconds].
    `inputs`: float32 [milliseconds] by name. The arithmetic operations are those of the monitor's
    generated Python file, so the bits are the same.
    """
    # NaN is read as 0, as in the generated file.
    numbers = {
        name: np.nan_to_num(np.asarray(values, np.float32), nan=0.0, posinf=np.inf, neginf=-np.inf)
        for name, values in inputs.items()
    }
    segment_of_tick = np.zeros(len(live), int)
    if monitor.segments.field:
        # A value equal to an edge belongs to the segment after the edge.
        edges = np.asarray(monitor.segments.edges, np.float32)
        segment_of_tick = np.searchsorted(edges, numbers[monitor.segments.field], "right")
    peaks = np.zeros((len(monitor.terms), monitor.segments.count), np.float32)
    for term_index, term in enumerate(monitor.terms):
        values = numbers[input_name(term, term.signal)]
        # The difference of two infinite values is NaN, of which NumPy would warn.
        with np.errstate(invalid="ignore"):
            if term.kind == "residual":
                values = values - numbers[input_name(term, term.against)]
            # A rate is the change since the last millisecond; 0 in the first one.
            elif term.kind == "rate":
                values = np.diff(values, prepend=values[:1])
        scores = np.nan_to_num(np.abs(values), nan=0.0, posinf=np.inf)
        for segment in range(monitor.segments.count):
            in_segment = live & (segment_of_tick == segment)
            peaks[term_index, segment] = scores[in_segment].max(initial=0.0)
    return peaks.ravel()


def _read_operations(
    source: Path, folder: Path, monitor: Monitor, record: dict[str, Any]
) -> pd.DataFrame:
    """Read new operations from a folder or a log, one row each. `source`: the folder or log.
    `folder`: folder of the monitor. `record`: content of the monitor's monitor.toml. Columns: unit
    (number of the operator), hours, SCORE, and the available columns of `writing.score_columns`.
    attrs: origin, a text that is equal for sources with equal operators.
    """
    if (source / score_folder.FOLDER / score_folder.DESIGN).is_file():
        return _read_simulated_operations(source, folder, monitor, record)
    if (source / manifest.FILE).is_file():
        return _read_result(source, monitor, record)
    if source.suffix == ".csv":
        return _read_log(source, monitor, record)
    raise UserError(
        f"{source}: expected a folder of `ravenjax monitor operate` or `ravenjax run`, or a log"
        " whose name ends in .csv"
    )


def _read_simulated_operations(
    source: Path, folder: Path, monitor: Monitor, record: dict[str, Any]
) -> pd.DataFrame:
    """Read operations that `ravenjax monitor operate` simulated. Raise UserError if they have other
    scores or another length than those of the calibration, or the calibration's operators.
    """
    scores_folder = source / score_folder.FOLDER
    content = score_folder.read_design(scores_folder)
    calibration_content = score_folder.read_design(folder / score_folder.FOLDER)
    for key in ("signals", "segments", "code"):
        if content.get(key) != calibration_content.get(key):
            raise UserError(
                f"{source}: differs from {folder} in {key}, so their scores cannot be compared"
            )
    design, calibration_design = content["design"], calibration_content["design"]
    _require_length(source, float(design["length_s"]), record)
    # Operators are drawn from the seed and the stream.
    if all(design.get(key) == calibration_design.get(key) for key in ("seed", "stream")):
        raise UserError(
            f"{source}: has the operators of the calibration, so it cannot test the calibration."
            " Simulate new operators with `ravenjax monitor operate`"
        )
    peaks = score_folder.read_scores(scores_folder)
    origin = f"operators of seed {design['seed']}, stream {design['stream']}"
    return _operation_table(monitor, peaks.unit, peaks.hours, peaks.score, origin)


def _read_result(source: Path, monitor: Monitor, record: dict[str, Any]) -> pd.DataFrame:
    """Read the fault-free runs of a campaign. Raise UserError if there is none, or if the campaign
    did not have the monitor as a detector.

    All runs count as one unit, because they have the same operator.
    """
    campaign = manifest.read_manifest(source)
    _require_length(source, campaign.duration_ms / 1e3, record)
    number = _find_detector(source, campaign, record["sha256"][code.PART])
    with query.open_folder(source) as results:
        rows = results.rows(
            f"SELECT detector{number}_score, pedal_down_ms FROM {query.RESULTS} WHERE"
            f" {events.VALID_SQL} AND NOT {faulty_sql(list(results.types()))} ORDER BY index"
        )
    if not rows:
        raise UserError(f"{source}: has no run without a fault")
    table = pd.DataFrame(rows, columns=[SCORE, "pedal_down_ms"]).astype({SCORE: np.float32})
    table["hours"] = table.pop("pedal_down_ms") / MS_PER_HOUR
    table["unit"] = 0
    operator = json.dumps(campaign.config.get("operator", {}), sort_keys=True)
    table.attrs["origin"] = f"operator {operator}"
    return table


def _find_detector(source: Path, campaign: manifest.Manifest, sha256: str) -> int:
    """Return the number of the campaign's detector whose file has this hash and whose alarm begins
    in the first millisecond above its threshold. Raise UserError if there is none.
    """
    tables = campaign.config.get("detector", ())
    detector_files = {table["name"]: Path(table.get("file") or "") for table in tables}
    for number, detector in enumerate(campaign.detectors):
        # A table with several values of `consecutive` gives several detectors: name/1, name/4.
        file = detector_files.get(detector.name.split("/")[0], Path())
        if detector.consecutive == 1 and file.is_file() and files.hash_file(file) == sha256:
            return number
    raise UserError(
        f"{source}: the campaign's detectors ({', '.join(detector_files) or 'none'}) do not include"
        " the monitor. Add a [[detector]] with consecutive = 1 and with"
        f" the path of the monitor's {code.PART} as file, and run the campaign again"
    )


def _read_log(source: Path, monitor: Monitor, record: dict[str, Any]) -> pd.DataFrame:
    """Read a log as one operation, truncated to the length of the calibration's operations."""
    arms = record["monitor"].get("arms", ())
    if len(arms) > 1:
        raise UserError(
            f"{source}: the log has one arm, but the monitor was calibrated with the arms"
            f" {' and '.join(arms)} together. Calibrate the monitor again with only the arm of the"
            " log: --set 'campaign.arms=[\"NAME\"]'"
        )
    names = ["live", *input_expressions(monitor.terms, monitor.segments)]
    try:
        with open(source, newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            missing = [name for name in names if name not in (rows.fieldnames or ())]
            if missing:
                raise UserError(
                    f"{source}: has no column {', '.join(missing)}; {writing.VECTOR} shows the"
                    " expected columns"
                )
            log = np.array([[float(row[name]) for name in names] for row in rows], np.float64)
    except (OSError, UnicodeDecodeError) as error:
        raise StoreError(f"{source}: cannot be read ({error})") from None
    except (TypeError, ValueError) as error:
        raise UserError(
            f"{source}: line {rows.line_num}: expected a number in each column ({error})"
        ) from None
    length_ms = round(record["promise"]["operation_s"] * 1e3)
    if len(log) < length_ms:
        raise UserError(
            f"{source}: the log lasts {len(log)} ms, but the calibration's operations last"
            f" {length_ms} ms, and a maximum over a shorter time cannot be compared. Use a longer"
            " log"
        )
    columns = dict(zip(names, log[:length_ms].T, strict=True))
    live = columns.pop("live") != 0
    inputs = {name: values.astype(np.float32) for name, values in columns.items()}
    # The log is one operation, so the arrays have one row.
    peaks = series_scores(monitor, live, inputs)[None]
    hours = np.array([live.sum() / MS_PER_HOUR])
    origin = f"log {files.hash_file(source)}"
    return _operation_table(monitor, np.zeros(1, int), hours, peaks, origin)


def _operation_table(
    monitor: Monitor, unit: np.ndarray, hours: np.ndarray, peaks: np.ndarray, origin: str
) -> pd.DataFrame:
    """Return a table with a row per operation: the operator's number, the hours in which detectors
    are active, and the scores of the monitor.

    `peaks`: largest scores [operations, terms * segments].
    """
    columns = writing.score_columns(monitor, peaks)
    table = pd.DataFrame({"unit": unit, "hours": hours, **columns})
    table.attrs["origin"] = origin
    return table


def _require_different(sources: Sequence[Path], tables: Sequence[pd.DataFrame]):
    # Raises UserError if two sources contain operations of the same operators.
    source_of_origin: dict[str, Path] = {}
    for source, table in zip(sources, tables, strict=True):
        origin = table.attrs["origin"]
        if origin in source_of_origin:
            raise UserError(
                f"{source}: contains the same operators as {source_of_origin[origin]} ({origin})."
                " A check counts each operator once. Check the two sources separately"
            )
        source_of_origin[origin] = source


def _require_length(source: Path, seconds: float, record: dict[str, Any]):
    # Raises UserError if the operations are not as long as the operations of the calibration.
    expected = record["promise"]["operation_s"]
    if abs(seconds - expected) > 1e-6:
        raise UserError(
            f"{source}: an operation takes {seconds:g} s, but took {expected:g} s in the"
            " calibration. A score is the maximum over an operation, so operations of different"
            f" length cannot be compared. Run with campaign.duration_s = {expected:g}"
        )
