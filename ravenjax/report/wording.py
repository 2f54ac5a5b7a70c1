"""Numbers and faults as words of the report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ravenjax.stats.intervals import Estimate, Rate

NARROW = "\u202f"
DASH = "–"


def count(value: float) -> str:
    """1234 -> 1,234."""
    return f"{int(value):,}"


def number(value: float, digits: int = 3) -> str:
    """`digits` significant digits without exponent for usual sizes; a dash for what is not finite."""
    if not math.isfinite(value):
        return DASH
    if value == 0 or 1e-6 <= abs(value) < 1e7:
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:,.{decimals}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        text = f"{value:.{digits}g}"
    return text.replace("-", "−")


def _decimals(fraction: float) -> int:
    return 2 if 0 < fraction < 0.01 or 0.99 < fraction < 1 else 1


def percent(fraction: float) -> str:
    """0.156 -> 15.6 %; a second decimal close to 0 and 100 %."""
    if math.isnan(fraction):
        return DASH
    return f"{100 * fraction:.{_decimals(fraction)}f}{NARROW}%"


def interval(rate: Rate) -> str:
    """14.1–17.3 %, of a rate's confidence interval."""
    if not rate.n:
        return "no runs"
    digits = max(_decimals(rate.low), _decimals(rate.high))
    return f"{100 * rate.low:.{digits}f}{DASH}{100 * rate.high:.{digits}f}{NARROW}%"


def estimate(value: Estimate, unit: str = "") -> str:
    """12 ms (9–15), of an estimate; a bound that is not known is a dash, and so is the whole where nothing is known."""
    if not math.isfinite(value.value):
        return DASH
    unit = f" {unit}" if unit else ""
    if not (math.isfinite(value.low) or math.isfinite(value.high)):
        return f"{number(value.value)}{unit}"
    return f"{number(value.value)}{unit} ({span(value.low, value.high)})"


def signed_points(difference: float) -> str:
    """−3.1 points, of a difference of rates."""
    if not math.isfinite(difference):
        return DASH
    shown = f"{100 * difference:+.1f}"
    return f"{'0.0' if shown in ('+0.0', '-0.0') else shown} points".replace("-", "−")


def point_bounds(value: Estimate) -> str:
    """−4.0 to −2.2, the interval of a difference of rates in points."""
    if not (math.isfinite(value.low) and math.isfinite(value.high)):
        return ""
    return f"{100 * value.low:+.1f} to {100 * value.high:+.1f}".replace("-", "−")


def points(value: Estimate) -> str:
    """−3.1 points (−4.0 to −2.2)."""
    bounds = point_bounds(value)
    return signed_points(value.value) + (f" ({bounds})" if bounds else "")


def bounds(value: Estimate, decimals: int | None = None) -> str:
    """9–15, the interval of an estimate; empty where nothing is known. decimals: of rounded numbers."""
    low, high = (bound if decimals is None else round(bound, decimals) for bound in (value.low, value.high))
    return span(low, high) if math.isfinite(low) or math.isfinite(high) else ""


def hundredths(value: float) -> str:
    """−0.04, at most two decimals."""
    return number(round(value, 2)) if math.isfinite(value) else DASH


def span(low: float, high: float) -> str:
    """9–15, or −4 to 2 where a bound is negative; an unknown bound is open."""
    if math.isfinite(low) and math.isfinite(high):
        return f"{number(low)}{DASH}{number(high)}" if low >= 0 else f"{number(low)} to {number(high)}"
    return f"from {number(low)}" if math.isfinite(low) else f"up to {number(high)}"


def fault(row: Mapping[str, Any]) -> str:
    """The faults of one result row in a phrase: usb_out gold shoulder, overwrite 500, 9 ms from 1,200 ms (time)."""
    phrases = []
    slot = 0
    while f"fault{slot}_site" in row:
        name = f"fault{slot}_"
        if row[f"{name}site"]:
            where = " ".join(str(row[name + key]) for key in ("site", "arm", "channel") if row[name + key])
            value = row[f"{name}value"]
            what = str(row[f"{name}effect"]) + ("" if math.isnan(value) else f" {number(value, 5)}")
            length = row[f"{name}duration_ms"]
            start = f"from {count(row[f'{name}start_ms'])} ms"
            when = f"{count(length)} ms {start}" if length >= 0 else f"{start} to the end"
            every = f", every {count(row[f'{name}every_ms'])} ms" if row[f"{name}every_ms"] > 0 else ""
            trigger = row[f"{name}trigger"]
            phrases.append(f"{where}, {what}, {when}{every}" + (f" ({trigger})" if trigger else ""))
        slot += 1
    return "; ".join(phrases) or "no fault"
