"""Drawings of the burst study: the paper's Figures 4 and 5 for every constant, and each band
over the constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from studies.framework.drawing import (
    FAULT,
    MUTED,
    PREDICTED,
    PUBLISHED,
    THRESHOLD,
    WIDTH_IN,
)
from studies.framework.literature import Published
from studies.framework.study import Drawing
from studies.seed.burst.events import EVENTS, FAULT_TICKS, BurstEvent, BurstRun, Criteria
from studies.seed.motions import Motion

SHOWN = 1500.0
"""Constants drawn, at most; beyond it the first burst stops the robot."""


def drawings(
    bursts: Mapping[Motion, Sequence[BurstRun]], published: Published, rules: Criteria
) -> tuple[Drawing, ...]:
    """Of the runs of group "burst" by motion; those of the first motion hold their series."""
    first = next(iter(bursts))
    return (
        Drawing(
            "figures_4_5",
            "After the paper's Figures 4 and 5: the four bursts, one a column, with motion"
            f" {first[0]} {first[1]}. Each line is one constant, drawn until the robot stops;"
            " shaded: the fault. Dark: the published peak of the tip error and the published pulse"
            " of the cue, placed at the published lag.",
            lambda figure: _events(
                figure, [one for one in bursts[first] if abs(one.value) <= SHOWN], published
            ),
        ),
        Drawing(
            "constants",
            "Every burst of every motion over the constant (light dots), medians (dark dots), the"
            " acceptance bands, and the published readings as dark lines. Bottom: in how many"
            " motions all four bursts meet each band.",
            lambda figure: _constants(figure, bursts, published, rules),
        ),
    )


def _events(figure: Any, runs: Sequence[BurstRun], published: Published) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure.set_size_inches(WIDTH_IN, 6.0)
    rows = figure.subplots(3, EVENTS, sharex=True, sharey="row")
    scale, colours = Normalize(-SHOWN, SHOWN), colormaps["coolwarm"]
    for number, column in enumerate(rows.T):
        for one in sorted(runs, key=lambda one: -abs(one.value)):
            if number < len(one.events) and (curves := one.events[number].curves) is not None:
                for axes, series in zip(
                    column, (curves.shoulder_deg, curves.error_mm, curves.force), strict=True
                ):
                    axes.plot(curves.time_s, series, color=colours(scale(one.value)), lw=0.7)
        for axes in column:
            axes.axvspan(0.0, FAULT_TICKS / 1e3, color=FAULT, alpha=0.08, lw=0, zorder=0)
        _published(column, number + 1, published)
        column[0].set_title(f"burst {number + 1}")
        column[-1].set_xlabel("s after the onset")
        column[-1].set_xlim(-0.1, 0.8)
    rows[1, 0].set_ylim(0.0, 12.0)
    for axes, words in zip(
        rows[:, 0],
        ("shoulder, degrees\nfrom the onset", "tip error, mm", "cue, device units"),
        strict=True,
    ):
        axes.set_ylabel(words)
    figure.align_ylabels(rows[:, 0])
    figure.colorbar(
        ScalarMappable(scale, colours), ax=rows, label="DAC constant, counts", aspect=45, pad=0.015
    )


def _published(column: Any, number: int, published: Published) -> None:
    threshold, lag = published.value("cue.threshold"), published.value("cue.onset")
    column[1].axhline(threshold, color=THRESHOLD, lw=0.9, ls=(0, (4, 2)))
    peak = published.value(f"burst.{number}.peak")
    column[1].plot((0.0, 0.8), (peak, peak), color=PUBLISHED, lw=1.4)
    lasting = published.value(f"pulse.{number}.end_s") - published.value(f"pulse.{number}.begin_s")
    force = published.value(f"pulse.{number}.force")
    column[2].plot(
        (lag, lag, lag + lasting, lag + lasting), (0.0, force, force, 0.0), color=PUBLISHED, lw=1.4
    )


def _constants(
    figure: Any, bursts: Mapping[Motion, Sequence[BurstRun]], published: Published, rules: Criteria
) -> None:
    figure.set_size_inches(WIDTH_IN, 8.6)
    panels = figure.subplots(5, 1, sharex=True, height_ratios=(1.2, 1, 1, 1, 1.3))
    runs = [one for of_motion in bursts.values() for one in of_motion if abs(one.value) <= SHOWN]
    peaks = [published.value(f"burst.{k}.peak") for k in range(1, EVENTS + 1)]
    rebounds = [published.value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    onset = published.estimate("cue.onset")
    quantities: tuple[tuple[str, Callable[[BurstEvent], float], str, list[float], float], ...] = (
        ("tip error\npeak, mm", lambda e: e.peak_mm, "a4.peak", peaks, 12.0),
        ("rebound,\ndegrees", lambda e: e.rebound_deg, "a4.rebound", rebounds, 12.0),
        (
            "time of the\nrebound, ms",
            lambda e: e.rebound_ms,
            "a4.rebound_ms",
            [published.value("burst.3.rebound_ms")],
            310.0,
        ),
        ("cue after\nfault, s", lambda e: e.cue_s, "a5.onset", [onset.low, onset.high], 0.45),
    )
    for axes, (label, of, band, read, top) in zip(panels, quantities, strict=False):
        axes.axhspan(*published.band(band), color=PREDICTED, alpha=0.09, lw=0)
        for value in read:
            axes.axhline(value, color=PUBLISHED, lw=0.8)
        _dots(axes, runs, of)
        axes.set_ylim(0.0, top)
        axes.set_ylabel(label)
    _met(panels[-1], runs, rules, len(bursts))
    panels[-1].set_xlabel("DAC constant, counts")
    panels[-1].set_xlim(-SHOWN, SHOWN)
    figure.align_ylabels(panels)


def _dots(axes: Any, runs: Sequence[BurstRun], of: Callable[[BurstEvent], float]) -> None:
    by_value: dict[float, list[float]] = {}
    for one in runs:
        by_value.setdefault(one.value, []).extend(
            v for v in map(of, one.events) if not math.isnan(v)
        )
    for value, dots in by_value.items():
        axes.plot([value] * len(dots), dots, "o", color=PREDICTED, ms=2, alpha=0.18, mew=0)
    there = sorted(value for value, dots in by_value.items() if dots)
    axes.plot(there, [np.median(by_value[value]) for value in there], "o", color=PREDICTED, ms=2.8)


def _met(axes: Any, runs: Sequence[BurstRun], rules: Criteria, motions: int) -> None:
    """A row a band, darker where more motions meet it."""
    values = sorted({one.value for one in runs})
    names = [*rules.tests, "all of A4"]
    tests = [*rules.tests.values(), rules.all_of_a4]
    shares = [
        [np.mean([holds(one) for one in runs if one.value == value]) for value in values]
        for holds in tests
    ]
    half = (values[1] - values[0]) / 2.0
    edges = [values[0] - half, *(value + half for value in values)]
    image = axes.pcolormesh(
        edges, range(len(names) + 1), shares, cmap="Blues", vmin=0.0, vmax=1.0, linewidth=0
    )
    image.set_edgecolor("face")
    axes.set_yticks([place + 0.5 for place in range(len(names))], names)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.figure.colorbar(image, ax=axes, label=f"share of {motions} motions", pad=0.01, aspect=12)
    axes.tick_params(axis="y", length=0, labelcolor=MUTED)
