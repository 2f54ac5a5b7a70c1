"""Defines the colours of charts by meaning, for light and dark backgrounds.

The colours remain distinguishable in every form of colour blindness.
"""

from typing import NamedTuple

from ravenjax import resources


class Colour(NamedTuple):
    """One colour for a white background, which print uses, and for a dark background."""

    light: str
    dark: str


CUE, RESPONSE, SAME = "cue", "response", "same"
_PAIRS = resources.read_tables(__file__, "palette.toml")
PALETTE = {name: Colour(*pair) for name, pair in _PAIRS.items()}
"""Colours by name."""
SERIES = tuple(name for name in PALETTE if name.startswith("series"))
"""Names of the colours for several curves in one chart."""


def series_colour(number: int) -> str:
    """Return the name of the colour of curve `number`. The names repeat."""
    return SERIES[number % len(SERIES)]


def palette_css() -> str:
    """Return CSS that defines each colour as --NAME, for light and dark schemes."""
    light, dark = (
        " ".join(f"--{name}: {getattr(colour, scheme)};" for name, colour in PALETTE.items())
        for scheme in ("light", "dark")
    )
    in_dark = f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}"
    return f":root {{ {light} }}\n{in_dark}\n"
