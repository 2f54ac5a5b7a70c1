"""Defines curves and axes that several figures of the report share, and writes figures as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.document.chart import ChartAxis, Curve
from ravenjax.stats.latency import Incidence
from ravenjax.store.files import write_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIRST_MS = 1.0
"""Start of a logarithmic time axis, in ms. Times are whole milliseconds."""

_DATELESS: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figure(figure: Figure, path: Path, dpi: int = 160) -> None:
    """Write a figure in the format of its file name's ending (.svg, .png or .pdf), without a date.
    `dpi` applies to .png.
    """
    kind = path.suffix.lstrip(".") or "png"
    write_aside(
        path,
        lambda target: figure.savefig(
            target, format=kind, dpi=dpi, metadata=_DATELESS.get(kind, {})
        ),
    )


def incidence_curve(
    curve: Incidence, name: str, colour: str, end_ms: int, band: bool = True
) -> Curve:
    """Return the curve of delays for an axis of `log_time`. It begins with the share of events
    within the first millisecond.

    `band`: draw the confidence band. Enumerated faults have none.
    """
    edges = (curve.low, curve.high) if band else ()
    return Curve.steps(name, colour, curve.time, curve.fraction, *edges, start=FIRST_MS, end=end_ms)


def log_time(end_ms: int) -> ChartAxis:
    """Return a logarithmic axis of delays after a fault's first effect."""
    end = max(float(end_ms), 10 * FIRST_MS)
    return ChartAxis("time after the fault's first effect, ms", FIRST_MS, end, log=True, unit="ms")


def share_axis(title: str, curves: list[Curve]) -> ChartAxis:
    """Return an axis of shares from 0 to above all curves, at most to 1."""
    most = max((float(curve.y.max()) for curve in curves if len(curve.y)), default=0.0)
    return ChartAxis(title, 0.0, min(1.0, 1.1 * most) if most else 1.0, share=True)
