"""Figure of a rare event: how likely it is to come that near to it, by plain Monte Carlo and by
subset simulation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ravenjax.analyses.search.findings import words
from ravenjax.analyses.search.style import COLOURS, STYLE
from ravenjax.document.figure_style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(numbers: dict[str, Any]) -> Figure:
    """numbers: as `simulation.find` has them. One panel for each case."""
    import matplotlib
    from matplotlib.figure import Figure

    results = numbers["results"]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.6 + 3.6 * len(results), 3.6), layout="constrained")
        for axes, record in zip(
            figure.subplots(1, len(results), sharey=True, squeeze=False)[0], results, strict=True
        ):
            _panel(axes, record, numbers)
            axes.set_title(words(record["case"]))
        first = figure.axes[0]
        first.set_ylabel(
            "probability of that much or " + ("more" if numbers["relation"] == ">=" else "less")
        )
        first.legend(loc="lower left")
        figure.suptitle(
            f"event: {numbers['event']}", x=0.01, ha="left", fontsize=10, fontweight="bold"
        )
    return figure


def _panel(axes: Any, record: dict[str, Any], numbers: dict[str, Any]) -> None:
    plain, level = record["exceedance"], record["subset"]
    if plain["value"]:
        label = f"plain Monte Carlo, {record['monte_carlo']['runs']} runs"
        axes.plot(
            plain["value"],
            plain["probability"],
            color=COLOURS[0],
            lw=1.4,
            drawstyle="steps-post",
            label=label,
        )
    reached = [
        [one[name] for one in record["reached"] if one["probability"] > 0.0]
        for name in ("value", "probability")
    ]
    label = f"subset simulation, {level['runs']} runs"
    axes.plot(*reached, color=COLOURS[1], marker="o", ms=4.5, lw=1.0, label=label)
    if level["probability"] > 0.0:
        p = level["probability"]
        error = np.array([[p - level["low"]], [level["high"] - p]])
        axes.errorbar([numbers["bound"]], [p], yerr=error, color=COLOURS[1], capsize=3, lw=1.4)
    axes.axvline(numbers["bound"], color=INK, lw=0.9, ls=(0, (4, 2)))
    axes.set_yscale("log")
    axes.set_xlabel(numbers["column"])
