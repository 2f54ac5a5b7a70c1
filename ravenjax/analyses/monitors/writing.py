"""Writes and reads the folder that contains a calibrated monitor."""

import dataclasses
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import tomlkit
from pydantic import TypeAdapter

from ravenjax import consent
from ravenjax.analyses.monitors import calibration, code, score_folder
from ravenjax.analyses.monitors.calibration import Calibrated
from ravenjax.analyses.monitors.monitor import Monitor, Segments, input_expressions
from ravenjax.analyses.monitors.operations import OperationDesign
from ravenjax.analyses.monitors.scores import Score
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.replay import PlannedCampaign
from ravenjax.campaign.loading import validate_tables
from ravenjax.engines.interface import Block
from ravenjax.errors import StoreError
from ravenjax.report import wording
from ravenjax.stats.conformal import threshold
from ravenjax.stats.conformal.threshold import OperationScores
from ravenjax.store import files, manifest

SCORE = "score"
RECORD, VECTOR, REFERENCE = "monitor.toml", "test_vector.csv", "reference.csv"
DETECTOR = "detector.toml"
"""File with a table [[detector]] for a campaign file: the monitor's file name and its threshold."""


def write_monitor(
    out: Path, config: CampaignConfig, design: OperationDesign, result: Calibrated
) -> None:
    """Write a monitor's code in Python and C, test vector, reference scores and record into the
    folder `out`, which already contains its operations.
    """
    monitor, notes = result.monitor, describe_promise(result, design)
    thresholds = [_nine_digits(monitor.threshold)]
    detector = {"name": "monitor", "file": code.PART, "threshold": thresholds}
    title = f"{' '.join(notes)} As a detector: threshold = {thresholds}"
    operations = score_folder.read_scores(out / score_folder.FOLDER)
    texts = {
        code.PART: code.write_part(monitor.terms, monitor.segments, monitor.scales, title),
        DETECTOR: "# Copy this table into a campaign. `file` is relative to its folder.\n"
        + tomlkit.dumps({"detector": [detector]}),
        **code.write_c(monitor, notes),
        VECTOR: _csv(compute_test_vector(config, monitor, design.seed)),
        REFERENCE: _csv(_reference(operations, monitor)),
    }
    for name, text in texts.items():
        files.write_text(out / name, text)
    templates = wording.text_templates(__package__)
    templates.filters |= {"short": _nine_digits, "toml": lambda x: tomlkit.item(x).as_string()}
    record = templates.get_template(f"{RECORD}.j2").render(
        config=config,
        design=design,
        result=result,
        promise=" ".join(notes),
        inputs=input_expressions(monitor.terms, monitor.segments),
        code=manifest.code_hash(config.robot),
        sha256={name: files.hash_file(out / name) for name in texts},
        asdict=dataclasses.asdict,
    )
    files.write_text(out / RECORD, record)


def describe_promise(result: Calibrated, design: OperationDesign) -> list[str]:
    """Return lines of text on the largest false-alarm rate of the monitor and its conditions."""
    template = wording.text_templates(__package__).get_template("promise.txt.j2")
    return template.render(
        target=result.target, threshold=result.threshold, design=design
    ).splitlines()


def read_monitor(folder: Path) -> tuple[Monitor, dict[str, Any]]:
    """Return the monitor of a folder, and the content of its file RECORD. Raise StoreError if a
    file is missing, damaged, or was changed after the calibration.
    """
    path = folder / RECORD
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        # The file has a scale for each segment, in `scales`. A Score itself needs a scale, here 1.
        terms = [table | {"scales": [1.0]} for table in content["term"]]
        scales = [tuple(map(_float32, table["scales"])) for table in content["term"]]
        monitor = Monitor(
            terms=TypeAdapter(tuple[Score, ...]).validate_python(terms),
            segments=Segments.parsed(content["monitor"]["segments"]),
            scales=tuple(scales),
            threshold=_float32(content["monitor"]["threshold"]),
        )
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be read ({error.strerror or error}); `ravenjax monitor calibrate`"
            " writes this file"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(
            f"{path}: does not describe a monitor ({type(error).__name__}: {error}). To write this"
            " file again, repeat `ravenjax monitor calibrate`, which reads the stored simulations"
        ) from None
    for name, digest in content.get("sha256", {}).items():
        file = files.path_inside(folder, name)
        if not file.is_file() or files.hash_file(file) != digest:
            raise StoreError(
                f"{file}: was changed after the calibration (expected sha256 {digest[:16]});"
                " calibrate again. The stored operations are used, so nothing is simulated again"
            )
    return monitor, content


def _reference(peaks: OperationScores, monitor: Monitor) -> pd.DataFrame:
    """Return the scores with which `ravenjax monitor check` compares the scores of new operations.
    There is one row for the first operation of each operator who did not determine the scales.
    """
    first = peaks.first_operations()
    determined_scales = calibration.assign_uses(first.unit).scale
    scores = {"operator": first.unit, **score_columns(monitor, first.score)}
    return pd.DataFrame(scores).loc[~determined_scales]


def score_columns(monitor: Monitor, peaks: np.ndarray) -> dict[str, np.ndarray]:
    """Return columns [operations] by name: the joint score (SCORE), and the score of each term in
    each segment. `peaks`: largest scores [operations, terms * segments].
    """
    names = [
        term.name if monitor.segments.count == 1 else f"{term.name}/{segment}"
        for term in monitor.terms
        for segment in range(monitor.segments.count)
    ]
    joint = threshold.joint_scores(peaks, np.array(monitor.scales))
    return {SCORE: joint, **dict(zip(names, peaks.T, strict=True))}


def _csv(table: pd.DataFrame) -> str:
    """Return CSV with nine digits per number, from which the bits of a float32 can be restored."""
    return table.to_csv(index=False, float_format="%.9g", lineterminator="\n")


def _nine_digits(value: float) -> float:
    """Round to nine digits, from which the bits of a float32 can be restored."""
    return float(f"{value:.9g}")


def _float32(value) -> float:
    return float(np.float32(value))


SECONDS = 3.0
"""Duration of the run whose signals become the test vector, s."""
FAULT = {
    "site": "usb_out",
    "effect": "overwrite",
    "value": 20000,
    "start_ms": 1500,
    "duration_ms": 100,
}
"""Fault of the test vector, for a robot with this site. It is large enough to cause an alarm."""


def compute_test_vector(config: CampaignConfig, monitor: Monitor, seed: int) -> pd.DataFrame:
    """Return a monitor's inputs and scores in each millisecond of a run, to test its C code.

    The table has one row per millisecond of the first arm of `config`'s robot. Columns: ms, live,
    the monitor's inputs, score (0 while not live), alarm. FAULT acts if the robot has its site.
    """
    with TemporaryDirectory() as folder, consent.trust_folders(Path(folder)):
        file = Path(folder) / "monitor.py"
        text = code.write_part(monitor.terms, monitor.segments, monitor.scales, stores_inputs=True)
        file.write_text(text, encoding="utf-8")
        # The arithmetic of this CPU engine equals that of C code.
        planned = PlannedCampaign(_test_vector_campaign(config, monitor, seed, file), "simd")
        program: Any = planned.plan.program
        # The campaign's only run, 0, in one lane: first without its fault, then with the fault.
        golden = Block(*planned.plan.lanes([0], 1, harmless=True), None)
        faulty = Block(*planned.plan.lanes([0], 1), None)
        tracer = planned.backend.tracer(program, 1)
        *_, signals = tracer.run(golden, faulty, planned.plan.columns)
    signals = program.loop.name_signals(program.setup, signals)
    # The campaign has one arm and one detector, so both indices are 0.
    detectors = signals["detectors"]
    detector_state = detectors.own[0][0]
    (last_score,) = detectors.detectors[0].recent
    score = np.asarray(last_score, np.float32)
    armed_after = planned.plan.numbers("detectors.armed_after")[0]
    live = np.asarray(signals["live"]).astype(bool) & (np.arange(len(score)) >= armed_after)
    inputs = {
        name: np.asarray(getattr(detector_state, f"read_{name}"), np.float32)
        for name in input_expressions(monitor.terms, monitor.segments)
    }
    alarm = score > np.float32(monitor.threshold)
    columns = {"live": live.astype(int), **inputs, "score": score, "alarm": alarm.astype(int)}
    return pd.DataFrame({"ms": range(len(score))} | columns)


def _test_vector_campaign(
    config: CampaignConfig, monitor: Monitor, seed: int, file: Path
) -> CampaignConfig:
    """Return a campaign with one short run of one arm, whose signals become the test vector. Its
    only detector is the monitor, in the Python file `file`. A fault gives large scores.
    """
    content, robot = config.model_dump(mode="json"), config.robot
    group: dict[str, Any] = {"name": "vector"}
    if FAULT["site"] in robot.sites:
        group["fault"] = [FAULT | {"channel": robot.joints[0]}]
    settings = {
        "duration_s": SECONDS,
        "arms": [config.campaign.arms[0]],
        "seed": seed,
        "limit": None,
        "observe_ms": None,
    }
    raw = content | {"reaction": None, "stop": None, "cross": {}, "group": [group]}
    raw["campaign"] = content["campaign"] | settings
    # Parameters with several values, and parameters of other arms, are left out.
    other_arms = {f".{arm}." for arm in config.campaign.arms[1:]}
    raw["parameters"] = {
        path: value
        for path, value in content["parameters"].items()
        if config.parameters[path].kind == "fixed" and not any(arm in path for arm in other_arms)
    }
    # With `consecutive` above 1, the detector's state has the last score, for the test vector.
    detector = {"name": "monitor", "file": str(file), "consecutive": 2}
    raw["detector"] = [detector | {"threshold": [monitor.threshold]}]
    return validate_tables(raw)
