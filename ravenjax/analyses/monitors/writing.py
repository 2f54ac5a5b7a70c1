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
from ravenjax.report import wording
from ravenjax.store import files, manifest

SCORE = "score"
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
    operations = score_folder.read_scores(out / score_folder.FOLDER)
    texts = {
        code.PART: code.write_part(monitor.terms, monitor.segments, monitor.scales, title),
        DETECTOR: "# Copy this into a campaign; file is taken from its folder on.\n"
        + tomlkit.dumps({"detector": [detector]}),
        **code.write_c(monitor, notes),
        VECTOR: _csv(test_vector.compute_test_vector(config, monitor, design.seed, ENGINE)),
        REFERENCE: _csv(_reference(operations, monitor)),
    }
    for name, text in texts.items():
        files.write_text(out / name, text)
    record = _record(config, design, result)
    record["sha256"] = {name: files.hash_file(out / name) for name in texts}
    head = "# Written by `ravenjax monitor calibrate`.\n\n"
    files.write_text(out / RECORD, head + tomlkit.dumps(record))


def describe_promise(result: Calibrated, design: OperationDesign) -> list[str]:
    """Return the promise, its scope and its basis, as lines."""
    template = wording.text_templates(__package__).get_template("promise.txt.j2")
    return template.render(
        target=result.target, threshold=result.threshold, design=design
    ).splitlines()


def _record(config: CampaignConfig, design: OperationDesign, result: Calibrated) -> dict[str, Any]:
    """Return the tables of monitor.toml that depend only on the result."""
    tested, monitor = result.test, result.monitor
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
        "calibration": result.threshold._asdict() | {"units_for_scales": result.learned_units},
        "test": tested._asdict()
        | {"alarms_per_hour": tested.per_hour, "one_each": tested.one_each._asdict()},
        "design": dataclasses.asdict(design)
        | {"campaign": config.campaign.name, "code": manifest.code_hash(config.robot)},
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
        monitor = Monitor(
            terms,
            Segments.parsed(content["monitor"]["segments"]),
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
    fields = {key: value for key, value in table.items() if key != "alarm_above"}
    return Score(**fields | lists | {"scales": (1.0,)})


def _reference(peaks: score_folder.Peaks, monitor: Monitor) -> pd.DataFrame:
    """Return the first operation of each operator that provided no scale, for tests for a shift."""
    _, first = np.unique(peaks.unit, return_index=True)
    some = peaks.taken_from(first)
    some = some.taken_from(~calibration.assign_uses(some.unit).scale)
    return pd.DataFrame({"operator": some.unit, **score_columns(monitor, some.peak)})


def score_columns(monitor: Monitor, peak: np.ndarray) -> dict[str, np.ndarray]:
    """Return SCORE, the joint score of each operation, and the columns of `peak` by the name of
    their term and segment.
    """
    names = [
        term.name if monitor.segments.count == 1 else f"{term.name}/{segment}"
        for term in monitor.terms
        for segment in range(monitor.segments.count)
    ]
    joint = calibration.joint_scores(peak, np.array(monitor.scales, np.float32))
    return {SCORE: joint, **dict(zip(names, peak.T, strict=True))}


def _csv(table: pd.DataFrame) -> str:
    """Return CSV with nine digits per number, from which the bits of a float32 can be restored."""
    return table.to_csv(index=False, float_format="%.9g", lineterminator="\n")


def _short(value: float) -> float:
    """Return the same float32 in nine digits."""
    return float(f"{value:.9g}")


def _float32(value: Any) -> float:
    return float(np.float32(value))
