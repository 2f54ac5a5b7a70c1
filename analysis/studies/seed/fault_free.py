"""Study of the fault-free tip error of the training simulator at four teleoperation scales (IROS
2016, Figure 3; targets A5, A6).

Tip error is the distance that triggers the cue: from the tip that the control software measures to
the nominal model's. It is shown beside the true tip's distance, and the distance of the measured
tip if both had begun at the same place.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from studies.seed.motions import MODELLED, Motion, by_setting, over_kinds
from studies.series import Recorder, Row, Series, rises
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    Table,
    read_notes,
    read_table,
    read_variants,
    study,
)

REST_TICKS = 500
"""Ticks for which the hand rests at the beginning of every generated motion. The pedal is down from
tick 200 on.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class RunSegment:
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
    stop = int(row["check_estop_first_ms"])
    end = len(series["tip_error_mm"]) if stop < 0 else stop
    moving = slice(REST_TICKS, max(end, REST_TICKS + 1))
    error = series["tip_error_mm"]
    apart = (series["position"] - series["model_position"]) * 1e3
    zeroed = np.linalg.norm(apart - apart[REST_TICKS - 1], axis=1)
    true = np.linalg.norm(series["tip"] - series["model_position"], axis=1) * 1e3
    return RunSegment(
        group=str(row["group"]),
        scale=float(row["param:operator.scale"]),
        peak_mm=float(error[moving].max()),
        mean_mm=float(error[moving].mean()),
        true_mean_mm=float(true[moving].mean()),
        zeroed_mean_mm=float(zeroed[moving].mean()),
        rest_mm=float(error[REST_TICKS - 1]),
        pulses=len(rises(series["cue_force"][moving] > 0.0)),
        stop_ms=stop,
    )


@dataclasses.dataclass(frozen=True)
class Growth:
    """A straight line through a quantity at several scales."""

    slope: float  # mm per unit of scale
    at_zero: float  # mm
    explained: float  # share of the variance, R2


def growth(scales: Sequence[float], values: Sequence[float]) -> Growth:
    """Fit by least squares. Needs at least three scales."""
    x, y = np.asarray(scales, float), np.asarray(values, float)
    slope, at_zero = np.polyfit(x, y, 1)
    rest, about = y - slope * x - at_zero, y - y.mean()
    return Growth(
        float(slope),
        float(at_zero),
        float(1.0 - rest @ rest / (about @ about)) if about.any() else 1.0,
    )


def spread(values: Iterable[float]) -> tuple[float, float]:
    """Return the least and largest value."""
    every = list(values)
    return min(every), max(every)


NAME = "seed_fault_free"
SCALES = (0.05, 0.1, 0.15, 0.2)
NOISE = "noise"
"""The campaign's group with noise of encoders and motors, in the robot's own sizes."""
VARIANTS = read_variants(NAME)


@dataclasses.dataclass(frozen=True)
class Setting:
    """The segments of one answer to the open questions, by motion and scale."""

    name: str
    segments: Mapping[Motion, Mapping[float, RunSegment]]

    def by_motion(self, of: Callable[[Mapping[float, RunSegment]], float]) -> dict[Motion, float]:
        """Return a number computed from each motion's four segments."""
        return {motion: of(segments) for motion, segments in self.segments.items()}

    def at(self, scale: float, field: str) -> StudyEstimate:
        """Return the mean over kinds of motion of a quantity at one scale."""
        return over_kinds(self.by_motion(lambda segments: getattr(segments[scale], field)))

    def all_segments(self, field: str = "mean_mm") -> dict[Motion, float]:
        """Return the mean over the four scales, for each motion."""
        return self.by_motion(
            lambda segments: float(np.mean([getattr(segments[s], field) for s in SCALES]))
        )

    def lines(self, field: str, of: str) -> dict[Motion, float]:
        """Return slope, value at zero or explained share of a straight line through the four
        scales, for each motion.
        """
        return self.by_motion(
            lambda found: getattr(growth(SCALES, [getattr(found[s], field) for s in SCALES]), of)
        )

    def line(self, field: str, of: str) -> StudyEstimate:
        """Return the mean of that number over kinds of motion."""
        return over_kinds(self.lines(field, of))

    def explained(self, field: str) -> StudyEstimate:
        """Return the share of the variance that a line explains: mean over kinds, and least and
        largest of a motion.
        """
        low, high = spread(self.lines(field, "explained").values())
        mean = self.line(field, "explained")
        return dataclasses.replace(
            mean, low=low, high=high, of=f"{mean.of}, least and largest of a motion"
        )

    @property
    def every(self) -> list[RunSegment]:
        return [segment for segments in self.segments.values() for segment in segments.values()]


def compare(context: Context) -> Findings:
    """Measure every segment and compare it with the paper's."""
    settings = _measured(context)
    published = Published("seed")
    modelled, noisy = settings[MODELLED], settings[NOISE]
    inside = _inside(settings, published.band("a6.mean"))
    lines = (*_acceptance(modelled, noisy, inside, published), *_by_scale(modelled, published))
    return Findings(
        lines=lines,
        tables=(
            _sensitivity(
                settings, published.band("a6.mean"), _published_growth(published, "mean").slope
            ),
            _readings(modelled),
            _motions(modelled),
        ),
        notes=read_notes(NAME),
    )


def _measured(context: Context) -> dict[str, Setting]:
    recorder = Recorder()
    found: dict[str, dict[Motion, dict[float, RunSegment]]] = {}
    for setting, names in by_setting(VARIANTS).items():
        for motion, name in names.items():
            for one in recorder.measure(context.folders[name], segment):
                words = one.group if setting == MODELLED else setting
                found.setdefault(words, {}).setdefault(motion, {})[one.scale] = one
    return {name: Setting(name, segments) for name, segments in found.items()}


def _inside(settings: Mapping[str, Setting], band: tuple[float, float]) -> list[str]:
    means = {
        name: over_kinds(setting.all_segments()).value
        for name, setting in settings.items()
        if name != MODELLED
    }
    return [f"{name} {mean:.2f} mm" for name, mean in means.items() if band[0] <= mean <= band[1]]


def _acceptance(
    modelled: Setting, noisy: Setting, inside: Sequence[str], published: Published
) -> tuple[Line, ...]:
    fits = {kind: _published_growth(published, kind) for kind in ("peak", "mean")}
    means = [published.value(f"fault_free.mean.{s:g}") for s in SCALES]
    cues = sum(segment.pulses > 0 for segment in noisy.every)
    scales = (
        ", ".join(f"{scale:g}" for scale in sorted({s.scale for s in noisy.every if s.pulses}))
        or "none"
    )
    explained = published.band("a6.explained")
    quiet = sum(segment.pulses > 0 for segment in modelled.every)
    return (
        Line(
            "mean tip error of all segments",
            "mm",
            StudyEstimate(float(np.mean(means)), of="mean of four readings of Figure 3"),
            over_kinds(modelled.all_segments()),
            published.band("a6.mean"),
            "A6",
            "the nominal model's gains, the latency of packets and the motion are not published;"
            " inside the band with " + "; ".join(inside),
        ),
        *(
            Line(
                f"variance of the {kind}s that a straight line over the scale explains",
                "",
                StudyEstimate(fits[kind].explained, of="four readings of Figure 3"),
                modelled.explained(f"{kind}_mm"),
                explained,
                "A6",
                _linear_reason(kind),
            )
            for kind in ("peak", "mean")
        ),
        Line(
            "fault-free segments with noise in which the cue fires",
            "",
            published.estimate("fault_free.segments_over_threshold"),
            StudyEstimate(cues, n=len(noisy.every), of="segments, noise on"),
            reason=f"at scale {scales}; without noise {quiet} of {len(modelled.every)}: compare the"
            " two before calling it the noise's doing",
        ),
        *(
            Line(
                f"{kind} tip error, slope over the scale",
                "mm",
                StudyEstimate(fits[kind].slope, of="four readings of Figure 3"),
                modelled.line(f"{kind}_mm", "slope"),
            )
            for kind in ("peak", "mean")
        ),
        *(
            Line(
                f"{kind} tip error, the line's value at scale 0",
                "mm",
                StudyEstimate(fits[kind].at_zero, of="four readings of Figure 3"),
                modelled.line(f"{kind}_mm", "at_zero"),
                reason=(
                    "the model begins at the true tip, encoders see it"
                    f" {modelled.every[0].rest_mm:.2f} mm away"
                ),
            )
            for kind in ("peak", "mean")
        ),
    )


def _published_growth(published: Published, kind: str) -> Growth:
    return growth(SCALES, [published.value(f"fault_free.{kind}.{scale:g}") for scale in SCALES])


def _linear_reason(kind: str) -> str:
    if kind == "mean":
        return "dry friction and the offset at rest do not shrink with the scale"
    return (
        "at scale 0.2 the fault-free command of fast motions is clipped by the overdrive check: the"
        " peaks bend up"
    )


def _by_scale(modelled: Setting, published: Published) -> tuple[Line, ...]:
    lines = []
    for kind in ("peak", "mean"):
        for scale in SCALES:
            low, high = spread(
                getattr(segments[scale], f"{kind}_mm") for segments in modelled.segments.values()
            )
            read = published.estimate(f"fault_free.{kind}.{scale:g}")
            where = (
                "within" if low <= read.value <= high else "above" if read.value > high else "below"
            )
            reason = f"published value {where} the {low:.2f} to {high:.2f} mm of single motions"
            predicted = modelled.at(scale, f"{kind}_mm")
            lines.append(
                Line(f"{kind} tip error, scale {scale:g}", "mm", read, predicted, reason=reason)
            )
    return tuple(lines)


def _sensitivity(
    settings: Mapping[str, Setting], band: tuple[float, float], published_slope: float
) -> Table:
    modelled = settings[MODELLED]
    own, rows = modelled.all_segments(), []
    for name, setting in settings.items():
        means = setting.all_segments()
        change = over_kinds({motion: value - own[motion] for motion, value in means.items()})
        mean, every = over_kinds(means), setting.every
        rows.append(
            (
                name,
                *(_mm(setting.at(scale, "peak_mm").value) for scale in SCALES),
                _with_interval(mean),
                "yes" if band[0] <= mean.value <= band[1] else "no",
                "–" if name == MODELLED else _with_interval(change, "+"),
                f"{setting.line('mean_mm', 'slope').value:.1f}",
                f"{setting.line('mean_mm', 'explained').value:.2f}",
                f"{sum(s.pulses > 0 for s in every)} of {len(every)}",
                f"{sum(s.stop_ms >= 0 for s in every)}",
            )
        )
    return read_table(NAME, "dependences", rows, slope=published_slope)


def _readings(modelled: Setting) -> Table:
    names = {
        "mean_mm": "as the cue sees it: measured tip to nominal model",
        "true_mean_mm": "true tip to nominal model",
        "zeroed_mean_mm": "measured tip, model begun at the measured pose",
    }
    rows = [
        (
            name,
            *(_mm(modelled.at(s, field).value) for s in SCALES),
            _with_interval(over_kinds(modelled.all_segments(field))),
        )
        for field, name in names.items()
    ]
    return read_table(NAME, "readings", rows)


def _motions(modelled: Setting) -> Table:
    rows = [
        (
            f"{kind} {seed}",
            *(_mm(segments[s].peak_mm) for s in SCALES),
            *(_mm(segments[s].mean_mm) for s in SCALES),
            sum(segment.pulses for segment in segments.values()),
        )
        for (kind, seed), segments in modelled.segments.items()
    ]
    return read_table(NAME, "motions", rows)


def _mm(value: float) -> str:
    return f"{value:.2f}"


def _with_interval(estimate: StudyEstimate, sign: str = "") -> str:
    value = f"{estimate.value:{sign}.2f}"
    return (
        value
        if math.isnan(estimate.low)
        else f"{value} ({estimate.low:{sign}.2f} to {estimate.high:{sign}.2f})"
    )


STUDY = study(NAME, variants=VARIANTS, compare=compare)
