"""How the page writes a rate, a span, a time: with the expected numbers in place, as `page_text`
compares them.
"""

from __future__ import annotations

import math

import plain_statistics as plain
from expected_numbers import Expected
from page_text import DASH, Node, Text, count, number, percent, signed

ACTIONS = {1: "lift the pedal", 2: "slow down", 3: "correct by eye"}


def prose(node: Node, where: str) -> Text:
    """What a section says outside of its tables and replay commands."""
    return Text(node.without("table", "command", "tiles", "tab").words, where)


def many(n: int, noun: str) -> str:
    """One fault, two faults."""
    return f"{count(n)} {noun if n == 1 else noun + 's'}"


def between(k: int, n: int) -> str:
    """Wilson interval as it is printed."""
    low, high = plain.wilson(k, n)
    return f"{percent(low)}–{percent(high)} %" if n else "no runs"


def rate(k: int, n: int) -> str:
    """A cell with a share, its count and its interval."""
    return f"{percent(k / n) + ' %' if n else DASH} {count(k)} of {count(n)} {between(k, n)}"


def brief(k: int, n: int) -> str:
    """The same without the whole."""
    return f"{percent(k / n) + ' %' if n else DASH} {count(k)} · {between(k, n)}"


def share(k: int, n: int, noun: str = "") -> str:
    """The same in a sentence."""
    return (
        f"{count(k)} of {many(n, noun) if noun else count(n)} ({percent(k / n)} %, {between(k, n)})"
    )


def span(low: float, high: float) -> str:
    """Bounds of which one or both may be unknown."""
    if math.isfinite(low) and math.isfinite(high):
        return f"{number(low)}{DASH if low >= 0 else ' to '}{number(high)}"
    if not math.isfinite(low) and not math.isfinite(high):
        return ""
    return f"from {number(low)}" if math.isfinite(low) else f"up to {number(high)}"


def timed(known: plain.Known) -> str:
    """A cell with a median and its bounds."""
    value, low, high = known
    if not math.isfinite(value):
        return f"{DASH} {span(low, high)}".strip()
    return f"{number(value)} ms {span(low, high)}".strip()


def points(known: plain.Known) -> str:
    """A difference of rates with its bounds, where it has any."""
    value, low, high = known
    if math.isnan(low):
        return f"{signed(value)} points"
    return f"{signed(value)} points ({signed(low)} to {signed(high)})"


def are(n: int) -> str:
    """One is, two are."""
    return "is" if n == 1 else "are"


def false_cues(e: Expected) -> str:
    """The sentence on cues in fault-free motion."""
    k, n = e.false_cues, len(e.motions)
    motions = many(n, "fault-free motion")
    return (
        f"Without any fault the {e.threshold} cue came in {count(k)} of {motions}"
        f" ({between(k, n)})."
    )


def estimate(known: plain.Known) -> str:
    """A median with its bounds in brackets."""
    value, low, high = known
    if not math.isfinite(value):
        return DASH
    bounds = span(low, high)
    return f"{number(value)} ms" + (f" ({bounds})" if bounds else "")


def hourly(first: tuple[int, float] | None) -> str:
    """A cell with first false alarms an hour, of how many in how many hours."""
    if first is None or not first[1]:
        return DASH
    value, low, high = plain.poisson(*first)
    return f"{number(value)} {count(first[0])} · {number(low)}{DASH}{number(high)}"


def duration(hours: float) -> str:
    """Hours in the unit that suits them."""
    for most, unit, factor in ((1 / 30, "s", 3600), (2, "min", 60)):
        if hours < most:
            return f"{number(hours * factor, 2)} {unit}"
    return f"{number(hours)} h"
