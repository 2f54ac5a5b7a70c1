"""Curves and axes that several figures of the report share, and the writing of figures as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.document.chart import ChartAxis, Curve
from ravenjax.stats.latency import Incidence
from ravenjax.store.files import write_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIRST_MS = 1.0
"""Where a logarithmic axis of time begins; times are whole milliseconds."""

_DATELESS: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figure(figure: Figure, path: Path, dpi: int = 160) -> None:
    """Write a figure as the kind that its file's ending names (.svg, .png or .pdf), without a date.
    dpi: of a .png."""
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
    """The curve of delays on an axis of `log_time`: it begins with the share that came within the
    first millisecond.

    band: with its own; of enumerated faults it has none.
    """
    edges = (curve.low, curve.high) if band else ()
    return Curve.steps(name, colour, curve.time, curve.fraction, *edges, start=FIRST_MS, end=end_ms)


def log_time(end_ms: int) -> ChartAxis:
    """Axis of delays after a fault's first effect."""
    end = max(float(end_ms), 10 * FIRST_MS)
    return ChartAxis("time after the fault's first effect, ms", FIRST_MS, end, log=True, unit="ms")


def share_axis(title: str, curves: list[Curve]) -> ChartAxis:
    """From 0 to above all curves, at most to 1."""
    most = max((float(curve.y.max()) for curve in curves if len(curve.y)), default=0.0)
    return ChartAxis(title, 0.0, min(1.0, 1.1 * most) if most else 1.0, share=True)
