"""The recorded operator: what became of the recording, and its tip before and after."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.store.motion.options import MAX_GAP_S
from ravenjax.store.motion.resampling import TICK_S
from ravenjax.store.motion.summary import MotionSummary, TipLine, changes, table_rows

HEIGHT = 150  # px, of one coordinate


class TipDrawing(NamedTuple):
    """The charts of one arm: x, y and z."""

    arm: str
    charts: list[Chart]


class OperatorSection(NamedTuple):
    """What the page shows."""

    summary: MotionSummary
    file: str  # its name
    rows: list[tuple[str, str]]
    cells: list[dict[str, str]]  # the same, for CSV
    changes: list[str]
    command: str  # draws it in full
    drawings: list[TipDrawing]


def section(summary: MotionSummary | None) -> OperatorSection | None:
    """The section of a campaign whose operator was recorded; None for a generated one."""
    if summary is None:
        return None
    rows = table_rows(summary)
    return OperatorSection(
        summary=summary,
        file=Path(summary.file).name,
        rows=rows,
        cells=[{"what": what, "how it is": how} for what, how in rows],
        changes=changes(summary),
        command=_command(summary),
        drawings=[_drawing(summary, one.arm) for one in summary.arms],
    )


def _command(summary: MotionSummary) -> str:
    begin, end = summary.window_s
    keys = [f"operator.window_s=[{begin:.3f},{end + TICK_S:.3f}]"]
    if summary.clock.startswith("operator.rate_hz"):
        keys.append(summary.clock.replace(" ", ""))
    if summary.cutoff_hz is not None:
        keys.append(f"operator.cutoff_hz={summary.cutoff_hz:g}")
    if summary.spike_treatment != "refuse":
        keys.append(f"operator.spikes={summary.spike_treatment}")
    if summary.max_gap_s != MAX_GAP_S:
        keys.append(f"operator.max_gap_s={summary.max_gap_s:g}")
    if summary.slow_down != 1.0:
        keys.append(f"operator.slow_down={summary.slow_down:g}")
    arms = " ".join(one.arm for one in summary.arms)
    return (
        f"ravenjax motion {shlex.quote(summary.file)} --arms {arms} --set"
        f" {' '.join(map(shlex.quote, keys))}"
    )


def _drawing(summary: MotionSummary, arm: str) -> TipDrawing:
    """Tip coordinates over the time in the recording: all of it, and what is replayed."""
    colours = {
        "recorded": palette.SAME,
        "replayed": palette.series(0) if arm == robots.USUAL.arms[0] else palette.CUE,
    }
    lines = [line for line in summary.lines if line.arm == arm]
    charts = []
    for number, axis in enumerate("xyz"):
        curves = tuple(_curve(line, colours[line.what], number) for line in lines)
        time, value = (
            np.concatenate([part for one in curves for part in (getattr(one, name),)])
            for name in "xy"
        )
        margin = 0.05 * max(float(np.ptp(value)), 0.1)
        across = ChartAxis(
            "time in the recording, s", float(time.min()), float(time.max()), unit="s"
        )
        up = ChartAxis(
            f"{axis}, mm", float(value.min()) - margin, float(value.max()) + margin, unit="mm"
        )
        charts.append(Chart(f"Tip of {arm}, {axis}", across, up, curves, HEIGHT))
    return TipDrawing(arm, charts)


def _curve(line: TipLine, colour: str, number: int) -> Curve:
    values = np.array(line.numbers(("x_um", "y_um", "z_um")[number]), float)
    return Curve(line.what, colour, np.array(line.numbers("time_ms"), float) / 1e3, values / 1e3)
