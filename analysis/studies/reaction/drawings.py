"""Figures of the study of the reacting operator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ravenjax.document.axes import step_curve
from ravenjax.document.steps import steps
from studies.framework.drawing import MUTED, SERIES, WIDTH_IN
from studies.reaction.pairs import Contrast
from studies.reaction.times import Advance

OPERATOR_MS = (150, 400)


class ContrastRow(NamedTuple):
    """One contrast with its name; rows of one `block` stand together."""

    block: str
    name: str
    series: str
    contrast: Contrast


def leads(found: Sequence[Advance], most_ms: int = 800) -> Callable[[Any], None]:
    """Draws the share of motions that a reaction of each time could still prevent, one panel a
    threshold.
    """
    thresholds = sorted({one.threshold_mm for one in found})

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 3.3)
        panels = figure.subplots(1, len(thresholds), sharey=True, squeeze=False)[0]
        for axis, threshold in zip(panels, thresholds, strict=True):
            axis.axvspan(*OPERATOR_MS, color="0.92", lw=0, zorder=0)
            for colour, one in zip(
                SERIES, (w for w in found if w.threshold_mm == threshold), strict=False
            ):
                # lag is alarm minus motion: who had a lead of t or more has had the alarm by the
                # lag -t
                lag = one.lead.lag
                early = lag.time <= 0
                if not early.any():
                    continue
                share = lag.fraction[early]
                stairs = steps(
                    lag.time[early], share, share, share, end=0.0
                )  # bands take faults as independent
                named = f"{_motion(one)} ({one.lead.n} faults, {one.kinds.count} kinds)"
                step_curve(
                    axis,
                    stairs._replace(x=-stairs.x),
                    color=colour,
                    scale=100,
                    alpha=0.14,
                    lw=1.6,
                    label=named,
                )
            axis.set(
                title=f"cue at {threshold:g} mm",
                xlim=(0, most_ms),
                ylim=(0, 100),
                xlabel="reaction time, ms",
            )
            axis.set_xticks(range(0, most_ms + 1, 200))
        panels[0].set_ylabel("% of motions still to come")
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=len(names))

    return draw


def rates(rows: Sequence[ContrastRow]) -> Callable[[Any], None]:
    """Draws shares of the faults with and without, one panel a block: a dot for each series."""
    blocks = list(dict.fromkeys(row.block for row in rows))

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 3.6)
        panels = figure.subplots(1, len(blocks), sharey=True, squeeze=False)[0]
        for axis, block in zip(panels, blocks, strict=True):
            mine = [row for row in rows if row.block == block]
            names, series = (
                list(dict.fromkeys(r.name for r in mine)),
                list(dict.fromkeys(r.series for r in mine)),
            )
            width = 0.26
            for row in mine:
                place = names.index(row.name)
                if row.series == series[0]:
                    aside = -width * len(series) / 2
                    _dot(
                        axis, place + aside, row, row.contrast.without, "0.35", "nobody reacts", "s"
                    )
                k = series.index(row.series)
                aside = width * (k + 1 - len(series) / 2)
                _dot(axis, place + aside, row, row.contrast.with_, SERIES[k], row.series, "o")
            axis.set_xticks(range(len(names)), names)
            axis.set(title=block, xlabel="size of the motion")
            axis.grid(axis="x", visible=False)
            handles, words = axis.get_legend_handles_labels()
            entries = dict(zip(words, handles, strict=True))
            axis.legend(entries.values(), entries.keys(), loc="upper right")
        panels[0].set(ylabel="% of the design's faults", ylim=(0, None))

    return draw


def differences(rows: Sequence[ContrastRow], label: str) -> Callable[[Any], None]:
    """Draws paired differences with their intervals, a line a name, a column a series; blocks
    set apart.
    """
    series = list(dict.fromkeys(row.series for row in rows))
    lines: list[tuple[str, str]] = list(dict.fromkeys((row.block, row.name) for row in rows))
    blocks = list(dict.fromkeys(block for block, _ in lines))

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.27 * (len(lines) + len(blocks)) + 1.0)
        panels = figure.subplots(1, len(series), sharey=True, sharex=True, squeeze=False)[0]
        place = {line: k + 1.0 * blocks.index(line[0]) for k, line in enumerate(lines)}
        for axis, name in zip(panels, series, strict=True):
            axis.axvline(0, color=MUTED, lw=0.9)
            for row in (row for row in rows if row.series == name):
                value, low, high = (100.0 * part for part in row.contrast.difference)
                spread = [[value - min(low, value)], [max(high, value) - value]]
                colour = SERIES[blocks.index(row.block) % len(SERIES)]
                axis.errorbar(
                    value,
                    place[row.block, row.name],
                    xerr=spread,
                    fmt="o",
                    ms=4.5,
                    color=colour,
                    capsize=2,
                    elinewidth=1.1,
                )
            axis.set(title=name, xlabel=label)
            axis.grid(axis="y", visible=False)
        panels[0].set_yticks(list(place.values()), [name for _, name in lines])
        panels[0].set_ylim(max(place.values()) + 0.6, -1.3)
        for block in blocks:
            first = min(at for (mine, _), at in place.items() if mine == block)
            panels[0].annotate(
                block,
                (0, first - 0.75),
                xycoords=("axes fraction", "data"),
                fontsize=7.5,
                color=SERIES[blocks.index(block) % len(SERIES)],
                ha="left",
                va="center",
                xytext=(4, 0),
                textcoords="offset points",
            )

    return draw


def _motion(one: Advance) -> str:
    return "jump" if one.size_mm is None else f"{one.size_mm:g} mm"


def _dot(
    axis: Any, place: float, row: ContrastRow, count: int, colour: str, label: str, marker: str
) -> None:
    share = 100.0 * count / max(1, row.contrast.n)
    axis.plot(place, share, marker, ms=4.5, color=colour, label=label)
