"""Drawings of the fault-free study: the paper's Figure 3, growth with the scale, and what the
error depends on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from studies.framework.drawing import (
    MUTED,
    PREDICTED,
    PUBLISHED,
    SERIES,
    THRESHOLD,
    WIDTH_IN,
)
from studies.framework.literature import Published
from studies.framework.study import Drawing
from studies.seed.fault_free.segments import DRAWN_EVERY
from studies.seed.motions import over_kinds

BETWEEN_S = 1.0
"""Gap between two segments on the time axis."""


def drawings(
    settings: Mapping[str, Any], published: Published, scales: Sequence[float], modelled: str
):
    """Of the settings by name, each a `seed_fault_free.Setting`."""
    return (
        Drawing(
            "figure_3",
            "After the paper's Figure 3: fault-free tip error in segments of 10 s at four"
            " teleoperation scales. Lines: one seed of each kind of motion; bars: the published"
            " peak (solid) and mean (dotted) of each segment. Below: peaks and means over the"
            " scale, each motion a dot, published readings as diamonds.",
            lambda figure: _figure_3(figure, settings[modelled], published, scales),
        ),
        Drawing(
            "sensitivity",
            "Mean tip error of all segments, one thing changed at a time: mean and 95 % interval"
            " over kinds of motion, the acceptance band of A6, and the mean of the paper's four"
            " segments. Hollow: the first motion alone.",
            lambda figure: _sensitivity(figure, settings, published, modelled),
        ),
    )


def _figure_3(figure: Any, setting: Any, published: Published, scales: Sequence[float]) -> None:
    figure.set_size_inches(WIDTH_IN, 5.6)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0))
    _segments(figure.add_subplot(grid[0, :]), setting, published, scales)
    left = figure.add_subplot(grid[1, 0])
    _growth(left, setting, published, scales, "peak")
    _growth(figure.add_subplot(grid[1, 1]), setting, published, scales, "mean")


def _segments(axes: Any, setting: Any, published: Published, scales: Sequence[float]) -> None:
    one_each = {
        kind: motion for motion in reversed(list(setting.segments)) for kind in (motion[0],)
    }
    kinds = list(dict.fromkeys(kind for kind, _ in setting.segments))
    length = 0.0
    for place, scale in enumerate(scales):
        for colour, kind in zip(SERIES, kinds, strict=False):
            error = setting.segments[one_each[kind]][scale].drawn_mm
            length = max(length, len(error) * DRAWN_EVERY / 1e3)
            time = place * (length + BETWEEN_S) + (np.arange(len(error)) + 0.5) * DRAWN_EVERY / 1e3
            axes.plot(
                time,
                error,
                color=colour,
                lw=0.8,
                label=kind.replace("_", " ") if place == 0 else None,
            )
        left = place * (length + BETWEEN_S)
        for what, style, width in (("peak", "-", 1.6), ("mean", (0, (1, 1.5)), 1.6)):
            value = published.value(f"fault_free.{what}.{scale:g}")
            axes.plot(
                (left, left + length),
                (value, value),
                color=PUBLISHED,
                ls=style,
                lw=width,
                label=f"published {what}" if place == 0 else None,
            )
        axes.annotate(
            f"scale {scale:g}",
            (left + length / 2, 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, -2),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=8.5,
            color=MUTED,
        )
    total = len(scales) * (length + BETWEEN_S) - BETWEEN_S
    _threshold(axes, published.value("cue.threshold"))
    axes.set_xlim(-0.5, total + 0.5)
    axes.set_ylim(0.0, max(axes.dataLim.ymax, 3.6) * 1.14)
    axes.set_xlabel("time, s (four runs of each motion, one after another)")
    axes.set_ylabel("tip error, mm")
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=7, handlelength=1.3, columnspacing=1.2
    )


def _growth(
    axes: Any, setting: Any, published: Published, scales: Sequence[float], what: str
) -> None:
    x = np.asarray(scales)
    for motion, segments in setting.segments.items():
        kinds = list(dict.fromkeys(kind for kind, _ in setting.segments))
        values = [getattr(segments[s], f"{what}_mm") for s in scales]
        axes.plot(x, values, "o-", color=SERIES[kinds.index(motion[0])], ms=3, lw=0.7, alpha=0.8)
    read = [published.estimate(f"fault_free.{what}.{s:g}") for s in scales]
    errors = [[e.value - e.low for e in read], [e.high - e.value for e in read]]
    axes.errorbar(
        x, [e.value for e in read], yerr=errors, fmt="D", color=PUBLISHED, ms=4.5, capsize=2, lw=1.0
    )
    if what == "peak":
        _threshold(axes, published.value("cue.threshold"))
    axes.set_xlim(0.0, 0.215)
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(x)
    axes.set_xlabel("teleoperation scale")
    axes.set_ylabel(f"{what} tip error, mm")


def _threshold(axes: Any, value: float) -> None:
    axes.axhline(value, color=THRESHOLD, lw=0.9, ls=(0, (4, 2)), zorder=1)
    axes.annotate(
        "cue",
        (0.005, value),
        xycoords=("axes fraction", "data"),
        xytext=(0, 2),
        textcoords="offset points",
        fontsize=8,
        color=THRESHOLD,
    )


def _sensitivity(
    figure: Any, settings: Mapping[str, Any], published: Published, modelled: str
) -> None:
    figure.set_size_inches(WIDTH_IN, 0.23 * len(settings) + 1.1)
    axes = figure.add_subplot()
    low, high = published.band("a6.mean")
    axes.axvspan(low, high, color=PREDICTED, alpha=0.08, lw=0)
    axes.annotate(
        "band of A6",
        (low, 1),
        xycoords=("data", "axes fraction"),
        xytext=(3, 3),
        textcoords="offset points",
        fontsize=8,
        color=PREDICTED,
    )
    at = float(
        np.mean(
            [n.value for key, n in published.numbers.items() if key.startswith("fault_free.mean.")]
        )
    )
    axes.axvline(at, color=PUBLISHED, lw=1.2)
    axes.annotate(
        "published",
        (at, 0),
        xycoords=("data", "axes fraction"),
        xytext=(3, 3),
        textcoords="offset points",
        fontsize=8,
        color=PUBLISHED,
    )
    for place, setting in enumerate(settings.values()):
        mean = over_kinds(setting.all_segments())
        few = mean.n < 3
        if not few:
            axes.plot((mean.low, mean.high), (place, place), color=PREDICTED, lw=1.3)
        axes.plot(mean.value, place, "o", color=PREDICTED, mfc="white" if few else PREDICTED, ms=5)
    axes.axvline(
        over_kinds(settings[modelled].all_segments()).value,
        color=PREDICTED,
        lw=0.8,
        ls=(0, (4, 2)),
        zorder=1,
    )
    axes.set_yticks(range(len(settings)), list(settings))
    axes.set_ylim(len(settings) - 0.4, -0.8)
    axes.set_xlim(left=0.0)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("mean tip error of all segments, mm")
