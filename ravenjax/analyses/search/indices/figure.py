"""Draws Sobol's indices as bars, or Morris's mean and deviation of elementary effects."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ravenjax.analyses.search.style import COLOURS, MARKERS
from ravenjax.analyses.search.wording import describe_case, short_axis_name
from ravenjax.document.figure_style import INK, SOFT

MOST_PANELS = 24

Indices = dict[str, dict[str, np.ndarray]]


def draw(numbers: dict[str, Any]) -> Figure:
    """Draw the numbers of `analysis.find`: one row per case and one panel per outcome."""
    records = [record for record in numbers["results"] if record["indices"] is not None][
        :MOST_PANELS
    ]
    outcomes = list(dict.fromkeys(record["outcome"] for record in records))
    cases = list(dict.fromkeys(describe_case(record["case"]) for record in records))
    names = [short_axis_name(one["name"]).removeprefix("plant.") for one in numbers["inputs"]]
    # All of Sobol's indices lie between 0 and 1, but effects have different units.
    shared = numbers["method"] == "sobol"
    rows, columns = max(1, len(cases)), max(1, len(outcomes))
    height = 0.5 + (0.34 * len(names) + 0.9 if shared else 2.6) * rows
    figure = Figure(figsize=(1.8 + 2.9 * columns, height), layout="constrained")
    panes = figure.subplots(rows, columns, sharex=shared, sharey=shared, squeeze=False)
    for axes in panes.reshape(-1):
        axes.set_visible(False)
    for record in records:
        axes = panes[cases.index(describe_case(record["case"])), outcomes.index(record["outcome"])]
        axes.set_visible(True)
        (_bars if shared else _effects)(axes, record["indices"], names)
        where = f"\n{describe_case(record['case'])}" if record["case"] else ""
        axes.set_title(f"{record['outcome']}{where}", fontsize=8.5)
    if records and shared:
        handles, labels = panes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=2)
    return figure


def _bars(axes: Any, indices: Indices, names: list[str]) -> None:
    place = np.arange(len(names))
    kinds = (("ST", "total", -0.19, COLOURS[0]), ("S1", "first order", 0.19, COLOURS[5]))
    for name, label, shift, colour in kinds:
        value, reach = indices[name]["value"], _reach(indices[name])
        bar = {"ecolor": INK, "elinewidth": 0.9, "capsize": 2}
        axes.barh(place + shift, value, 0.36, xerr=reach, color=colour, label=label, error_kw=bar)
    axes.axvline(0.0, color=SOFT, lw=0.8)
    axes.set_yticks(place, names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.set_xlabel("share of the variance")


def _effects(axes: Any, indices: Indices, names: list[str]) -> None:
    mean, deviation = indices["mu_star"]["value"], indices["sigma"]["value"]
    reach = _reach(indices["mu_star"])
    for i, name in enumerate(names):
        look = {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)]}
        point = {"xerr": reach[:, i : i + 1], "ms": 5, "lw": 1.0, "ls": "none", "label": name}
        axes.errorbar(mean[i], deviation[i], **look, **point)
    largest = 1.08 * float(max(mean.max(), deviation.max()))
    axes.plot([0.0, largest], [0.0, largest], color=SOFT, lw=0.9, ls=(0, (4, 2)), zorder=1)
    axes.set_xlim(0.0, largest)
    axes.set_ylim(0.0, largest)
    axes.set_xlabel("mean |effect|")
    axes.set_ylabel("deviation of the effect")
    axes.legend(loc="upper left", fontsize=7)


def _reach(index: dict[str, np.ndarray]) -> np.ndarray:
    """Return [2, inputs]: how far an interval extends below and above its value."""
    return np.maximum(
        0.0, np.stack([index["value"] - index["low"], index["high"] - index["value"]])
    )
