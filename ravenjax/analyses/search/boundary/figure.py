"""Draws the smallest harmful value over one list of the file, with a line for each other case."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ravenjax.analyses.search.boundary.brackets import ALWAYS, CROSSING, INVALID, NEVER
from ravenjax.analyses.search.style import COLOURS, MARKERS
from ravenjax.analyses.search.wording import describe_case, short_axis_name
from ravenjax.document.figure_style import INK, SOFT

Record = dict[str, Any]


def draw(numbers: dict[str, Any]) -> Figure:
    """Draw the numbers of `bisection.find`: a panel for each value of the first list."""
    cells, searched = numbers["cells"], numbers["searched"]
    along = numbers["along"]
    names = [name for name in cells[0]["cell"] if name != along]
    panel = names[0] if len(names) > 1 else None
    panels = list(dict.fromkeys(record["cell"][panel] for record in cells)) if panel else [None]
    lines = [name for name in names if name != panel]
    kinds = list(dict.fromkeys(tuple(record["cell"][name] for name in lines) for record in cells))
    figure = Figure(figsize=(2.6 + 2.7 * len(panels), 3.6), layout="constrained")
    panes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, value in zip(panes, panels, strict=True):
        part = [record for record in cells if panel is None or record["cell"][panel] == value]
        for kind, colour, marker in zip(
            kinds, itertools.cycle(COLOURS), itertools.cycle(MARKERS), strict=False
        ):
            line = [r for r in part if tuple(r["cell"][name] for name in lines) == kind]
            name = describe_case(dict(zip(lines, kind, strict=True)))
            _line(axes, line, along, searched, colour, marker, name)
        _scales(axes, along, searched, part)
        if value is not None:
            axes.set_title(f"{short_axis_name(panel or '').partition(',')[0]} {value}")
    unit = f", {searched['unit']}" if searched["unit"] else ""
    panes[0].set_ylabel(
        f"smallest harmful {short_axis_name(searched['name']).partition(',')[0]}{unit}"
    )
    _explain(panes[0], cells)
    handles, labels = panes[0].get_legend_handles_labels()
    if any(labels):
        figure.legend(handles, labels, loc="outside right upper")
    figure.suptitle(f"harm: {numbers['harm']}", x=0.01, ha="left", fontsize=10, fontweight="bold")
    return figure


def _line(
    axes: Any,
    line: list[Record],
    along: str | None,
    searched: dict[str, Any],
    colour: str,
    marker: str,
    name: str,
) -> None:
    """Draw brackets as bars, censored cells as arrows, and a ring around non-monotone ones."""
    place = {id(record): record["cell"][along] if along else 0 for record in line}
    line = sorted(line, key=lambda record: place[id(record)])
    crossed = [record for record in line if record["state"] == CROSSING]
    x = [place[id(record)] for record in crossed]
    low, high = (np.abs([record[side] for record in crossed]) for side in ("harmless", "harmful"))
    style = {"color": colour, "marker": marker, "ms": 4.5}
    if crossed:
        axes.errorbar(x, high, yerr=[high - low, np.zeros(len(x))], lw=1.2, elinewidth=2.5, **style)
    axes.plot([], [], lw=1.2, label=name, **style)
    for record in line:
        at = place[id(record)]
        for state, end, arrow in ((NEVER, searched["high"], "^"), (ALWAYS, searched["low"], "v")):
            if record["state"] == state:
                axes.plot(
                    at, end, marker=arrow, mfc="none", mec=colour, ms=8, ls="none", clip_on=False
                )
        if not record["monotone"] and record["state"] != INVALID:
            height = abs(record["harmful"])
            axes.plot(at, height, marker="o", mfc="none", mec=INK, ms=12, ls="none", clip_on=False)


def _explain(axes: Any, cells: list[Record]) -> None:
    style = {"mfc": "none", "mec": SOFT, "ls": "none"}
    for state, marker, meaning in (
        (NEVER, "^", "harmless in the whole range"),
        (ALWAYS, "v", "harmful in the whole range"),
    ):
        if any(record["state"] == state for record in cells):
            axes.plot([], [], marker=marker, ms=8, label=meaning, **style)
    if not all(record["monotone"] for record in cells):
        axes.plot(
            [], [], marker="o", ms=11, label="harm comes and goes above", **(style | {"mec": INK})
        )


def _scales(axes: Any, along: str | None, searched: dict[str, Any], shown: list[Record]) -> None:
    if searched["scale"] == "log":
        axes.set_yscale("log")
    axes.set_ylim(searched["low"], searched["high"])
    if along is None:
        axes.set_xticks([])
        return
    axes.set_xlabel(short_axis_name(along))
    values = sorted({record["cell"][along] for record in shown})
    if len(values) > 2 and values[0] > 0 and values[-1] / values[0] >= 10:
        axes.set_xscale("log")
        axes.set_xticks(values, [f"{value:g}" for value in values], fontsize=8)
        axes.minorticks_off()
