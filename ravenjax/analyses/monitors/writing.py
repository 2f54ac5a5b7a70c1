"""Writes and reads the folder of a monitor."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomlkit

from ravenjax.analyses.monitors import calibration, code, score_folder, test_vector
from ravenjax.analyses.monitors.calibration import Calibrated
from ravenjax.analyses.monitors.monitor import Monitor, Segments, list_reads
from ravenjax.analyses.monitors.operations import OperationDesign
from ravenjax.analyses.monitors.scores import Score
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import StoreError
from ravenjax.store import files, manifest

RECORD, VECTOR, REFERENCE = "monitor.toml", "test_vector.csv", "reference.csv"
DETECTOR = "detector.toml"
"""File of the part as a campaign names it, with its threshold."""
ENGINE = "simd"
"""Engine of the test vector. It is a CPU engine, because its arithmetic equals that of C."""


def write_monitor(
    out: Path, config: CampaignConfig, design: OperationDesign, result: Calibrated
) -> None:
    """Write everything except the operations, which are in `out` already."""
    monitor, notes = result.monitor, describe_promise(result, design)
    detector = {"name": "monitor", "file": code.PART, "threshold": [_short(monitor.threshold)]}
    title = f"{' '.join(notes)} As a detector: threshold = {detector['threshold']}"
    operations = out / score_folder.FOLDER
    texts = {
        code.PART: code.write_part(monitor.terms, monitor.segments, monitor.scales, title),
        DETECTOR: "# Copy this into a campaign; file is taken from its folder on.\n"
        + tomlkit.dumps({"detector": [detector]}),
        **code.write_c(monitor, notes),
        VECTOR: _csv(test_vector.compute_test_vector(config, monitor, design.seed, ENGINE)),
        REFERENCE: _csv(_reference(score_folder.read_scores(operations), monitor, result)),
    }
    for name, text in texts.items():
        files.write_text(out / name, text)
    record = _record(config, design, result)
    record["design"]["operations_sha256"] = score_folder.hash_scores(operations)
    record["sha256"] = {name: files.hash_file(out / name) for name in texts}
    head = "# Written by `ravenjax monitor calibrate`.\n\n"
    files.write_text(out / RECORD, head + tomlkit.dumps(record))


def describe_promise(result: Calibrated, design: OperationDesign) -> list[str]:
    """Return the promise, its scope and its basis, as lines."""
    target, own = result.target, result.threshold
    return [
        (
            f"At most {target.per_hour:g} false alarms an hour in which the robot follows the"
            f" operator, with {target.confidence:.4g} confidence, where an alarm ends an operation"
            f" of {design.length_s:g} s."
        ),
        (
            f"Threshold from {own.operations} operations, {own.hours:.4g} h, of {own.units}"
            f" operators ({', '.join(design.motions)}), each with {design.robots}"
            f" robot{'s' if design.robots > 1 else ''} of the campaign."
        ),
        (
            "It is the mean over operators and robots drawn so, in simulation; of one robot it may"
            " be more."
        ),
    ]


def _record(config: CampaignConfig, design: OperationDesign, result: Calibrated) -> dict[str, Any]:
    """Return the tables of monitor.toml that depend only on the result."""
    own, tested, monitor = result.threshold, result.test, result.monitor
    return {
        "monitor": {
            "robot": config.campaign.robot,
            "arms": list(config.campaign.arms),
            "live": config.robot.live,
            "threshold": _short(monitor.threshold),
            "segments": monitor.segments.words,
            "reads": list(list_reads(monitor.terms, monitor.segments)),
        },
        "promise": {
            "false_alarms_per_hour": result.target.per_hour,
            "confidence": result.target.confidence,
            "operation_s": design.length_s,
            "words": " ".join(describe_promise(result, design)),
        },
        "calibration": {
            "operators": own.units,
            "operations": own.operations,
            "hours": own.hours,
            "alarms": own.alarms,
            "p": own.p,
            "operators_for_scales": result.learned_units,
            "method": (
                "risk-controlling threshold of the maximum over an operation, operators as units"
            ),
        },
        "test": {
            "operators": tested.units,
            "operations": tested.operations,
            "hours": tested.hours,
            "alarms": tested.alarms,
            "alarms_per_hour": tested.per_hour,
            "one_each_alarms": tested.one_each.count,
            "one_each_hours": tested.one_each.hours,
            "one_each_low": tested.one_each.low,
            "one_each_high": tested.one_each.high,
        },
        "design": {
            "campaign": config.campaign.name,
            "motions": list(design.motions),
            "robots": design.robots,
            "seed": design.seed,
            "code": manifest.code_hash(config.robot),
        },
        "term": [
            dataclasses.asdict(term)
            | {"scales": list(map(_short, scales)), "alarm_above": list(map(_short, limits))}
            for term, scales, limits in zip(
                monitor.terms, monitor.scales, monitor.limits.tolist(), strict=True
            )
        ],
    }


def read_monitor(folder: Path) -> tuple[Monitor, dict[str, Any]]:
    """Read the monitor of a folder and its record. Raises StoreError."""
    path = folder / RECORD
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        terms = tuple(_term(table) for table in content["term"])
        words = content["monitor"]["segments"]
        monitor = Monitor(
            terms,
            Segments.parsed(words) if words else Segments(),
            tuple(tuple(map(_float32, one["scales"])) for one in content["term"]),
            _float32(content["monitor"]["threshold"]),
        )
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be read ({error.strerror or error}); `ravenjax monitor calibrate`"
            " writes one"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(
            f"{path}: is no record of a monitor ({type(error).__name__}: {error})"
        ) from None
    for name, digest in content.get("sha256", {}).items():
        file = files.path_inside(folder, name)
        if not file.is_file() or files.hash_file(file) != digest:
            raise StoreError(
                f"{file}: is not what the calibration wrote (sha256 expected"
                f" {digest[:16]}); calibrate again, its operations are there already"
            )
    return monitor, content


def _term(table: dict[str, Any]) -> Score:
    lists = {key: tuple(table[key]) for key in ("channels", "labels", "units")}
    fields: dict[str, Any] = {key: value for key, value in table.items() if key != "alarm_above"}
    fields |= lists | {"scales": (1.0,)}
    return Score(**fields)


def _reference(peaks: score_folder.Peaks, monitor: Monitor, result: Calibrated) -> pd.DataFrame:
    """Return the first operation of each operator that provided no scale, for tests for a shift."""
    _, first = np.unique(peaks.unit, return_index=True)
    some = peaks.taken_from(first)
    some = some.taken_from(~calibration.assign_uses(some.unit).scale)
    score = calibration.joint_scores(some.peak, np.array(monitor.scales, np.float32))
    columns = dict(zip(measured_names(monitor), some.peak.T, strict=True))
    return pd.DataFrame({"operator": some.unit, "score": score, **columns})


def measured_names(monitor: Monitor) -> list[str]:
    """Return the name of each term in each segment, in the order of the operations' columns."""
    if monitor.segments.count == 1:
        return [term.name for term in monitor.terms]
    return [
        f"{term.name}/{segment}"
        for term in monitor.terms
        for segment in range(monitor.segments.count)
    ]


def _csv(table: pd.DataFrame) -> str:
    """Return CSV with nine digits per number, from which the bits of a float32 can be restored."""
    return table.to_csv(index=False, float_format="%.9g", lineterminator="\n")


def _short(value: float) -> float:
    """Return the same float32 in nine digits."""
    return float(f"{value:.9g}")


def _float32(value: Any) -> float:
    return float(np.float32(value))
