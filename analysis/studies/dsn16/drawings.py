"""Figures of the targeted attacks: rates against duration, and maps of value against duration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.dsn16.cells import DURATIONS, CellShares
from studies.framework.drawing import PREDICTED, PUBLISHED, SERIES, WIDTH_IN

OTHERS = SERIES[1:]


class Panel(NamedTuple):
    """One rate against duration, all in %."""

    title: str
    predicted: np.ndarray  # [8]
    packets: np.ndarray | None  # [2, 8], lowest and highest with other lengths of packets
    others: Mapping[str, np.ndarray]  # other trajectories
    published: np.ndarray | None = None  # [8]
    published_interval: np.ndarray | None = None  # [2, 8]
    band: np.ndarray | None = None  # [2, 8]


def rates(panels: Sequence[Panel], label: str) -> Callable[[Any], None]:
    """Draws panels side by side; `label`: of the baseline."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 5.0)
        axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        places = np.arange(len(DURATIONS))
        for axis, panel in zip(axes, panels, strict=True):
            _panel(axis, panel, places, label)
            axis.set(title=panel.title, xlabel="duration of the fault, packets", ylim=(-3, 103))
            axis.set_xticks(places, [str(d) for d in DURATIONS])
        axes[0].set_ylabel("% of runs")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2)

    return draw


def _panel(axis: Any, panel: Panel, places: np.ndarray, label: str) -> None:
    if panel.band is not None:
        steps = [np.repeat(end, 2) for end in panel.band]
        edges = np.stack([places - 0.4, places + 0.4], axis=1).ravel()
        for k in range(len(places)):
            part = slice(2 * k, 2 * k + 2)
            axis.fill_between(
                edges[part],
                steps[0][part],
                steps[1][part],
                color="0.88",
                lw=0,
                label=None if k else "acceptance band A1",
            )
    if panel.packets is not None:
        low, high = panel.packets
        axis.fill_between(
            places, low, high, color=PREDICTED, alpha=0.15, lw=0, label="other lengths of packets"
        )
    for colour, (name, percent) in zip(OTHERS, panel.others.items(), strict=False):
        axis.plot(places, percent, color=colour, lw=1.0, marker=".", ms=4, label=name)
    axis.plot(places, panel.predicted, color=PREDICTED, lw=1.8, marker="o", ms=4, label=label)
    if panel.published is not None:
        spread = None
        if panel.published_interval is not None:
            low, high = panel.published_interval
            spread = np.maximum(np.stack([panel.published - low, high - panel.published]), 0.0)
        axis.errorbar(
            places + 0.08,
            panel.published,
            yerr=spread,
            color=PUBLISHED,
            fmt="s",
            ms=5,
            mfc="none",
            capsize=3,
            zorder=5,
            label="published; 95 % Wilson of 170 runs",
        )


def maps(
    shares: Mapping[str, CellShares], labels: Sequence[str], quantity: str
) -> Callable[[Any], None]:
    """Draws value x duration maps side by side; shares: title -> cells."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.22 * len(labels) + 1.2)
        axes = figure.subplots(1, len(shares), sharey=True, squeeze=False)[0]
        image = None
        for axis, (title, cells) in zip(axes, shares.items(), strict=True):
            percent = 100.0 * cells.shares
            image = axis.imshow(
                percent, cmap="cividis", vmin=0, vmax=100, aspect="auto", origin="lower"
            )
            for (row, column), value in np.ndenumerate(percent):
                if value > 0:
                    ink = "black" if value > 55 else "white"
                    axis.text(
                        column, row, f"{value:.0f}", ha="center", va="center", fontsize=7, color=ink
                    )
            axis.set(title=title, xlabel="duration of the fault, packets")
            axis.grid(False)
            axis.set_xticks(range(len(cells.durations)), [str(d) for d in cells.durations])
            axis.set_yticks(range(len(cells.values)), labels)
        axes[0].set_ylabel(quantity)
        if image is not None:
            figure.colorbar(image, ax=list(axes), label="% of runs", shrink=0.8)

    return draw
