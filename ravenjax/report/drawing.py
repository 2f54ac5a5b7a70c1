"""Writes figures as image files, with the style of the report."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.document.chart import Chart
from ravenjax.store.files import write_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DATELESS: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure in the format of the file name (.svg, .png, .pdf), without a date."""
    import matplotlib

    from ravenjax.document.figure_style import STYLE

    kind = path.suffix.lstrip(".") or "png"
    options = {"format": kind, "dpi": 160, "metadata": _DATELESS.get(kind, {})}
    with matplotlib.rc_context(STYLE):
        write_aside(path, lambda target: figure.savefig(target, **options))


def save_panels(path: Path, charts: Sequence[Chart], columns: int = 3, title: str = "") -> None:
    """Write charts as panels of one file, with a legend for each series of any of them."""
    from ravenjax.document.drawing import print_figure

    columns = min(columns, len(charts))
    save_figure(print_figure(charts, max(7.0, 3.6 * columns), columns, title), path)
