"""Draws the main figures of a campaign for print, as SVG and PDF."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import matplotlib
import matplotlib.ticker
import numpy as np
from matplotlib.figure import Figure

from ravenjax.document.chart import Chart
from ravenjax.document.drawing import print_figure
from ravenjax.document.figure_style import STYLE
from ravenjax.report.data.facts import OUTCOME_WORDS, VALID_OUTCOMES
from ravenjax.report.data.runs import Runs
from ravenjax.report.drawing import save_figure
from ravenjax.report.sections import cues, detectors, tables, time_to_know
from ravenjax.store import manifest as manifests
from ravenjax.store.files import require_writable

WIDTH = 7.0  # inches, two columns of a page
OUTCOMES = {
    name: (OUTCOME_WORDS[name]["colour"], OUTCOME_WORDS[name]["label"]) for name in VALID_OUTCOMES
}
"""Colour and label of each outcome of a valid run, as on the HTML page."""
MOST_GROUPS = 40


def write_figures(folder: Path, out: Path) -> list[Path]:
    """Write a result folder's figures into `out`, each as .svg and .pdf; return their paths.

    They are verdicts, time_to_know, roc (only with detectors) and tradeoff. A figure without runs
    is left out. Raises StoreError if results cannot be read, or `out` cannot be written.
    """
    manifest = manifests.read_manifest(folder)
    require_writable(out)
    paths = []
    with contextlib.closing(Runs.open(folder, manifest)) as runs, matplotlib.rc_context(STYLE):
        for name in ("verdicts", *CHARTS):
            if (figure := draw_figure(runs, name)) is not None:
                for kind in ("svg", "pdf"):
                    paths.append(out / f"{name}.{kind}")
                    save_figure(figure, paths[-1])
    return paths


CHARTS: dict[str, Callable[[Runs], Chart | None]] = {
    "time_to_know": lambda runs: time_to_know.incidence_curves(runs)[0],
    "roc": lambda runs: detectors.curve_chart(detectors.detector_rows(runs), "roc"),
    "tradeoff": lambda runs: cues.cue_tradeoff(cues.cue_rows(runs)),
}
"""Charts that are figures, by the name of their file; None if there is nothing to draw."""


def draw_figure(runs: Runs, name: str) -> Figure | None:
    """Return the figure `name`; None if there is nothing to draw."""
    if name == "verdicts":
        return _verdict_figure(runs)
    chart = CHARTS[name](runs)
    return print_figure([chart], WIDTH / 2) if chart else None


def _verdict_figure(runs: Runs) -> Figure | None:
    # Draws each group's faults by outcome.
    rows = [row for row in tables.group_rows(runs) if row["faulty"]][:MOST_GROUPS]
    if not rows:
        return None
    figure = Figure(figsize=(WIDTH, 1.1 + 0.24 * len(rows)), layout="constrained")
    axis = figure.subplots()
    heights = np.arange(len(rows))
    left = np.zeros(len(rows))  # where each group's next bar begins
    for name, (colour, label) in OUTCOMES.items():
        share = np.array([row["outcomes"][name].value for row in rows])
        if share.any():
            axis.barh(heights, share, left=left, color=colour, label=label, height=0.72)
        left += share
    axis.set_yticks(heights, [f"{row['name']} ({row['n']:,})" for row in rows])
    axis.invert_yaxis()
    axis.set_xlim(0, 1)
    axis.grid(False)
    axis.xaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    axis.set_xlabel("share of faults")
    axis.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4, fontsize=8, handlelength=1.0)
    return figure
