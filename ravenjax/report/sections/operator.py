"""The recorded operator: what became of the recording, and its tip before and after."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.report.sections import Section
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.resampling import TICK_S
from ravenjax.store.motion.summary import MotionSummary, changes, table_rows

HEIGHT = 150  # px, of one coordinate


class TipDrawing(NamedTuple):
    """The charts of one arm: x, y and z."""

    arm: str
    charts: list[Chart]


def content(summary: MotionSummary | None) -> dict[str, Any] | None:
    """What the page shows of a recorded operator; None of a generated one."""
    if summary is None:
        return None
    rows = table_rows(summary)
    return {
        "summary": summary,
        "file": Path(summary.file).name,
        "rows": rows,
        "cells": [{"what": what, "how it is": how} for what, how in rows],
        "changes": changes(summary),
        "redraw": _command(summary),  # draws it in full
        "drawings": [_drawing(summary, one.arm) for one in summary.arms],
    }


SECTIONS = (Section("operator", "Operator", 170, lambda runs, _: content(runs.manifest.operator)),)


def _command(summary: MotionSummary) -> str:
    begin, end = summary.window_s
    keys = {
        name: f"{value}"
        for name, value in dataclasses.asdict(summary.options).items()
        if value != getattr(ReplayOptions(), name)
    }
    keys["window_s"] = f"[{begin:.3f},{end + TICK_S:.3f}]"
    arms = " ".join(one.arm for one in summary.arms)
    return f"ravenjax motion {shlex.quote(summary.file)} --arms {arms} --set " + " ".join(
        shlex.quote(f"operator.{name}={value}") for name, value in keys.items()
    )


def _drawing(summary: MotionSummary, arm: str) -> TipDrawing:
    """Tip coordinates over the time in the recording: all of it, and what is replayed."""
    colours = {
        "recorded": palette.SAME,
        "replayed": palette.series(0) if arm == robots.USUAL.arms[0] else palette.CUE,
    }
    charts = []
    for axis in "xyz":
        curves = tuple(
            Curve(
                line.what,
                colours[line.what],
                np.array(line.numbers("time_ms"), float) / 1e3,
                np.array(line.numbers(f"{axis}_um"), float) / 1e3,
            )
            for line in summary.lines
            if line.arm == arm
        )
        time = np.concatenate([one.x for one in curves])
        value = np.concatenate([one.y for one in curves])
        margin = 0.05 * max(float(np.ptp(value)), 0.1)
        title = "time in the recording, s"
        across = ChartAxis(title, float(time.min()), float(time.max()), unit="s")
        low, high = float(value.min()) - margin, float(value.max()) + margin
        up = ChartAxis(f"{axis}, mm", low, high, unit="mm")
        charts.append(Chart(f"Tip of {arm}, {axis}", across, up, curves, HEIGHT))
    return TipDrawing(arm, charts)
