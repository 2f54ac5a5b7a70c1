"""The main figures of a campaign for print: verdicts by group, time to know, ROC, the cue's trade-off; SVG and PDF."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib
import matplotlib.ticker
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ravenjax.figure_style import STYLE
from ravenjax.report import answers, cue_sweep, detectors, tables
from ravenjax.report.counted import incidence
from ravenjax.report.runs import Runs
from ravenjax.report.style import CUE, RESPONSE, SAME, SERIES
from ravenjax.stats.latency import Incidence
from ravenjax.store import manifest as manifests
from ravenjax.store.files import require_writable, write_aside
from ravenjax.store.manifest import Manifest

WIDTH = 7.0  # in, two columns of a page
OUTCOMES = {
    "stopped": (RESPONSE, "stopped"),
    "flagged": ("#56b4e9", "flagged"),
    "felt": ("#d9571b", "moved, cue fired"),
    "unseen": ("#8b2a6b", "moved, no cue"),
    "phantom": ("#e9b18f", "stayed near, cue fired"),
    "jumped": ("#c9a3bd", "stayed near, jumped"),
    "quiet": ("#d5d2cb", "stayed near"),
    "failed": ("#111418", "failed"),
}
"""Colour and label of each outcome, as on the page."""
MOST_GROUPS = 40


def write(folder: Path, out: Path) -> list[Path]:
    """Draw the figures of a result folder into `out`, each as .svg and .pdf, and return their paths.

    verdicts: share of each group's runs by outcome. time_to_know: cue, built-in response and first possible knowledge
    after the first effect. roc: where the campaign has detectors. tradeoff: missed hazards over false cues. A figure
    for which there are no runs is left out. Raises StoreError where the folder holds no readable result or `out` cannot
    be written.
    """
    folder, out = Path(folder), Path(out)
    manifest = manifests.read(folder)
    require_writable(out)
    paths = []
    with contextlib.closing(Runs.open(folder, manifest)) as runs, matplotlib.rc_context(STYLE):
        for name, figure in _figures(runs, manifest):
            for kind, dateless in (("svg", {"Date": None}), ("pdf", {"CreationDate": None})):
                path = out / f"{name}.{kind}"
                write_aside(path, _saved(figure, kind, dateless))
                paths.append(path)
    return paths


def _saved(figure: Figure, kind: str, metadata: dict[str, None]) -> Callable[[Path], None]:
    return lambda target: figure.savefig(target, format=kind, metadata=metadata)


def _figures(runs: Runs, manifest: Manifest) -> Iterator[tuple[str, Figure]]:
    found = detectors.alarms(runs, manifest)
    rows = [row for row in tables.group_rows(runs, plain=True) if row["faulty"]][:MOST_GROUPS]
    if rows:
        yield "verdicts", _verdicts(rows)
        yield "time_to_know", _times(runs, manifest, detectors.known(found))
    if manifest.detectors:
        told = detectors.rows(runs, manifest, found)
        if any(row.roc for row in told):
            yield "roc", _roc(told)
    sweep = [row for row in cue_sweep.rows(runs, manifest) if row.missed.n and row.per_hour]
    if sweep:
        yield "tradeoff", _tradeoff(sweep)


def _verdicts(rows: list[dict]) -> Figure:
    figure = Figure(figsize=(WIDTH, 1.1 + 0.24 * len(rows)), layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(rows))
    left = np.zeros(len(rows))
    for name, (colour, label) in OUTCOMES.items():
        share = np.array([row["outcomes"][name].value for row in rows])
        if share.any():
            axes.barh(place, share, left=left, color=colour, label=label, height=0.72)
        left += share
    axes.set_yticks(place, [f"{row['name']} ({row['n']:,})" for row in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, 1)
    axes.grid(False)
    axes.xaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    axes.set_xlabel("share of runs")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4, fontsize=8, handlelength=1.0)
    return figure


def _times(runs: Runs, manifest: Manifest, known_sql: str) -> Figure:
    figure = Figure(figsize=(WIDTH / 2, 3.1), layout="constrained")
    axes = figure.subplots()
    for name, event, colour in (("haptic cue", "cue_ms", CUE), ("built-in response", "response_ms", RESPONSE)):
        delay, _ = tables.delays(runs, event, manifest.duration_ms, "sample")
        _curve(axes, incidence(delay), name, colour, manifest.duration_ms)
    known = answers.knowledge(runs, known_sql, manifest)
    _curve(axes, known.delay, "anyone, of harmful faults", SAME, manifest.duration_ms)
    axes.set_xscale("log")
    axes.set_xlim(1, manifest.duration_ms)
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    axes.set_xlabel("time after the fault's first effect, ms")
    axes.set_ylabel("share of faults")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), fontsize=7.5)
    return figure


def _curve(axes: Axes, curve: Incidence, name: str, colour: str, end_ms: int) -> None:
    if not curve.n:
        return
    time = np.maximum(np.append(curve.time, max(end_ms, curve.time[-1])), 1.0)
    value, low, high = (np.append(part, part[-1]) for part in (curve.fraction, curve.low, curve.high))
    axes.fill_between(time, low, high, step="post", color=colour, alpha=0.18, lw=0)
    axes.step(time, value, where="post", color=colour, lw=1.4, label=f"{name} ({curve.events:,} of {curve.n:,})")


def _roc(rows: list[detectors.Row]) -> Figure:
    figure = Figure(figsize=(WIDTH / 2, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#c8ccd0", lw=0.8, ls=(0, (1, 2)))
    for number, row in enumerate(rows):
        colour = SERIES[number % len(SERIES)]
        if row.roc is not None:
            area = row.roc.area
            axes.fill_between(row.roc.grid, row.roc.curve.low, row.roc.curve.high, color=colour, alpha=0.15, lw=0)
            axes.plot(row.roc.grid, row.roc.curve.value, color=colour, lw=1.4, label=f"{row.name} ({area.value:.3f})")
        else:
            (level,) = row.levels
            axes.plot(level.harmless.value, level.caught.value, "D", ms=5, color=colour, label=row.name)
    axes.set_xlim(-0.01, 1.01)
    axes.set_ylim(-0.01, 1.01)
    axes.set_xlabel("share of harmless runs with an alarm")
    axes.set_ylabel("share of harmful runs with an alarm")
    axes.legend(loc="lower right", fontsize=7)
    return figure


def _tradeoff(rows: list[cue_sweep.Row]) -> Figure:
    figure = Figure(figsize=(WIDTH / 2, 2.6), layout="constrained")
    axes = figure.subplots()
    told: set[float] = set()
    for best, colour in ((False, SAME), (True, CUE)):
        for row in rows:
            if row.best != best or row.per_hour is None:
                continue
            x, y = row.per_hour.per_hour, row.missed.value
            axes.errorbar(
                x, y, [[y - row.missed.low], [row.missed.high - y]], fmt="o", ms=4.5, color=colour, elinewidth=0.8
            )
            if row.cue.threshold_mm not in told:
                told.add(row.cue.threshold_mm)
                axes.annotate(f"{row.cue.threshold_mm:g} mm", (x, y), (5, 2), textcoords="offset points", fontsize=7.5)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    axes.set_xlabel("false cues per hour of fault-free motion")
    axes.set_ylabel("harmful faults without a cue")
    return figure
