"""Formats rates, estimates and faults as text, and fills text templates."""

import functools
import math
from collections.abc import Mapping
from typing import Any

import jinja2

from ravenjax.document.numbers import (
    DASH,
    NARROW,
    count_noun,
    format_count,
    format_number,
    format_percent,
    percent_decimals,
)
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.vocabulary.effects import FIELDS
from ravenjax.vocabulary.robot import Robot


def format_hours(value: float) -> str:
    """Write a time given in hours in a suitable unit: 34 s, 12 min, 7.4 h."""
    if not math.isfinite(value):
        return DASH
    # Times below 2 min are in s, times below 2 h in min, with two digits.
    for limit, unit, per_hour in ((1 / 30, "s", 3600.0), (2.0, "min", 60.0)):
        if value < limit:
            return f"{format_number(value * per_hour, 2)} {unit}"
    return f"{format_number(value)} h"


def format_interval(rate: Rate) -> str:
    """Write a rate's confidence interval: 14.1–17.3 %. It is empty if nothing was sampled."""
    if not rate.n:
        return "no runs"
    if math.isnan(rate.low):
        return ""
    digits = max(percent_decimals(rate.low), percent_decimals(rate.high))
    return f"{100 * rate.low:.{digits}f}{DASH}{100 * rate.high:.{digits}f}{NARROW}%"


def format_rate(value: Rate) -> str:
    """Write a rate with its interval if it has one: 15.6 % (14.1–17.3 %)."""
    bounds = format_interval(value)
    return format_percent(value.value) + (f" ({bounds})" if bounds else "")


def format_estimate(value: Estimate, unit: str = "") -> str:
    """Write an estimate with its interval: 12 ms (9–15). An unknown value becomes a dash."""
    if not math.isfinite(value.value):
        return DASH
    bounds = format_bounds(value)
    return f"{format_number(value.value)} {unit}".rstrip() + (f" ({bounds})" if bounds else "")


def signed_points(difference: float) -> str:
    """Write a difference of rates, given as a fraction, in percentage points: −3.1 points."""
    if not math.isfinite(difference):
        return DASH
    text = f"{100 * difference:+.1f}"
    return f"{'0.0' if text in ('+0.0', '-0.0') else text} points".replace("-", "−")


def point_bounds(value: Estimate) -> str:
    """Write the interval of a difference of rates: −4.0 to −2.2."""
    if not (math.isfinite(value.low) and math.isfinite(value.high)):
        return ""
    return f"{100 * value.low:+.1f} to {100 * value.high:+.1f}".replace("-", "−")


def format_points(value: Estimate) -> str:
    """Write a difference of rates with its interval: −3.1 points (−4.0 to −2.2)."""
    bounds = point_bounds(value)
    return signed_points(value.value) + (f" ({bounds})" if bounds else "")


def format_bounds(value: Estimate, decimals: int | None = None) -> str:
    """Write the interval of an estimate: 9–15; "" without an interval."""
    low, high = value.low, value.high
    if decimals is not None:
        low, high = round(low, decimals), round(high, decimals)
    return format_span(low, high) if math.isfinite(low) or math.isfinite(high) else ""


def format_span(low: float, high: float) -> str:
    """Write a range: 9–15, or −4 to 2 if a bound is negative. An unknown bound is left open."""
    if not math.isfinite(low):
        return f"up to {format_number(high)}"
    if not math.isfinite(high):
        return f"from {format_number(low)}"
    return f"{format_number(low)}{DASH if low >= 0 else ' to '}{format_number(high)}"


def describe_fault(row: Mapping[str, Any], robot: Robot) -> str:
    """Describe a row's faults: usb_out gold shoulder, overwrite 500 counts, 9 ms from 1,200 ms."""
    return "; ".join(filter(None, fault_phrases(row, robot))) or "no fault"


def fault_phrases(row: Mapping[str, Any], robot: Robot) -> list[str]:
    """Describe the fault in each slot of a row; "" for an empty slot."""
    count = sum(name.startswith("fault") and name.endswith("_site") for name in row)
    slots = [[row[f"fault{slot}_{key}"] for key in FIELDS] for slot in range(count)]
    return fill_template("faults.txt.j2", slots=slots, robot=robot)


FILTERS = {
    "count": format_count,
    "many": count_noun,
    "number": format_number,
    "hours": format_hours,
    "percent": format_percent,
    "rate": format_rate,
    "interval": format_interval,
    "estimate": format_estimate,
    "bounds": format_bounds,
    "points": format_points,
    "signed_points": signed_points,
    "point_bounds": point_bounds,
}
"""The functions of this module that templates use as filters."""


@functools.cache
def text_templates(package: str) -> jinja2.Environment:
    """Return an environment for the plain-text templates of a package, with FILTERS."""
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    templates.tests["nan"] = math.isnan
    templates.filters |= FILTERS
    return templates


def fill_template(template: str, **values: Any) -> list[str]:
    """Return a filled template of the report as a list of sentences, one per line."""
    return text_templates("ravenjax.report").get_template(template).render(values).splitlines()


def fill_table(template: str, **values: Any) -> list[tuple[str, ...]]:
    """Return the rows of a template with cells separated by "|"; the first are the headings."""
    return [tuple(line.split("|")) for line in fill_template(template, **values)]
