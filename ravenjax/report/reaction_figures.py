"""Figures of the operator's reaction: what it spares by fault class, and how far the instrument still went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.figure_style import GRID, json_of, look
from ravenjax.report import facts as run_facts
from ravenjax.report import reactions
from ravenjax.report.reactions import Difference
from ravenjax.report.style import SAME, SERIES, thinned

HEIGHT = 360  # px
ROW = 26  # px, of the figure of differences
LEAST_MM = 0.5
"""From here on the distances are drawn."""


def spared(rows: Sequence[Difference]) -> tuple[str, int]:
    """Figure of the mean difference of how far the tip went, by class and action, with intervals; and its height."""
    classes = list(dict.fromkeys(row.among for row in rows))
    actions = list(dict.fromkeys(row.action for row in rows))
    traces = []
    for number, action in enumerate(actions):
        mine = [row for row in rows if row.action == action and np.isfinite(row.distance_mm.low)]
        shift = (number - (len(actions) - 1) / 2) * 0.22
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": action,
                "x": [row.distance_mm.value for row in mine],
                "y": [classes.index(row.among) + shift for row in mine],
                "error_x": {
                    "type": "data",
                    "symmetric": False,
                    "array": [row.distance_mm.high - row.distance_mm.value for row in mine],
                    "arrayminus": [row.distance_mm.value - row.distance_mm.low for row in mine],
                    "thickness": 1.6,
                    "width": 0,
                },
                "marker": {"color": SERIES[number], "size": 8},
                "customdata": [[row.among, row.n] for row in mine],
                "hovertemplate": action + ", %{customdata[0]}: %{x:.2f} mm (%{customdata[1]} pairs)<extra></extra>",
            }
        )
    height = 120 + ROW * len(classes) + 8 * len(classes) * len(actions)
    layout = look(height) | {
        "xaxis": {
            "title": {"text": "how far the tip went, with minus without the reaction, mm"},
            "gridcolor": GRID,
            "zeroline": True,
            "zerolinecolor": "rgba(128,128,128,0.8)",
        },
        "yaxis": {
            "tickvals": list(range(len(classes))),
            "ticktext": classes,
            "autorange": "reversed",
            "showgrid": False,
            "zeroline": False,
            "automargin": True,
        },
    }
    return json_of(traces, layout), height


def exceedance(frame: pd.DataFrame, facts: pd.DataFrame) -> tuple[str, str]:
    """Figure of the share of faults in which the tip went farther than each distance, by action; and which distance.

    It is the one that is fair for most of the reactions; those for which it is not are left out.
    """
    acting = [number for number in sorted(facts["action"].unique().tolist()) if number]
    fair = [reactions.FAIR[run_facts.ACTIONS[number]] for number in acting]
    measure = max(reactions.DISTANCES, key=fair.count)
    shown = [number for number, own in zip(acting, fair, strict=True) if own == measure]
    traces = []
    for number in (0, *shown):
        mine = reactions.pairs(frame, facts, number or acting[0])
        values = np.sort((mine.with_frame if number else mine.without_frame)[measure].to_numpy(float))
        told = reactions.TOLD[run_facts.ACTIONS[number]]
        traces.append(_exceeded(values, told, SERIES[acting.index(number)] if number else SAME, number == 0))
    layout = look(HEIGHT) | {
        "xaxis": {
            "title": {"text": f"{reactions.DISTANCES[measure]}, mm"},
            "type": "log",
            "tickvals": [0.5, 1, 2, 3, 5, 10, 20, 50, 100, 200],
            "gridcolor": GRID,
            "zeroline": False,
        },
        "yaxis": {
            "title": {"text": "share of faults beyond it"},
            "tickformat": ".0%",
            "rangemode": "tozero",
            "gridcolor": GRID,
            "zeroline": False,
        },
    }
    return json_of(traces, layout), reactions.DISTANCES[measure]


def _exceeded(values: np.ndarray, name: str, colour: str, dashed: bool) -> dict[str, Any]:
    kept = values[np.flatnonzero(values > LEAST_MM)]
    kept = kept[thinned(len(kept))]
    x = np.concatenate([[LEAST_MM], kept])
    above = 1.0 - np.searchsorted(values, x, side="right") / max(1, len(values))
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": x.round(4).tolist(),
        "y": above.round(6).tolist(),
        "line": {"color": colour, "width": 2.6 if dashed else 2, "shape": "hv", "dash": "dash" if dashed else "solid"},
        "hovertemplate": f"{name}: %{{y:.1%}} beyond %{{x:.1f}} mm<extra></extra>",
    }
