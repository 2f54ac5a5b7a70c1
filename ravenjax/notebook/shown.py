"""A figure of matplotlib's that a notebook shows by itself, whatever its backend is."""

from __future__ import annotations

import io

import matplotlib
from matplotlib.figure import Figure

from ravenjax.document.figure_style import STYLE


class ShownFigure:
    """A drawing, for a notebook to show; `figure` is matplotlib's, to change or save."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def savefig(self, path: str, **options: object) -> None:
        """Write it to a file, as matplotlib's."""
        with matplotlib.rc_context(STYLE):
            self.figure.savefig(path, **options)  # pyright: ignore[reportArgumentType]

    def _repr_svg_(self) -> str:
        text = io.StringIO()
        with matplotlib.rc_context(STYLE):
            self.figure.savefig(text, format="svg", metadata={"Date": None})
        return text.getvalue()
