"""Study: how large is the tip error of a healthy robot, and which results does this error change?
It compares a recording with drawn robots, and headline numbers with and without the errors.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.stats import units
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.units import Units
from ravenjax.store import folder
from studies import kinds, runs, study
from studies.dsn16 import recording
from studies.hazards import classes
from studies.healthy_robot import arm_errors, camera_log, tip_error
from studies.healthy_robot.camera_log import CameraLog
from studies.study import StudyEstimate

NAME, COLUMN = "healthy_robot", "param:plant.kinematic_errors.scale"
FREE, FAULTS = "free", "faults"
OFF, HALF, FULL = SCALES = (0.0, 0.5, 1.0)
SHARES = {
    "unintended": f"unintended motion of more than {LIMIT_MM:g} mm",
    "evaded": "evades the checks: unintended motion without an alarm or a stop",
    "stopped": "a check stops the robot",
    "misreport": "false report",
    "cue3": "cue with a threshold of 3 mm",
    "cue1": "cue with a threshold of 1 mm",
    "unwarned": "unintended motion before the cue of 3 mm, or without this cue",
    "deeper": f"more than {classes.DEPTH_MM:g} mm deeper in the tissue than in the golden run",
}
"""Events, as shares of faults that changed a bit."""
ROBOTS = 500
EVERY, EVERY_OF_FIT = 60, 4
"""Spacing of the log's rows for robots and for the fit. Rows of one motion are 25 ms apart."""
BAND = (0.1, 0.9)
"""Quantiles over robots."""
PARTS = {
    "rigid motion": (),
    "rigid motion, camera's point": arm_errors.POINT,
    "rigid motion, joint offsets": ("joint_offset",),
    "rigid motion, drum ratios": ("ratio_error",),
    "rigid motion, links": ("links",),
    "rigid motion, all errors of the arm": ("joint_offset", "ratio_error", "links"),
    "all parameters": ("joint_offset", "ratio_error", "links", *arm_errors.POINT),
}
"""Parameters that are fitted to the recorded arm, in addition to a rigid motion."""


class ScaledFaults(NamedTuple):
    """The same faults at every scale."""

    events: Mapping[float, pd.DataFrame]  # maps a scale to bool [faults], columns SHARES
    faults: Units  # kinds of the faults

    def share(self, event: str, scale: float) -> Rate:
        """Return the share of the faults, with its interval over kinds."""
        return units.rate_band(self.events[scale][event].to_numpy(), self.faults)

    def change(self, event: str, scale: float) -> Estimate:
        """Return the share at a scale minus that without kinematic errors, over pairs."""
        with_, without = (self.events[at][event].to_numpy() for at in (scale, OFF))
        return kinds.difference(with_, without, self.faults)


def scaled_faults(path: Path) -> ScaledFaults:
    """Return the faults of a result folder that changed a bit at every scale."""
    found = runs.read(path)
    frame = found.frame.loc[runs.changed_a_bit(found)].set_index("pair")
    deeper_mm = frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"]
    events = frame.assign(
        cue3=frame["cue0_first_ms"] >= 0,
        cue1=frame["cue1_first_ms"] >= 0,
        deeper=deeper_mm > classes.DEPTH_MM,
    )[[*SHARES]]
    parts = {scale: events[np.isclose(frame[COLUMN], scale)] for scale in SCALES}
    common = sorted(set.intersection(*(set(part.index) for part in parts.values())))
    kind = frame.loc[np.isclose(frame[COLUMN], OFF), "group"].loc[common]
    faults = units.group_units(kinds.names(kind))
    return ScaledFaults({scale: part.loc[common] for scale, part in parts.items()}, faults)


def mean(values: np.ndarray) -> Estimate:
    """Return the mean over robots, with a 95 % bootstrap interval over them."""
    return units.ratio_band(values, 1.0, units.group_units(np.arange(len(values))))


def compare(context: study.Context) -> study.Findings:
    """Compare the recording, if any, with drawn robots, and headline numbers with errors."""
    path, pairs = recording.locate(camera_log.FILE), scaled_faults(context.folders[FAULTS])
    lines, tables, factor = [], {}, np.nan
    notes = [f"The recording {camera_log.FILE} was not found. Set {recording.DATA} to its folder."]
    if path is not None:
        lines, tables, factor = _report_findings(camera_log.read(path))
        notes = []
    return study.findings(
        NAME,
        [*lines, *_headline_lines(pairs, folder.read_all(context.folders[FREE]))],
        {**tables, "headlines": _headline_rows(pairs)},
        notes,
        robots=ROBOTS,
        factor=factor,
        faults=len(pairs.events[OFF]),
    )


def _report_findings(log: CameraLog) -> tuple[list[study.Line], study.Tables, float]:
    """Return lines for the second half of a log, tables of errors and of fits, and the factor on
    the distribution of errors that fits the log.
    """
    robots, thin = tip_error.draw(ROBOTS), log.rows(slice(None, None, EVERY))
    true = tip_error.tips_of(thin, robots)
    first, seen = tip_error.errors_of(log, log.camera)
    drawn, half = (tip_error.predicted(thin, share * robots)[1] for share in (FULL, HALF))
    rows = [_row("recorded arm, first half", first), _row("recorded arm, second half", seen)]
    for name, errors in {"drawn robots": drawn, "drawn robots, half of the errors": half}.items():
        ends = np.quantile([_numbers(of_robot) for of_robot in errors], BAND, axis=0)
        bands = zip(*map(_written, ends), strict=True)
        rows.append(_row(name, errors.ravel()))
        rows.append(("10 to 90 % of the robots", *(f"{low} to {high}" for low, high in bands)))
    rows.append(_row("null: no errors, or a rigid displacement", np.zeros(1)))
    rows.append(_row("null: isotropic Gaussian, rms of the first half", tip_error.gaussian(log)))
    (median, far), medians = np.quantile(seen, (0.5, 0.95)), np.median(drawn, axis=1)
    between = float(tip_error.between(log, log.camera)), tip_error.between(thin, true)
    above = 100 * (drawn > tip_error.LIMIT_M).mean(axis=1)
    tails = np.quantile(drawn, 0.95, axis=1) / medians
    lines = []
    for quantity, unit, value, of_robots in (
        ("median tip error after registration", "mm", 1e3 * median, 1e3 * medians),
        ("share of tip errors above 3 mm", "%", _beyond(seen), above),
        ("share of the mean square tip error from differences between trajectories", "", *between),
        ("95 % quantile of the tip error divided by its median", "", far / median, tails),
    ):
        low, middle, high = np.quantile(of_robots, (BAND[0], 0.5, BAND[1]))
        words = f"{quantity}, second half of the recording"
        predicted = StudyEstimate(middle, low, high, ROBOTS, "drawn robots, 10 to 90 % of them")
        lines.append(study.Line(words, unit, StudyEstimate(value), predicted))
    tables = {"report": rows, "explained": _explained_rows(log)}
    return lines, tables, tip_error.factor(thin, robots)


def _numbers(errors: np.ndarray) -> list[float]:
    quantiles = 1e3 * np.quantile(errors, (0.25, 0.5, 0.75, 0.95))
    return [*quantiles, _beyond(errors), 1e3 * tip_error.rms(errors)]


def _beyond(errors: np.ndarray) -> float:
    return 100 * float((errors > tip_error.LIMIT_M).mean())


def _written(numbers: np.ndarray | list[float]) -> list[str]:
    return [f"{x:.{digits}f}" for x, digits in zip(numbers, (2, 2, 2, 2, 0, 2), strict=True)]


def _row(name: str, errors: np.ndarray) -> tuple[str, ...]:
    return name, *_written(_numbers(errors))


def _explained_rows(log: CameraLog) -> Iterator[tuple[str, ...]]:
    def medians(*errors: np.ndarray) -> Iterator[str]:
        return (f"{1e3 * np.median(some):.2f}" for some in errors)

    for name, parts in PARTS.items():
        fit = arm_errors.fit(log.rows(slice(None, None, EVERY_OF_FIT)), parts)
        yield name, *medians(*fit.left), f"{_beyond(fit.left[1]):.0f}", *medians(fit.own[1])
    left = tip_error.quadratic_left(log)
    null = "null: static quadratic map of the joints"
    yield null, *medians(*left), f"{_beyond(left[1]):.0f}", ""


def _headline_lines(pairs: ScaledFaults, free: pd.DataFrame) -> Iterator[study.Line]:
    names = {OFF: "without kinematic errors", FULL: "with kinematic errors"}
    of = f"faults of the campaign, {kinds.count(pairs.faults)}"
    for event, words in SHARES.items():
        for scale, name in names.items():
            yield study.percent_line(f"{words}, {name}", pairs.share(event, scale), of)
    for scale, name in names.items():
        robots = free.loc[np.isclose(free[COLUMN], scale), "rms_model_deviation_mm"].to_numpy(float)
        value = StudyEstimate(*mean(robots), len(robots), "drawn robots")
        words = "rms distance of the true tip from the nominal model without a fault"
        yield study.own_line(f"{words}, {name}", "mm", value)


def _headline_rows(pairs: ScaledFaults) -> Iterator[tuple[str, ...]]:
    def percent(value: float, low: float, high: float, sign: str = "") -> str:
        return "{} ({} to {})".format(*(f"{100 * x:{sign}.1f}" for x in (value, low, high)))

    for event, words in SHARES.items():
        shares = (percent(*pairs.share(event, scale)[2:]) for scale in SCALES)
        changes = (percent(*pairs.change(event, scale), "+") for scale in (HALF, FULL))
        yield words, *shares, *changes


STUDY = study.study(NAME, study.read_variants(NAME), compare)
