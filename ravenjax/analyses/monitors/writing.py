"""The folder of a monitor: its files, and their checksums."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.monitors import c_code, calibration, monitor_file, score_folder, test_vector
from ravenjax.analyses.monitors.calibration import Calibrated
from ravenjax.analyses.monitors.monitor import Monitor, Segments, reads
from ravenjax.analyses.monitors.operations import OperationDesign
from ravenjax.analyses.monitors.scores import Score
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import StoreError
from ravenjax.store import files, manifest

RECORD, PART, VECTOR, REFERENCE = "monitor.toml", "monitor.py", "test_vector.csv", "reference.csv"
DETECTOR = "detector.toml"
"""The part as a campaign names it: a detector alarms above 1 unless it is given its threshold."""
ENGINE = "simd"
"""Of the test vector: a CPU's, whose operations are C's, whatever computed the operations."""


def write(out: Path, config: CampaignConfig, design: OperationDesign, result: Calibrated) -> None:
    """Write everything but the operations, which lie in `out` already."""
    monitor, notes = result.monitor, promise(result, design)
    vector = test_vector.of(config, monitor, design.seed, ENGINE)
    texts = {
        PART: monitor_file.text(
            monitor, f"{' '.join(notes)} As a detector: threshold = {_threshold(monitor)}"
        ),
        DETECTOR: detector(monitor),
        c_code.HEADER: c_code.header(monitor, notes),
        c_code.SOURCE: c_code.source(monitor),
        c_code.TEST: c_code.test(monitor),
        VECTOR: vector.text(),
        REFERENCE: _reference(score_folder.read(out / score_folder.FOLDER), monitor, result),
    }
    for name, text in texts.items():
        _put(out / name, text)
    digests = {name: files.sha256(out / name) for name in texts}
    _put(
        out / RECORD,
        record(config, design, result, digests, score_folder.digest(out / score_folder.FOLDER)),
    )


def promise(result: Calibrated, design: OperationDesign) -> list[str]:
    """What is promised, to whom, and what it rests on, in lines."""
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


def detector(monitor: Monitor) -> str:
    """detector.toml: what a campaign beside monitor.py takes to have it as a detector with its
    threshold.
    """
    lines = ["# Copy this into a campaign; file is taken from its folder on."]
    lines += [
        "[[detector]]",
        'name = "monitor"',
        f'file = "{PART}"',
        f"threshold = {_threshold(monitor)}",
    ]
    return "\n".join(lines) + "\n"


def record(
    config: CampaignConfig,
    design: OperationDesign,
    result: Calibrated,
    digests: dict[str, str],
    operations: str,
) -> str:
    """monitor.toml."""
    own, tested, monitor = result.threshold, result.test, result.monitor
    tables: dict[str, dict[str, Any]] = {
        "monitor": {
            "robot": config.campaign.robot,
            "arms": list(config.campaign.arms),
            "live": config.robot.live,
            "threshold": monitor.threshold,
            "segments": monitor.segments.words,
            "reads": list(reads(monitor.terms, monitor.segments)),
        },
        "promise": {
            "false_alarms_per_hour": result.target.per_hour,
            "confidence": result.target.confidence,
            "operation_s": design.length_s,
            "words": " ".join(promise(result, design)),
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
            "operations_sha256": operations,
        },
        "sha256": digests,
    }
    lines = ["# Written by `ravenjax monitor calibrate`."]
    for name, table in tables.items():
        lines += [
            "",
            f"[{name}]",
            *(f"{_key(key)} = {_value(value)}" for key, value in table.items()),
        ]
    for term, scales, limits in zip(
        monitor.terms, monitor.scales, monitor.limits.tolist(), strict=True
    ):
        entries = {
            "name": term.name,
            "kind": term.kind,
            "signal": term.signal,
            "against": term.against,
            "channels": list(term.channels),
            "labels": list(term.labels),
            "unit": term.units[0],
            "layer": term.layer,
            "scales": list(scales),
            "alarm_above": limits,
        }
        lines += ["", "[[term]]", *(f"{key} = {_value(value)}" for key, value in entries.items())]
    return "\n".join(lines) + "\n"


def read(folder: Path) -> tuple[Monitor, dict[str, Any]]:
    """The monitor of a folder, and all of its record. Raises StoreError for what is none, or was
    changed.
    """
    path = folder / RECORD
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        terms = tuple(
            Score(
                one["name"],
                one["kind"],
                one["signal"],
                tuple(one["channels"]),
                tuple(one["labels"]),
                (one["unit"],),
                (1.0,),
                one["layer"],
                one["against"],
            )
            for one in content["term"]
        )
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
        if not (folder / name).is_file() or files.sha256(folder / name) != digest:
            raise StoreError(
                f"{folder / name}: is not what the calibration wrote (sha256 expected"
                f" {digest[:16]}); calibrate again, its operations are there already"
            )
    return monitor, content


def _reference(peaks: score_folder.Peaks, monitor: Monitor, result: Calibrated) -> str:
    """reference.csv: the first operation of each operator that learned no scale, for tests for a
    shift.
    """
    _, first = np.unique(peaks.unit, return_index=True)
    some = peaks.taken_from(first)
    some = some.taken_from(~calibration.uses(some.unit).scale)
    score = calibration.joint(some, np.array(monitor.scales, np.float32))
    rows = [",".join(["operator", "score", *measured_names(monitor)])]
    rows += [
        ",".join([str(unit), *(f"{number:.9g}" for number in (own, *peak))])
        for unit, own, peak in zip(
            some.unit.tolist(), score.tolist(), some.peak.tolist(), strict=True
        )
    ]
    return "\n".join(rows) + "\n"


def measured_names(monitor: Monitor) -> list[str]:
    """Of each term in each segment, in the order of the operations' columns."""
    if monitor.segments.count == 1:
        return [term.name for term in monitor.terms]
    return [
        f"{term.name}/{segment}"
        for term in monitor.terms
        for segment in range(monitor.segments.count)
    ]


def _put(path: Path, text: str) -> None:
    files.write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def _threshold(monitor: Monitor) -> str:
    return _value([monitor.threshold])


def _float32(value: Any) -> float:
    """Nine digits give its bits back."""
    return float(np.float32(value))


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        word = f"{value:.9g}"
        return word if any(mark in word for mark in ".en") else f"{word}.0"
    return json.dumps(value, ensure_ascii=False)
