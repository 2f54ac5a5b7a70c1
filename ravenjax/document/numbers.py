"""Formats numbers as text, for charts, reports and tables."""

import math

NARROW = "\u202f"
DASH = "–"


def format_count(value: float) -> str:
    """Write an integer with separators: 1234 -> 1,234."""
    return f"{int(value):,}"


def count_noun(value: float, noun: str) -> str:
    """Write a count with its noun: 1,234 runs, 1 run."""
    return f"{format_count(value)} {noun}{'' if value == 1 else 's'}"


def format_number(value: float, digits: int = 3) -> str:
    """Write a number with `digits` significant digits; NaN and infinity become a dash."""
    if not math.isfinite(value):
        return DASH
    value += 0.0  # turns -0.0 into 0.0, which has no minus sign
    if value == 0 or 1e-6 <= abs(value) < 1e7:
        # 12.345 has the exponent 1, so three digits need one decimal.
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:,.{decimals}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        text = f"{value:.{digits}g}"
    return text.replace("-", "−")


def percent_decimals(fraction: float) -> int:
    """Return the number of decimals of a fraction in percent."""
    return 2 if 0 < fraction < 0.01 or 0.99 < fraction < 1 else 1


def format_percent(fraction: float) -> str:
    """Write a fraction in percent: 15.6 %. Below 1 % and above 99 % with a second decimal.
    NaN and infinity become a dash.
    """
    if not math.isfinite(fraction):
        return DASH
    return f"{100 * fraction:.{percent_decimals(fraction)}f}{NARROW}%"
