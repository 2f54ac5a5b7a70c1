"""Study: how wrong is a healthy robot's reported tip, and what does the error change?

It compares a recording with drawn robots, and the main results with and without kinematic errors.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store import folder
from studies import kinds, runs
from studies.dsn16 import recording
from studies.hazards import severity
from studies.healthy_robot import arm_errors, camera_log, tip_error
from studies.healthy_robot.camera_log import CameraLog
from studies.healthy_robot.tip_error import ErrorSize
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    in_percent,
    own_line,
    read_notes,
    read_table,
    study,
)

NAME, COLUMN = "healthy_robot", "param:plant.kinematic_errors.scale"
OFF, HALF, FULL = SCALES = (0.0, 0.5, 1.0)

SHARES = {
    "unintended": f"unintended motion of more than {LIMIT_MM:g} mm",
    "evaded": "evades the checks: unintended motion, and nobody is told",
    "stopped": "a check stops the robot",
    "misreport": "false report",
    "cue3": "cue at 3 mm",
    "cue1": "cue at 1 mm",
    "missed3": "unintended motion before the cue of 3 mm, or without one",
    "deeper": f"more than {severity.DEPTH_MM:g} mm deeper in the tissue than the golden run",
}
"""Events, as shares of faults that changed a bit."""


class ScaledFaults(NamedTuple):
    """The same faults at every scale."""

    events: Mapping[float, pd.DataFrame]  # maps a scale to bool [faults], columns SHARES
    faults: Units  # kinds of the faults

    def share(self, event: str, scale: float) -> Rate:
        """Return the share of the faults, with its interval over kinds."""
        return units.rate_band(self.events[scale][event].to_numpy(), self.faults)

    def change(self, event: str, scale: float) -> Estimate:
        """Return the share at a scale minus the share without kinematic errors, over pairs, with
        its interval over kinds.
        """
        with_, without = (self.events[one][event].to_numpy() for one in (scale, OFF))
        return kinds.difference(with_, without, self.faults)


def scaled_faults(path: Path) -> ScaledFaults:
    """Return the faults of a result folder that changed a bit at every scale."""
    found = runs.read(path)
    frame = found.frame.loc[runs.changed_a_bit(found)].set_index("pair")
    warned = (frame["warned_ms"] >= 0) & (frame["warned_ms"] < frame["unintended_ms"])
    events = frame[["unintended", "evaded", "misreport"]].assign(
        stopped=frame["response"] == "stopped",
        cue3=frame["cue0_first_ms"] >= 0,
        cue1=frame["cue1_first_ms"] >= 0,
        missed3=frame["unintended"] & ~warned,
        deeper=frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"] > severity.DEPTH_MM,
    )
    parts = {scale: events[np.isclose(frame[COLUMN], scale)] for scale in SCALES}
    common = sorted(set.intersection(*(set(part.index) for part in parts.values())))
    kind = frame.loc[np.isclose(frame[COLUMN], OFF), "group"].loc[common]
    faults = units.group_units(kinds.names(kind))
    return ScaledFaults({scale: part.loc[common] for scale, part in parts.items()}, faults)


def measured_robots(path: Path) -> dict[float, pd.DataFrame]:
    """Return MEASURES of each robot [robots], by scale, from a result folder without faults."""
    frame = folder.read_all(path)
    measures = pd.DataFrame(
        {
            "largest": frame["peak_live_deviation_mm"],
            "rms": frame["rms_model_deviation_mm"],
            "cue3": 100.0 * (frame["cue0_first_ms"] >= 0),
            "cue1": 100.0 * (frame["cue1_first_ms"] >= 0),
            "depth": frame["tissue_depth_mm"],
        }
    ).set_index(frame["pair"])
    return {scale: measures.loc[np.isclose(frame[COLUMN], scale)] for scale in SCALES}


def mean(robots: pd.DataFrame, measure: str) -> Estimate:
    """Return the mean of a measure over robots, with a 95 % bootstrap interval over them."""
    values = robots[measure].to_numpy(float)
    band = units.ratio_band(values, 1.0, units.group_units(np.arange(len(values))))
    return Estimate(band.value, band.low, band.high)


FREE, FAULTS, EVERY_CYCLE = "free", "faults", "every_cycle"
ROBOTS = 500
EVERY, EVERY_OF_FIT = 60, 4
"""Spacing of the log's rows at which robots are compared, and at which the arm's errors are fitted.
Rows of one motion are 25 ms apart.
"""
BAND = (0.1, 0.9)
"""Quantiles over robots."""


def compare(context: Context) -> Findings:
    """Compare data with predictions, if the recording is available, and the main results without
    and with kinematic errors.
    """
    path = recording.locate(camera_log.FILE)
    log = None if path is None else camera_log.read(path)
    pairs, free = scaled_faults(context.folders[FAULTS]), measured_robots(context.folders[FREE])
    cycle = scaled_faults(context.folders[EVERY_CYCLE])
    absent = (f"Not at hand: {camera_log.FILE}. Set {recording.DATA} to its folder.",)
    return Findings(
        lines=(*(() if log is None else _report_lines(log)), *_headline_lines(pairs, cycle, free)),
        tables=(
            *(() if log is None else (_report(log), _explained(log))),
            _with_faults(pairs),
        ),
        notes=(*(absent if log is None else ()), *read_notes(NAME)),
    )


# --- the report of a recorded arm, and of drawn ones ---


def _report_lines(log: CameraLog) -> Iterator[Line]:
    """Yield lines over the half that was held back: the camera's measurements, and the middle robot
    with those of most others.
    """
    thin, robots = log.rows(slice(None, None, EVERY)), tip_error.draw(ROBOTS)
    true = tip_error.tips_of(thin, robots)
    _, second = tip_error.errors_of(log, log.camera)
    _, errors = tip_error.errors_of(thin, true)
    medians = np.median(errors, axis=1)
    camera, of = tip_error.size(second), "robots drawn, 10 to 90 % of them"
    split = float(tip_error.between(log, log.camera))
    for quantity, unit, value, drawn in (
        (
            "tip error after registration, median, second half",
            "mm",
            1e3 * camera.quantiles[1],
            1e3 * medians,
        ),
        (
            "tip errors above 3 mm, second half",
            "%",
            100 * camera.beyond,
            100 * (errors > tip_error.LIMIT_M).mean(axis=1),
        ),
        (
            "share of the mean square error that is between trajectories, second half",
            "",
            split,
            tip_error.between(thin, true),
        ),
        (
            "95 % quantile of the tip error over its median, second half",
            "",
            camera.quantiles[3] / camera.quantiles[1],
            np.quantile(errors, 0.95, axis=1) / medians,
        ),
    ):
        low, middle, high = np.quantile(drawn, (BAND[0], 0.5, BAND[1]))
        yield Line(
            quantity, unit, StudyEstimate(value), StudyEstimate(middle, low, high, ROBOTS, of)
        )


def _report(log: CameraLog) -> Table:
    thin = log.rows(slice(None, None, EVERY))
    robots = tip_error.draw(ROBOTS)
    first, second = tip_error.errors_of(log, log.camera)
    gauss = tip_error.size(tip_error.gaussian(log))
    zero = ErrorSize(np.zeros(len(tip_error.QUANTILES)), 0.0, 0.0)
    rows = [
        _row("cameras, first half", tip_error.size(first)),
        _row("cameras, second half", tip_error.size(second)),
        *_drawn_rows("drawn robots", tip_error.predicted(thin, robots)[1]),
        *_drawn_rows("drawn robots, half the errors", tip_error.predicted(thin, HALF * robots)[1]),
        _row("null: no errors, or a rigid displacement", zero),
        _row("null: isotropic Gaussian of the first half's rms", gauss),
    ]
    anew = tip_error.factor(thin, robots)
    return read_table(NAME, "report", rows, robots=ROBOTS, factor=anew)


def _row(name: str, one: ErrorSize) -> tuple[str, ...]:
    return (
        name,
        *(f"{1e3 * x:.2f}" for x in one.quantiles),
        f"{100 * one.beyond:.0f}",
        f"{1e3 * one.rms:.2f}",
    )


def _drawn_rows(name: str, errors: np.ndarray) -> Iterator[tuple[str, ...]]:
    """Return all robots' errors together, and the band over robots. `errors`: [robots, rows]."""
    yield _row(name, tip_error.size(errors.ravel()))
    sizes = [tip_error.size(one) for one in errors]
    columns = np.array([[*1e3 * one.quantiles, 100 * one.beyond, 1e3 * one.rms] for one in sizes])
    low, high = np.quantile(columns, BAND, axis=0)
    digits = (2, 2, 2, 2, 0, 2)
    yield (
        "  10 to 90 % of robots",
        *(f"{a:.{d}f} to {b:.{d}f}" for a, b, d in zip(low, high, digits, strict=True)),
    )


_PARTS = {
    "rigid motion alone": (),
    "and the point that the camera looks at": arm_errors.POINT,
    "and joint offsets": ("joint_offset",),
    "and drums": ("ratio_error",),
    "and links": ("links",),
    "and all errors of the arm": ("joint_offset", "ratio_error", "links"),
    "and all of these": ("joint_offset", "ratio_error", "links", *arm_errors.POINT),
}


def _explained(log: CameraLog) -> Table:
    rows = []
    for name, parts in _PARTS.items():
        one = arm_errors.fit(log.rows(slice(None, None, EVERY_OF_FIT)), parts)
        first, second = (tip_error.size(errors) for errors in one.left)
        rows.append(
            (
                name,
                f"{1e3 * first.quantiles[1]:.2f}",
                f"{1e3 * second.quantiles[1]:.2f}",
                f"{100 * second.beyond:.0f}",
                f"{1e3 * float(np.median(one.own[1])):.2f}",
            )
        )
    first, second = map(tip_error.size, tip_error.quadratic_left(log))
    medians = (f"{1e3 * one.quantiles[1]:.2f}" for one in (first, second))
    name = "null: a static quadratic map of the joints"
    rows.append((name, *medians, f"{100 * second.beyond:.0f}", ""))
    return read_table(NAME, "explained", rows)


# --- headlines ---


def _headline_lines(
    pairs: ScaledFaults, cycle: ScaledFaults, free: Mapping[float, pd.DataFrame]
) -> Iterator[Line]:
    design, names = "faults of this design", {OFF: "no kinematic errors"}
    names[FULL] = "measured"
    for event, words in SHARES.items():
        for scale, name in names.items():
            for some, packets in ((pairs, ""), (cycle, ", a packet each cycle")):
                rate, of = some.share(event, scale), f"{design}, {kinds.count(some.faults)}"
                yield own_line(f"{words}, {name}{packets}", "%", in_percent(rate, rate.n, of))
    for scale, name in names.items():
        value = StudyEstimate(*mean(free[scale], "rms"), len(free[scale]), "robots drawn")
        yield own_line(f"true tip from the nominal model without a fault, rms, {name}", "mm", value)


def _with_faults(pairs: ScaledFaults) -> Table:
    rows = (
        (
            words,
            *(_percent(pairs.share(event, scale)) for scale in SCALES),
            *(_points(pairs.change(event, scale)) for scale in (HALF, FULL)),
        )
        for event, words in SHARES.items()
    )
    return read_table(NAME, "headlines", rows, faults=len(pairs.events[OFF]))


def _percent(rate: Rate) -> str:
    return f"{100 * rate.value:.1f} ({100 * rate.low:.1f} to {100 * rate.high:.1f})"


def _points(one: Estimate) -> str:
    return f"{100 * one.value:+.1f} ({100 * one.low:+.1f} to {100 * one.high:+.1f})"


QUICK = (
    "campaign.kinematic_errors=measured",
    "cross.plant.kinematic_errors.scale=[0, 0.5, 1]",
    "haptics.threshold_mm=[3, 1]",
)
STUDY = study(
    NAME,
    (
        Variant(FREE, "healthy_robot.toml"),
        Variant(FAULTS, "quick.toml", QUICK),
        Variant(
            EVERY_CYCLE,
            "quick.toml",
            (*QUICK, f"campaign.packets={EVERY_CYCLE}"),
            "And with a packet in each control cycle?",
        ),
    ),
    compare,
)
