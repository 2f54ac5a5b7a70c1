"""Figures of the study of detectors: curves of score, what is caught against false alarms,
times, and layers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.document.axes import step_curve
from ravenjax.document.steps import steps
from ravenjax.stats.alarms.roc import CurveBand, precision_recall_band, roc_band
from ravenjax.stats.latency import Incidence, Lead
from studies.detection.points import CLIP, FORK, PER_HOUR, PUBLISHED, Chosen, share, times
from studies.detection.runs import CUE, OTHERS, STOPS, FaultyScores, FreeScores, names
from studies.detection.tables import at_scale, layers_of, unclutched
from studies.framework.drawing import MUTED, SERIES, WIDTH_IN
from studies.framework.study import Drawing

BAND_RESAMPLES = 200
MARKERS = ("o", "s", "D")
MARKS = ("X", "P", "*", "D", "s")


def roc(
    bands: Mapping[str, tuple[CurveBand, CurveBand]],
    single: Mapping[str, tuple[float, float, float]],
    base: float,
) -> Callable[[Any], None]:
    """ROC and precision-recall; single: name -> (false, true, precision) rates; base: of
    unintended motion.
    """

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 4.6)
        left, right = figure.subplots(1, 2)
        for colour, (name, (curve, recall)) in zip(SERIES, bands.items(), strict=False):
            label = f"{name}: AUC {curve.area.value:.3f}"
            _band(left, curve.grid, curve, colour, label)
            _band(right, recall.grid, recall, colour, None)
        for marker, (name, (false, true, precision)) in zip(MARKERS, single.items(), strict=False):
            style = {
                "color": MUTED,
                "marker": marker,
                "ls": "none",
                "ms": 6,
                "mfc": "white",
                "zorder": 5,
            }
            left.plot(false, true, label=name, **style)
            right.plot(true, precision, **style)
        left.plot([0, 1], [0, 1], color="0.75", lw=0.8, ls=":")
        right.axhline(base, color="0.75", lw=0.8, ls=":")
        left.set(
            title="ROC",
            xlabel="other faults with an alarm",
            ylabel="recall",
            xlim=(0, 1),
            ylim=(0, 1.01),
        )
        right.set(title="Precision and recall", xlabel="recall", ylabel="precision", xlim=(0, 1))
        right.set_ylim(0, 1.01)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)

    return draw


class Trade(NamedTuple):
    """One panel of `trade`: curves name -> [thresholds, 2] and marks name -> (false alarms an
    hour, share caught).
    """

    title: str
    curves: Mapping[str, np.ndarray]
    marks: Mapping[str, tuple[float, float]]
    hours: float


def trade(panels: Sequence[Trade], wanted: float) -> Callable[[Any], None]:
    """Unintended motion caught against false alarms an hour; a line where `wanted` are."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 4.8)
        axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axis, panel in zip(axes, panels, strict=True):
            least = 0.4 / panel.hours  # where no alarm came
            axis.axvspan(least / 1.35, least * 1.35, color="0.93", lw=0, zorder=0)
            axis.text(
                least,
                101,
                "none seen",
                fontsize=7,
                color="0.35",
                ha="center",
                va="top",
                rotation=90,
            )
            for colour, (name, points) in zip(SERIES, panel.curves.items(), strict=False):
                rate, caught = np.maximum(points[:, 0], least), 100 * points[:, 1]
                axis.plot(rate, caught, color=colour, lw=1.2, marker=".", ms=4, label=name)
            for marker, (name, (rate, caught)) in zip(MARKS, panel.marks.items(), strict=False):
                style = {
                    "color": MUTED,
                    "mec": "white",
                    "mew": 0.7,
                    "ms": 8,
                    "ls": "none",
                    "zorder": 5,
                }
                axis.plot(max(rate, least), 100 * caught, marker=marker, label=name, **style)
            axis.axvline(wanted, color="0.4", lw=0.9, ls="--")
            axis.set_xscale("log")
            axis.set(
                title=f"{panel.title}: {panel.hours:.1f} h",
                xlabel="false alarms an hour",
                ylim=(0, 102),
            )
            axis.set_xlim(least / 1.5, 2e4)
        axes[0].set_ylabel("unintended motion caught, %")
        _below(figure, axes[0])

    return draw


def incidences(
    curves: Mapping[str, tuple[Incidence, Lead]],
    ylabel: str,
    height_in: float,
    legend: Callable[[Any, Any], Any],
) -> Callable[[Any], None]:
    """Incidence of the alarm after the first effect and about the beginning of the unintended
    motion; `legend` is called with the figure and its left panel. Without bands: theirs take faults
    as independent."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, height_in)
        left, right = figure.subplots(1, 2, sharey=True)
        for colour, (name, (delay, lead)) in zip(SERIES, curves.items(), strict=False):
            for axis, curve in ((left, delay), (right, lead.lag)):
                time = curve.time + (1 if axis is left else 0)
                stairs = steps(time, curve.fraction, curve.fraction, curve.fraction)
                step_curve(axis, stairs, color=colour, scale=100, alpha=0.12, lw=1.3, label=name)
        left.set_xscale("log")
        left.set(
            title="After the fault's first effect",
            xlabel="ms after it, 1: at once",
            ylabel=ylabel,
            xlim=(1, 3000),
            ylim=(0, 101),
        )
        right.axvline(0, color="0.4", lw=0.9, ls="--")
        right.set(
            title="Before and after the motion",
            xlabel="ms from its beginning, negative: before",
            xlim=(-300, 300),
        )
        legend(figure, left)

    return draw


def _below(figure: Any, panel: Any) -> None:
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=3)


def layers(
    caught: np.ndarray, rows: Sequence[str], columns: Sequence[str]
) -> Callable[[Any], None]:
    """Map of what is caught [layers, detectors], fractions."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.3 * len(rows) + 2.2)
        axis = figure.subplots()
        percent = 100 * caught
        image = axis.imshow(percent, cmap="cividis", vmin=0, vmax=100, aspect="auto")
        for (row, column), value in np.ndenumerate(percent):
            ink = "black" if value > 55 else "white"
            axis.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=8, color=ink)
        axis.grid(False)
        axis.set_xticks(
            range(len(columns)), columns, rotation=35, ha="right", rotation_mode="anchor"
        )
        axis.set_yticks(range(len(rows)), rows)
        figure.colorbar(image, ax=axis, label="unintended motion caught, %", shrink=0.9)

    return draw


def _band(axis: Any, grid: np.ndarray, found: CurveBand, colour: str, label: str | None) -> None:
    axis.plot(grid, found.curve.value, color=colour, lw=1.5, label=label)
    axis.fill_between(grid, found.curve.low, found.curve.high, color=colour, alpha=0.15, lw=0)


def drawings(
    faulty: FaultyScores, modelled: FreeScores, main: Sequence[str], chosen: Sequence[Chosen]
) -> list[Drawing]:
    """Every figure of the study; `modelled`: motion without a fault, robot as modelled."""
    listed = names(faulty.detectors)
    bands = {}
    for name in main:
        score = faulty.score[:, listed.index(name)]
        bands[name] = (
            roc_band(score, faulty.unintended, faulty.kind, resamples=BAND_RESAMPLES),
            precision_recall_band(score, faulty.unintended, faulty.kind, resamples=BAND_RESAMPLES),
        )
    single = {
        name: (
            share(
                spoke := faulty.spoke_ms(name, np.nan) >= 0, ~faulty.unintended, faulty.faults, ""
            ).value,
            share(spoke, faulty.unintended, faulty.faults, "").value,
            share(faulty.unintended, spoke, faulty.faults, "").value,
        )
        for name in OTHERS
    }
    slow = at_scale(unclutched(modelled), 0.1)
    panels = [
        Trade(
            title,
            {name: _trade(faulty, part, name) for name in main},
            {
                f"{name}, threshold {threshold:g}": _at((name, threshold), part, faulty)
                for name, threshold in (PUBLISHED, FORK, CLIP)
            }
            | {name: _at((name, np.nan), part, faulty) for name in (CUE, STOPS)},
            float(part.hours.sum()),
        )
        for title, part in (("Every motion and scale", modelled), ("Scale 0.1, no clutching", slow))
    ]
    curves = {}
    for one in chosen:
        curves[one.told] = times(faulty, one.name, one.threshold)
    there = layers_of(faulty.layer[faulty.unintended])
    caught = np.array(
        [
            [
                (faulty.spoke_ms(*one) >= 0)[(faulty.layer == layer) & faulty.unintended].mean()
                for one in chosen
            ]
            for layer in there
        ]
    )
    counts = [int(((faulty.layer == layer) & faulty.unintended).sum()) for layer in there]
    return [
        Drawing(
            "detectors_roc",
            "How well a run's score tells an unintended motion from other faults: ROC and"
            " precision-recall, 95 % bands over kinds of faults; the robot's checks and the haptic"
            " cue have one point each.",
            roc(bands, single, float(faulty.unintended.mean())),
        ),
        Drawing(
            "detectors_trade",
            "What each threshold catches against how often it disturbs: unintended motion, false"
            " alarms an hour on motion without a fault. One threshold for every scale must sit"
            " above the fastest motion; where the scale is known it need not.",
            trade(panels, PER_HOUR),
        ),
        Drawing(
            "detectors_time",
            "When they know: share of faults with unintended motion that have an alarm, after the"
            f" fault's first effect and before the motion began, at most {PER_HOUR:g} false alarm"
            " an hour. Kaplan-Meier.",
            incidences(curves, "faults with an alarm, %", 4.6, _below),
        ),
        Drawing(
            "detectors_layers",
            f"Unintended motion caught by layer of the fault, %, at most {PER_HOUR:g} false alarm"
            " an hour; in brackets runs with one.",
            layers(
                caught,
                [f"{layer} ({n:,})" for layer, n in zip(there, counts, strict=True)],
                [one.told for one in chosen],
            ),
        ),
    ]


def _trade(faulty: FaultyScores, free: FreeScores, name: str) -> np.ndarray:
    """[thresholds, 2] false alarms an hour and recall, by rising threshold.

    Those that catch less than a higher one are left out: there an alarm is mostly on before the
    fault. So are those without a false alarm but the lowest.
    """
    thresholds = next(one.thresholds for one in faulty.detectors if one.name == name)
    points = np.array([_at((name, threshold), free, faulty) for threshold in sorted(thresholds)])
    points = points[int(np.argmax(points[:, 1])) :]
    quiet = np.flatnonzero(points[:, 0] == 0)
    return points[: quiet[0] + 1] if len(quiet) else points


def _at(one: tuple[str, float], free: FreeScores, faulty: FaultyScores) -> tuple[float, float]:
    """False alarms an hour and share caught at one threshold."""
    false = float(free.count(*one).sum() / free.hours.sum())
    return false, float((faulty.spoke_ms(*one) >= 0)[faulty.unintended].mean())
