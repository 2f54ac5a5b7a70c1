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
from ravenjax.analyses.monitors.operations import FRESH, OperationDesign, OperationRunner
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
            _ = self.target.fewest_units
            self.stretches = Segments.parsed(self.segments)
        except ValueError as error:
            raise UserError(str(error)) from None
        # The campaign's detectors are not used, so parameters of user's detectors are left out.
        rest = {
            path: axis
            for path, axis in self.config.parameters.items()
            if not path.startswith("detectors.own.")
        }
        self.config = self.config.model_copy(update={"parameters": rest})


def calibrate_monitor(
    request: Request,
    out: Path,
    hours: float | None = None,
    engine: str = "auto",
    on_operator: OnOperator = lambda *_: None,
) -> Calibrated:
    """Simulate fault-free operations, calibrate the monitor, and write both into the folder `out`.

    `hours`: total hours of operation, of all operators and robots; None: as many as the target
    needs. Finished operators stay on disk, and the same call continues. Raise UserError and
    StoreError.
    """
    wanted = split_scores(choose_candidates(request.config.robot, request.signals or SIGNALS))
    units = calibration.units_within(request.target, request.robots, hours)
    design = OperationDesign(
        tuple(request.motions) or varying_motions(request.config),
        request.robots,
        request.target.length_h * 3600,
        request.seed,
    )
    peaks = operate_units(
        request.config, design, wanted, request.stretches, out, units, engine, on_operator
    )
    result = calibration.calibrate_thresholds(peaks, wanted, request.stretches, request.target)
    writing.write_monitor(out, request.config, design, result)
    return result


def operate_units(
    config: CampaignConfig,
    design: OperationDesign,
    wanted: tuple[Score, ...],
    segments: Segments,
    out: Path,
    units: int,
    engine: str,
    on_operator: OnOperator,
) -> OperationScores:
    """Return the scores of `units` operators. Operators missing in `out` are simulated."""
    folder = out / FOLDER
    score_folder.open_folder(folder, describe_design(config, design, wanted, segments))
    if missing := score_folder.list_missing(folder, units):
        detector_folder = folder / "detectors"
        with consent.given_for(detector_folder), interruption.held_back():
            measured = with_measuring_detectors(config, wanted, segments, detector_folder)
            for operator in OperationRunner(measured, design, engine).compute(missing):
                score_folder.add_scores(folder, operator)
                on_operator(operator.operator + 1, units)
    return score_folder.read_scores(folder, units)


def choose_candidates(robot: Robot, patterns: Sequence[str]) -> list[Score]:
    """Return the robot's candidate scores whose names match one of the patterns, in the robot's
    order. Raise UserError for a pattern without a match.
    """
    candidates = list_candidates(robot)
    names = [score.name for score in candidates]
    chosen = []
    for pattern in patterns:
        chosen += (found := fnmatch.filter(names, pattern))
        if not found:
            raise UserError(
                f"signal {pattern!r}: {robot.title} has no signal of this name; `ravenjax monitor"
                f" signals` lists all, and * stands for any letters{suggest_name(pattern, names)}"
            )
    return [score for score in candidates if score.name in chosen]


def varying_motions(config: CampaignConfig) -> tuple[str, ...]:
    """Return the names of the generated motions that depend on the seed."""
    from ravenjax.store.access.fault_free import UNVARIED

    return tuple(motion for motion in config.generated_motions() if motion not in UNVARIED)


def with_measuring_detectors(
    config: CampaignConfig, wanted: tuple[Score, ...], segments: Segments, detector_folder: Path
) -> CampaignConfig:
    """Return `config` with one detector for each score and segment.

    Their Python files are written into the folder `detector_folder`.
    """
    detector_folder.mkdir(parents=True, exist_ok=True)
    raw = []
    for t, term in enumerate(wanted):
        for s in range(segments.count):
            name = f"t{t}_{s}"
            path = (detector_folder / f"{name}.py").absolute()
            title = f"{term.words}, segment {s}"
            text = code.write_part([term], segments, title=title, segment=s)
            path.write_text(text, encoding="utf-8")
            raw.append({"name": name, "file": str(path)})
    detector = (
        type(config).model_validate({**config.model_dump(mode="json"), "detector": raw}).detector
    )
    return config.model_copy(update={"detector": detector})


def describe_design(
    config: CampaignConfig, design: OperationDesign, wanted: tuple[Score, ...], segments: Segments
) -> dict[str, Any]:
    """Return everything on which the scores of operations depend, as JSON values."""
    left_out = {"group", "detector", "stop", "outcomes", "reaction"}
    content = config.model_dump(mode="json", exclude=left_out)
    for name in ("name", "description", "seed", "duration_s", "limit", "chunk", "observe_ms"):
        content["campaign"].pop(name, None)
    for name in ("motion", "seed"):
        content.get("operator", {}).pop(name, None)
    return {
        "campaign": content,
        "design": dataclasses.asdict(design) | {"motions": list(design.motions)},
        "signals": [term.name for term in wanted],
        "segments": segments.words,
        "code": manifest.code_hash(config.robot),
    }


def operate_afresh(
    folder: Path,
    out: Path,
    hours: float,
    overrides: Sequence[str],
    robots: int | None,
    engine: str,
    on_operator: OnOperator,
) -> OperationScores:
    """Simulate operations of operators that the calibration in `folder` did not use, and write
    their scores into `out`.

    `overrides`: changes of the campaign, such as `parameters.plant.friction_scale=4`. `robots`:
    number of robots of each operator; default as in the calibration. Finished operators stay on
    disk, and the same call continues. Raise UserError and StoreError.
    """
    calibration.require_hours(hours)
    monitor, _ = writing.read_monitor(folder)
    record = read_design(folder / FOLDER)
    campaign, design = record["campaign"], record["design"]
    raw = campaign | {
        "campaign": campaign["campaign"] | {"name": "fresh"},
        "group": [{"name": "fresh"}],
    }
    config = loading.from_record(raw, overrides)
    own = OperationDesign(
        tuple(design["motions"]),
        robots or design["robots"],
        design["length_s"],
        design["seed"],
        FRESH,
    )
    units = round(hours * 3600 / (own.robots * own.length_s))
    if units < 1:
        raise UserError(
            f"--hours is {hours:g}, expected at least {own.robots * own.length_s / 3600:.3g}: one"
            f" operator has {own.robots} operations of {own.length_s:g} s"
        )
    wanted = tuple(dataclasses.replace(term, scales=(1.0,)) for term in monitor.terms)
    return operate_units(config, own, wanted, monitor.segments, out, units, engine, on_operator)
