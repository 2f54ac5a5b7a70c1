"""Numbers in the words of the benchmark's tables and sentences."""

from __future__ import annotations

import math

from ravenjax.bench.clock import Repeats

UNKNOWN = "?"
"""In place of a number that is none."""


def millions(rate: float) -> str:
    """So many millions, three digits or all before the point."""
    if not math.isfinite(rate):
        return UNKNOWN
    return f"{rate / 1e6:,.0f}" if rate >= 1e8 else f"{rate / 1e6:.3g}"


def seconds(value: float) -> str:
    """A time in the unit that suits it."""
    if not math.isfinite(value):
        return UNKNOWN
    if abs(value) >= 99.95:
        return f"{value:.0f} s"
    if abs(value) >= 0.9995:
        return f"{value:.1f} s" if abs(value) >= 9.95 else f"{value:.2f} s"
    return f"{1e3 * value:.3g} ms" if abs(value) >= 1e-3 else f"{1e6 * value:.3g} us"


def percent(share: float) -> str:
    """A share in hundredths."""
    return f"{100 * share:.0f} %" if math.isfinite(share) else UNKNOWN


def repeats(some: Repeats) -> str:
    """How many there are, and how far they lie apart."""
    number = len(some.values)
    return "once" if number < 2 else f"{number}, +-{50 * some.spread:.0f} %"


def times(ratio: float) -> str:
    """A ratio."""
    if not math.isfinite(ratio):
        return UNKNOWN
    return f"{ratio:,.0f}" if abs(ratio) >= 99.5 else f"{ratio:.3g}"


def megabytes(value: float) -> str:
    """Memory."""
    return f"{value:,.0f} MB" if math.isfinite(value) else UNKNOWN


def several(number: int, one: str, many: str = "") -> str:
    """A number and its noun."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def compared(one: Repeats, other: Repeats, how: str) -> str:
    """ "0.32 times as long": one over the other at their best; "about as long" where their repeats
    overlap.

    how: "as long" of times, "as fast" of rates.
    """
    pick = min if how == "as long" else max
    ratio = pick(one.values) / pick(other.values) if pick(other.values) else math.nan
    overlap = max(one.smallest, other.smallest) <= min(one.largest, other.largest)
    if overlap and len(one.values) > 1 and len(other.values) > 1:
        return f"about {how} ({times(ratio)} times)"
    return f"{times(ratio)} times {how}"


def last_line(output: str) -> str:
    """Of what a program wrote: there its error is."""
    return next(
        (line.strip() for line in reversed(output.splitlines()) if line.strip()), "it said nothing"
    )
