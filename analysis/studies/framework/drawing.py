"""How a study's drawings look and are saved: the style of the trace plot, text as text, no
dates.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.document import figure_style
from ravenjax.document.palette import CUE, PALETTE
from ravenjax.store.files import write_aside
from studies.framework.study import Drawing

PUBLISHED, PREDICTED, THRESHOLD, MUTED = "#1b1f24", "#0072b2", PALETTE[CUE].light, "#5b6470"
"""What was published is dark, what ravenjax predicts is blue; the cue has its own colour as in
the report.
"""
SERIES = ("#0072b2", "#d9571b", "#009e73", "#8b2a6b", "#b8860b", "#56b4e9", "#7a6a00", "#555555")
FAULT = "#d9571b"

STYLE: dict[Any, Any] = figure_style.STYLE | {
    "pdf.fonttype": 42,
    "axes.axisbelow": True,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.unicode_minus": True,
    "legend.fontsize": 8,
}
DATELESS: dict[str, dict[str, Any]] = {
    "svg": {"Date": None},
    "pdf": {"CreationDate": None, "ModDate": None},
}
WIDTH_IN = 7.6
"""Width of a drawing: a page's text."""


def save(drawing: Drawing, folder: Path) -> None:
    """Write FOLDER/NAME.svg and .pdf; it is drawn once for each, on an empty figure of its own."""
    import matplotlib
    from matplotlib.figure import Figure

    for kind, dateless in DATELESS.items():
        with matplotlib.rc_context(STYLE):
            figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
            drawing.draw(figure)
            path = folder / f"{drawing.name}.{kind}"

            def written(
                target: Path, figure: Any = figure, kind: str = kind, dateless: Any = dateless
            ) -> None:
                figure.savefig(target, format=kind, metadata=dateless)

            write_aside(path, written)
