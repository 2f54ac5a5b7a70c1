"""Generates a monitor's source code: Python for campaigns, and C99 for the software of a robot.

Both files compute the same bits. They read every number as a float, and NaN as 0. The C code does
the same operations in the same order as the Python file, and rounds each result to float. If a
compiler fused a product and a sum, bits would change. The C code has no product that could be
fused. In the Python file a test for NaN lies between each product and the next sum. Every compiler
with IEEE arithmetic therefore gives the same bits. With -ffast-math the bits may differ.
"""

from collections.abc import Sequence
from typing import Any

from ravenjax.analyses.monitors.monitor import (
    WHOLE,
    Monitor,
    Segments,
    input_expressions,
    input_name,
)
from ravenjax.analyses.monitors.scores import Score
from ravenjax.report import wording

PART, HEADER, SOURCE, TEST = "monitor.py", "monitor.h", "monitor.c", "monitor_test.c"
"""Files of a monitor. A template with the name of the file generates it."""


def write_part(
    terms: Sequence[Score],
    segments: Segments = WHOLE,
    scales: Sequence[Sequence[float]] | None = None,
    title: str = "",
    segment: int | None = None,
    stores_inputs: bool = False,
) -> str:
    """Return a Python file's text that computes the largest score of the terms, divided by scales.

    `terms`: scores with one channel each. `scales`: scale of each term in each segment; None: the
    scales in the terms. `title`: docstring of the file; default: what the terms observe. `segment`:
    the only segment in which the score is not 0; None: all. `stores_inputs`: the file's state also
    contains its inputs as `read_NAME`, and its score.
    """
    if scales is None:
        # The term's only scale is valid in all segments.
        scales = [term.scales * segments.count for term in terms]
    values = _template_values(terms, segments, scales)
    if stores_inputs:
        values["state"] |= {f"read_{name}": name for name in values["inputs"]}
        values["state"]["score"] = "score"
    # Conditions for being inside the segment: `past0` is true beyond the first edge, and so on. The
    # first segment has no edge before it, and the last segment has none after it.
    inside = []
    if segment is not None and segment > 0:
        inside.append(f"past{segment - 1}")
    if segment is not None and segment < len(segments.edges):
        inside.append(f"~past{segment}")
    title = title or f"Largest of: {'; '.join(term.words for term in terms)}"
    return _fill(PART, **values, title=title, inside=inside)


def write_c(monitor: Monitor, notes: Sequence[str]) -> dict[str, str]:
    """Return the texts of a monitor's C files by file name. `notes`: lines for their comments."""
    values = _template_values(monitor.terms, monitor.segments, monitor.scales)
    # The signal that determines the segment has no unit.
    units = dict.fromkeys(values["inputs"], "")
    for term in monitor.terms:
        units[input_name(term, term.signal)] = term.units[0]
        if term.against:
            units[input_name(term, term.against)] = term.units[0]
    return {
        name: _fill(name, **values, units=units, notes=notes, threshold=monitor.threshold)
        for name in (HEADER, SOURCE, TEST)
    }


def _template_values(
    terms: Sequence[Score], segments: Segments, scales: Sequence[Sequence[float]]
) -> dict[str, Any]:
    """Return the values that the templates of Python and C files need. `state` in the result maps
    the name of each number that is kept until the next millisecond to the name of the input with
    its value.
    """
    term_values = [
        {
            "kind": term.kind,
            "number": input_name(term, term.signal),
            "other": input_name(term, term.against),
            "scales": tuple(float(scale) for scale in term_scales),
            "words": term.words,
        }
        for term, term_scales in zip(terms, scales, strict=True)
    ]
    # A rate compares a number with its value of the millisecond before.
    rate_inputs = [input_name(term, term.signal) for term in terms if term.kind == "rate"]
    return {
        "terms": term_values,
        "segments": segments,
        "inputs": input_expressions(terms, segments),
        "state": {f"before_{name}": name for name in rate_inputs},
    }


def _fill(name: str, **values: object) -> str:
    templates = wording.text_templates("ravenjax.analyses.monitors")
    templates.filters["c"] = _write_float
    return templates.get_template(f"{name}.j2").render(values)


def _write_float(value: float) -> str:
    """Return a float32 as a C literal."""
    # Nine digits determine the bits. C needs a point or an exponent before the suffix f.
    digits = f"{value:.9g}"
    return f"{digits}f" if "." in digits or "e" in digits else f"{digits}.0f"
