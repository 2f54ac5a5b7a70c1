"""Defines chart colours by meaning, for light and dark backgrounds.

The colours remain distinguishable in every form of colour blindness.
"""

from __future__ import annotations

from typing import NamedTuple


class Colour(NamedTuple):
    """One colour in its light and dark variant. Print uses the light one."""

    light: str  # on white
    dark: str  # on a dark background


CUE, RESPONSE, SAME = "cue", "response", "same"
PALETTE = {
    CUE: Colour("#c2410c", "#f0824a"),  # vermilion and blue differ in every colour blindness
    RESPONSE: Colour("#0072b2", "#4aa8dd"),
    SAME: Colour("#7d848c", "#9aa3ad"),
    "series0": Colour("#0072b2", "#4aa8dd"),  # the series follow Okabe and Ito
    "series1": Colour("#c2410c", "#f0824a"),
    "series2": Colour("#009e73", "#2fc598"),
    "series3": Colour("#8b2a6b", "#d884b8"),
    "series4": Colour("#3f9fd6", "#8accf0"),
    "series5": Colour("#a67c00", "#d9ae2b"),
    "series6": Colour("#b65c94", "#e7a8cd"),
    "series7": Colour("#5b6470", "#b4bcc5"),
}
"""Colours by name."""
SERIES = tuple(name for name in PALETTE if name.startswith("series"))
"""Names of the colours for several curves in one chart."""


def series_colour(number: int) -> str:
    """Return the colour's name of a curve by its number; the names repeat."""
    return SERIES[number % len(SERIES)]


def palette_css() -> str:
    """Return the custom properties --NAME of a style sheet, for both schemes."""
    light, dark = (
        " ".join(f"--{name}: {getattr(colour, scheme)};" for name, colour in PALETTE.items())
        for scheme in ("light", "dark")
    )
    return (
        f":root {{ {light} }}\n@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }}"
        " }\n"
    )
