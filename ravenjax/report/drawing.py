"""Writes figures as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.store.files import write_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DATELESS: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figure(figure: Figure, path: Path, dpi: int = 160) -> None:
    """Write a figure as its file name says (.svg, .png, .pdf), without a date. `dpi`: of .png."""
    kind = path.suffix.lstrip(".") or "png"
    write_aside(
        path,
        lambda target: figure.savefig(
            target, format=kind, dpi=dpi, metadata=_DATELESS.get(kind, {})
        ),
    )
