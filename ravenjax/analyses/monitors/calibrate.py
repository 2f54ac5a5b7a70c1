"""Calibrates a monitor on fault-free operations and writes the monitor's folder."""

import dataclasses
import fnmatch
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ravenjax import consent, interruption
from ravenjax.analyses.monitors import calibration, code, score_folder, writing
from ravenjax.analyses.monitors.calibration import Calibrated
from ravenjax.analyses.monitors.monitor import Segments, split_scores
from ravenjax.analyses.monitors.operations import NEW_STREAM, OperationDesign, OperationRunner
from ravenjax.analyses.monitors.score_folder import FOLDER, read_design
from ravenjax.analyses.monitors.scores import Score, list_candidates
from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError, suggest_name
from ravenjax.stats.conformal.threshold import FalseAlarmTarget, OperationScores
from ravenjax.store import manifest
from ravenjax.vocabulary.robot import Robot

SIGNALS = ("tip_error_bound", "boards_cmd_rate*")
PER_HOUR, CONFIDENCE = 1.0, 0.95
LENGTH_S, ROBOTS = 300.0, 16
OnOperator = Callable[[int, int], None]
"""Called with the number of operators computed so far and the number wanted."""


@dataclasses.dataclass
class Request:
    """The settings of a calibration. Wrong settings raise UserError."""

    config: CampaignConfig
    signals: Sequence[str] = ()  # names of scores; * matches any letters; (): SIGNALS
    segments: str = ""  # text for `Segments.parsed`
    per_hour: float = PER_HOUR  # largest rate of false alarms
    confidence: float = CONFIDENCE  # probability that the rate is not exceeded
    length_s: float = LENGTH_S  # duration of an operation
    robots: int = ROBOTS  # number of robots, and operations, of each operator
    motions: Sequence[str] = ()  # (): every generated motion of the robot
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.length_s <= 3600:
            raise UserError(f"--length-s is {self.length_s:g}, expected 1 to 3600 s")
        if self.robots < 1:
            raise UserError(f"--robots is {self.robots}, expected 1 or more")
        if self.seed < 0:
            raise UserError(f"--seed is {self.seed}, expected 0 or more")
        self.target = FalseAlarmTarget(self.per_hour, self.confidence, self.length_s / 3600)
        try:
            # This property raises ValueError for a wrong target.
            _ = self.target.min_units
            self.parsed_segments = Segments.parsed(self.segments)
        except ValueError as error:
            raise UserError(str(error)) from None
        # The campaign's detectors are not used, so parameters of user's detectors are left out.
        parameters = {
            path: axis
            for path, axis in self.config.parameters.items()
            if not path.startswith("detectors.own.")
        }
        self.config = self.config.model_copy(update={"parameters": parameters})


def calibrate_monitor(
    request: Request,
    out: Path,
    hours: float | None,
    engine: str,
    on_operator: OnOperator = lambda *_: None,
) -> Calibrated:
    """Simulate fault-free operations, calibrate the monitor, and write both into the folder `out`.

    `hours`: total hours of operation, of all operators and robots; None: as many as the target
    needs. Finished operators stay on disk; the same call continues. Raise UserError, StoreError.
    """
    terms = split_scores(choose_candidates(request.config.robot, request.signals or SIGNALS))
    units = calibration.operators_within(request.target, request.robots, hours)
    design = OperationDesign(
        motions=tuple(request.motions) or varying_motions(request.config),
        robots=request.robots,
        # The target stores the length in hours. Converted back, both agree in every digit.
        length_s=request.target.length_h * 3600,
        seed=request.seed,
    )
    segments = request.parsed_segments
    peaks = simulate_operators(
        request.config, design, terms, segments, out, units, engine=engine, on_operator=on_operator
    )
    result = calibration.calibrate_thresholds(peaks, terms, segments, request.target)
    writing.write_monitor(out, request.config, design, result)
    return result


def simulate_operators(
    config: CampaignConfig,
    design: OperationDesign,
    terms: tuple[Score, ...],
    segments: Segments,
    out: Path,
    units: int,
    engine: str,
    on_operator: OnOperator,
) -> OperationScores:
    """Simulate operators and return their scores: the largest of each term in each segment.

    units: number of operators. The folder `out` stores the scores of each operator. Only operators
    that are missing there are simulated. `on_operator` is called after each of them.
    """
    folder = out / FOLDER
    score_folder.open_folder(folder, describe_design(config, design, terms, segments))
    if missing := score_folder.list_missing(folder, units):
        detector_folder = folder / "detectors"
        # An interruption waits until the operator that is being stored is complete.
        with consent.trust_folders(detector_folder), interruption.delay_signals():
            campaign = campaign_with_score_detectors(config, terms, segments, detector_folder)
            for operator in OperationRunner(campaign, design, engine).compute(missing):
                score_folder.add_scores(folder, operator)
                # Operators are computed in order, so k + 1 are finished after operator k.
                on_operator(operator.operator + 1, units)
    return score_folder.read_scores(folder, units)


def choose_candidates(robot: Robot, patterns: Sequence[str]) -> list[Score]:
    """Return the robot's candidate scores whose names match at least one pattern, in the robot's
    order. In a pattern, * stands for any letters. Raise UserError for a pattern without a match.
    """
    candidates = list_candidates(robot)
    names = [score.name for score in candidates]
    chosen_names = set()
    for pattern in patterns:
        matches = fnmatch.filter(names, pattern)
        if not matches:
            raise UserError(
                f"signal {pattern!r}: {robot.title} has no signal of this name; `ravenjax monitor"
                f" signals` lists all, and * stands for any letters{suggest_name(pattern, names)}"
            )
        chosen_names.update(matches)
    return [score for score in candidates if score.name in chosen_names]


def varying_motions(config: CampaignConfig) -> tuple[str, ...]:
    """Return the names of the generated motions that depend on the seed."""
    from ravenjax.store.access.fault_free import UNVARIED

    return tuple(motion for motion in config.generated_motions() if motion not in UNVARIED)


def campaign_with_score_detectors(
    config: CampaignConfig, terms: tuple[Score, ...], segments: Segments, detector_folder: Path
) -> CampaignConfig:
    """Return `config` with one detector for each term and segment, instead of its detectors.

    A detector records the largest score of its term in its segment. The Python files of the
    detectors are written into the folder `detector_folder`.
    """
    detector_folder.mkdir(parents=True, exist_ok=True)
    tables = []
    for term_index, term in enumerate(terms):
        for segment in range(segments.count):
            name = f"t{term_index}_{segment}"
            path = (detector_folder / f"{name}.py").absolute()
            title = f"{term.words}, segment {segment}"
            text = code.write_part([term], segments, title=title, segment=segment)
            path.write_text(text, encoding="utf-8")
            tables.append({"name": name, "file": str(path)})
    # Only its detectors are used, because JSON cannot express all values of the campaign.
    raw = {**config.model_dump(mode="json"), "detector": tables}
    detectors = type(config).model_validate(raw).detector
    return config.model_copy(update={"detector": detectors})


def describe_design(
    config: CampaignConfig, design: OperationDesign, terms: tuple[Score, ...], segments: Segments
) -> dict[str, Any]:
    """Return everything on which the scores of operations depend, as JSON values: the campaign, the
    design of the operations, the names of the terms, the segments and a hash of the code.
    """
    # These tables and keys have no effect on fault-free operations, or `design` has their values.
    unused_tables = {"group", "detector", "stop", "outcomes", "reaction"}
    campaign = config.model_dump(mode="json", exclude=unused_tables)
    for key in ("name", "description", "seed", "duration_s", "limit", "chunk", "observe_ms"):
        campaign["campaign"].pop(key, None)
    for key in ("motion", "seed"):
        campaign.get("operator", {}).pop(key, None)
    return {
        "campaign": campaign,
        "design": dataclasses.asdict(design) | {"motions": list(design.motions)},
        "signals": [term.name for term in terms],
        "segments": segments.words,
        "code": manifest.code_hash(config.robot),
    }


def simulate_new_operators(
    folder: Path,
    out: Path,
    hours: float,
    overrides: Sequence[str],
    robots: int | None,
    engine: str,
    on_operator: OnOperator,
) -> OperationScores:
    """Simulate operations of operators that the calibration in `folder` did not use, write their
    scores into `out`, and return them.

    `hours`: total hours of operation. `overrides`: changes of the campaign, such as
    `parameters.plant.friction_scale=4`. `robots`: number of robots of each operator; default as in
    the calibration. Finished operators stay on disk, and the same call continues. Raise UserError
    and StoreError.
    """
    calibration.require_hours(hours)
    monitor, _ = writing.read_monitor(folder)
    record = read_design(folder / FOLDER)
    campaign, calibration_design = record["campaign"], record["design"]
    # The stored campaign has no name and no groups, but a campaign needs both.
    raw = campaign | {
        "campaign": campaign["campaign"] | {"name": "fresh"},
        "group": [{"name": "fresh"}],
    }
    config = loading.from_record(raw, overrides)
    design = OperationDesign(
        motions=tuple(calibration_design["motions"]),
        robots=robots or calibration_design["robots"],
        length_s=calibration_design["length_s"],
        seed=calibration_design["seed"],
        stream=NEW_STREAM,
    )
    hours_per_operator = design.robots * design.length_s / 3600
    units = round(hours / hours_per_operator)
    if units < 1:
        raise UserError(
            f"--hours is {hours:g}, expected at least {hours_per_operator:.3g}: one"
            f" operator has {design.robots} operations of {design.length_s:g} s"
        )
    terms = tuple(dataclasses.replace(term, scales=(1.0,)) for term in monitor.terms)
    return simulate_operators(
        config, design, terms, monitor.segments, out, units, engine=engine, on_operator=on_operator
    )
