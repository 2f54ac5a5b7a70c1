"""Study of the fault-free tip error of the training simulator at four teleoperation scales (IROS
2016, Figure 3; targets A5, A6). The tip error is the distance that triggers the cue, from the
reported tip to the tip of the nominal model.
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from studies import study
from studies.runs import SCALE
from studies.seed.motions import MODELLED, by_setting, over_kinds
from studies.series import Recorder, Row, Series, rises
from studies.study import Line, Published, StudyEstimate, read_table

REST_TICKS = 500
"""Ticks for which the hand rests at the beginning of every generated motion."""


class RunSegment(NamedTuple):
    """Measurements of one run from the first motion on, until its end or the robot's stop."""

    group: str  # group of the campaign: what differs from the modelled robot
    scale: float
    peak_mm: float
    mean_mm: float
    true_mean_mm: float  # of the true tip
    zeroed_mean_mm: float  # of the measured tip, minus its offset at rest
    rest_mm: float  # tip error at rest, before the motion
    pulses: int  # of the cue
    stop_ms: int  # time at which the robot stopped, without a fault; -1: never


def segment(row: Row, series: Series) -> RunSegment:
    """Measure a run from its row of the result table and its series."""
    stop, error = int(row["check_estop_first_ms"]), series["tip_error_mm"]
    end = len(error) if stop < 0 else stop
    moving = slice(REST_TICKS, max(end, REST_TICKS + 1))
    apart = (series["position"] - series["model_position"]) * 1e3
    zeroed = np.linalg.norm(apart - apart[REST_TICKS - 1], axis=1)
    true = np.linalg.norm(series["tip"] - series["model_position"], axis=1) * 1e3
    return RunSegment(
        group=str(row["group"]),
        scale=float(row[SCALE]),
        peak_mm=float(error[moving].max()),
        mean_mm=float(error[moving].mean()),
        true_mean_mm=float(true[moving].mean()),
        zeroed_mean_mm=float(zeroed[moving].mean()),
        rest_mm=float(error[REST_TICKS - 1]),
        pulses=len(rises(series["cue_force"][moving] > 0.0)),
        stop_ms=stop,
    )


class Growth(NamedTuple):
    """A straight line through a quantity at several scales."""

    slope: float  # mm per unit of scale
    at_zero: float  # mm
    explained: float  # share of the variance, R2


def growth(scales: Sequence[float], values: Iterable[float]) -> Growth:
    """Fit by least squares. Needs at least three scales."""
    x, y = np.asarray(scales, float), np.asarray(values, float)
    slope, at_zero = np.polyfit(x, y, 1)
    rest, about = y - slope * x - at_zero, y - y.mean()
    explained = float(1.0 - rest @ rest / (about @ about)) if about.any() else 1.0
    return Growth(float(slope), float(at_zero), explained)


NAME = "seed_fault_free"
SCALES = (0.05, 0.1, 0.15, 0.2)
KINDS = ("peak", "mean")
FIGURE = "four readings of Figure 3"
NOISE = "noise"
"""The campaign's group with noise of encoders and motors, in the robot's own sizes."""
VARIANTS = study.read_variants(NAME)
READINGS = {
    "mean_mm": "as the cue sees it: measured tip to nominal model",
    "true_mean_mm": "true tip to nominal model",
    "zeroed_mean_mm": "measured tip, model begun at the measured pose",
}
LINES = {
    "explained": "variance of the {}s that a straight line over the scale explains",
    "slope": "{} tip error, slope over the scale",
    "at_zero": "{} tip error, the line's value at scale 0",
}
LINEAR = {
    "peak": "at scale 0.2 the fault-free command of fast motions is clipped by the overdrive check:"
    " the peaks bend up",
    "mean": "dry friction and the offset at rest do not shrink with the scale",
}
"""Why a line does not explain all."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """The segments of one answer to the open questions: a row each, in the order of the motions."""

    frame: pd.DataFrame

    def by_motion(self, field: str) -> pd.DataFrame:
        """Return a quantity by motion and scale."""
        motions = pd.MultiIndex.from_frame(self.frame[["kind", "seed"]].drop_duplicates())
        table = self.frame.pivot(index=["kind", "seed"], columns="scale", values=field)
        return table.reindex(motions)[[*SCALES]]

    def at(self, scale: float, field: str) -> StudyEstimate:
        """Return the mean over kinds of motion of a quantity at one scale."""
        return over_kinds(self.by_motion(field)[scale])

    def all_segments(self, field: str = "mean_mm") -> pd.Series:
        """Return the mean over the four scales, for each motion."""
        return self.by_motion(field).mean(axis=1)

    def lines(self, field: str, of: str) -> pd.Series:
        """Return a field of the straight line through the four scales, for each motion."""
        return self.by_motion(field).apply(lambda row: getattr(growth(SCALES, row), of), axis=1)

    @property
    def cues(self) -> int:
        """Return the number of segments in which the cue fires."""
        return int((self.frame["pulses"] > 0).sum())


def compare(context: study.Context) -> study.Findings:
    """Measure every segment and compare it with the paper's."""
    settings, published = _measured(context), Published("seed")
    read = {
        kind: [published.value(f"fault_free.{kind}.{scale:g}") for scale in SCALES]
        for kind in KINDS
    }
    slope = growth(SCALES, read["mean"]).slope
    rows = _sensitivity(settings, published.band("a6.mean"))
    return study.Findings(
        (*_acceptance(settings, read, published), *_by_scale(settings[MODELLED], published)),
        (
            read_table(NAME, "dependences", rows, slope=slope),
            read_table(NAME, "readings", _readings(settings[MODELLED])),
            read_table(NAME, "motions", _motions(settings[MODELLED])),
        ),
        study.read_notes(NAME),
    )


def _measured(context: study.Context) -> dict[str, Setting]:
    recorder, parts = Recorder(), []
    for setting, names in by_setting(VARIANTS).items():
        for (kind, seed), name in names.items():
            if name not in context.folders:
                continue
            frame = pd.DataFrame(recorder.measure(context.folders[name], segment))
            words = frame["group"] if setting == MODELLED else setting
            parts.append(frame.assign(setting=words, kind=kind, seed=seed))
    by_name = pd.concat(parts).groupby("setting", sort=False)
    return {str(name): Setting(frame) for name, frame in by_name}


def _acceptance(
    settings: Mapping[str, Setting], read: Mapping[str, Sequence[float]], published: Published
) -> Iterator[Line]:
    modelled, noisy, band = settings[MODELLED], settings[NOISE], published.band("a6.mean")
    yield Line(
        "mean tip error of all segments",
        "mm",
        StudyEstimate(float(np.mean(read["mean"])), of="mean of four readings of Figure 3"),
        over_kinds(modelled.all_segments()),
        band,
        "A6",
        "the nominal model's gains, the latency of packets and the motion are not published",
    )

    rest_mm = modelled.frame["rest_mm"].iloc[0]
    offset = f"the model begins at the true tip, encoders see it {rest_mm:.2f} mm away"
    for of, words in LINES.items():
        for kind in KINDS:
            figure = StudyEstimate(getattr(growth(SCALES, read[kind]), of), of=FIGURE)
            lines = modelled.lines(f"{kind}_mm", of)
            mean, quantity = over_kinds(lines), words.format(kind)
            if of == "explained":
                over = f"{mean.of}, least and largest of a motion"
                mean = dataclasses.replace(mean, low=lines.min(), high=lines.max(), of=over)
                band = published.band("a6.explained")
                yield Line(quantity, "", figure, mean, band, "A6", LINEAR[kind])
            else:
                reason = offset if of == "at_zero" else ""
                yield Line(quantity, "mm", figure, mean, reason=reason)
    fired = noisy.frame.loc[noisy.frame["pulses"] > 0, "scale"]
    scales = ", ".join(f"{scale:g}" for scale in np.unique(fired)) or "none"
    without = f"at scale {scales}; without noise {modelled.cues} of {len(modelled.frame)}"
    yield Line(
        "fault-free segments with noise in which the cue fires",
        "",
        published.estimate("fault_free.segments_over_threshold"),
        StudyEstimate(noisy.cues, n=len(noisy.frame), of="segments, noise on"),
        reason=f"{without}: compare the two before calling it the noise's doing",
    )


def _by_scale(modelled: Setting, published: Published) -> Iterator[Line]:
    for kind in KINDS:
        for scale in SCALES:
            values = over_kinds(modelled.by_motion(f"{kind}_mm")[scale])
            read = published.estimate(f"fault_free.{kind}.{scale:g}")
            yield Line(f"{kind} tip error, scale {scale:g}", "mm", read, values)


def _sensitivity(
    settings: Mapping[str, Setting], band: tuple[float, float]
) -> Iterator[tuple[str, ...]]:
    modelled = settings[MODELLED].all_segments()
    for name, setting in settings.items():
        means = setting.all_segments()
        change, mean = over_kinds(means - modelled[means.index]), over_kinds(means)
        yield (
            name,
            *(f"{setting.at(scale, 'peak_mm').value:.2f}" for scale in SCALES),
            _with_interval(mean),
            "yes" if band[0] <= mean.value <= band[1] else "no",
            "–" if name == MODELLED else _with_interval(change, "+"),
            f"{over_kinds(setting.lines('mean_mm', 'slope')).value:.1f}",
            f"{over_kinds(setting.lines('mean_mm', 'explained')).value:.2f}",
            f"{setting.cues} of {len(setting.frame)}",
            f"{(setting.frame['stop_ms'] >= 0).sum()}",
        )


def _readings(modelled: Setting) -> Iterator[tuple[str, ...]]:
    for field, name in READINGS.items():
        scales = (f"{modelled.at(scale, field).value:.2f}" for scale in SCALES)
        yield name, *scales, _with_interval(over_kinds(modelled.all_segments(field)))


def _motions(modelled: Setting) -> Iterator[tuple[str | int, ...]]:
    fields = (modelled.by_motion(field) for field in ("peak_mm", "mean_mm"))
    pulses = modelled.by_motion("pulses").sum(axis=1)
    for (kind, seed), row in pd.concat(fields, axis=1).iterrows():
        yield f"{kind} {seed}", *(f"{value:.2f}" for value in row), int(pulses[kind, seed])


def _with_interval(estimate: StudyEstimate, sign: str = "") -> str:
    value, low, high = (f"{end:{sign}.2f}" for end in (estimate.value, estimate.low, estimate.high))
    return value if math.isnan(estimate.low) else f"{value} ({low} to {high})"


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
