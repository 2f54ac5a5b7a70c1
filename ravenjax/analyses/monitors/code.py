"""Generates a monitor's source code: Python for campaigns, and C99 for the software of a robot.

Both files compute the same bits. They read every number as a float, and NaN as 0. Reading NaN as 0
also prevents an engine from fusing the read with the next subtraction. The C code does the same
operations in the same order as the Python file, and rounds each result to float. It only subtracts,
divides and compares, so a compiler cannot fuse a product with a sum. Therefore every compiler with
IEEE arithmetic gives the same bits. With -ffast-math the bits may differ.
"""

from collections.abc import Sequence
from typing import Any

from ravenjax.analyses.monitors.monitor import WHOLE, Monitor, Segments, list_reads, name_read
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
    records: bool = False,
) -> str:
    """Return a Python file that computes the largest score of the terms, each divided by its scale.

    `terms`: scores with one channel each. `scales`: scale of each term in each segment; None: the
    scales in the terms. `segment`: the only segment in which the score is not 0. `records`: the
    file also stores its inputs as `read_NAME`, and its score.
    """
    scales = [term.scales * segments.count for term in terms] if scales is None else scales
    values = _values(terms, segments, scales)
    if records:
        values["state"] |= {f"read_{name}": name for name in values["reads"]} | {"score": "score"}
    # Conditions for being inside the segment: `past0` is true beyond the first edge, and so on.
    inside = []
    if segment is not None:
        inside += [f"past{segment - 1}"] if segment else []
        inside += [f"~past{segment}"] if segment < len(segments.edges) else []
    title = title or f"Largest of: {'; '.join(term.words for term in terms)}"
    return _fill(PART, **values, title=title, inside=inside)


def write_c(monitor: Monitor, notes: Sequence[str]) -> dict[str, str]:
    """Return the texts of the C files by name. `notes`: lines for the files' comments."""
    values = _values(monitor.terms, monitor.segments, monitor.scales)
    units = dict.fromkeys(values["reads"], "")
    for term in monitor.terms:
        for field in filter(None, (term.signal, term.against)):
            units[name_read(term, field)] = term.units[0]
    return {
        name: _fill(name, **values, units=units, notes=notes, threshold=monitor.threshold)
        for name in (HEADER, SOURCE, TEST)
    }


def _values(
    terms: Sequence[Score], segments: Segments, scales: Sequence[Sequence[float]]
) -> dict[str, Any]:
    # Returns the values that the templates of Python and C files need.
    rates = [name_read(term, term.signal) for term in terms if term.kind == "rate"]
    return {
        "terms": [
            {
                "kind": term.kind,
                "number": name_read(term, term.signal),
                "other": name_read(term, term.against),
                "scales": tuple(float(scale) for scale in each),
                "words": term.words,
            }
            for term, each in zip(terms, scales, strict=True)
        ],
        "segments": segments,
        "reads": list_reads(terms, segments),
        "state": {f"before_{name}": name for name in rates},
    }


def _fill(name: str, **values: object) -> str:
    templates = wording.text_templates("ravenjax.analyses.monitors")
    templates.filters["c"] = _write_float
    return templates.get_template(f"{name}.j2").render(values)


def _write_float(value: float) -> str:
    """Return a float32 as a C literal. Nine digits are enough for the same bits."""
    digits = f"{value:.9g}"
    return f"{digits if any(mark in digits for mark in '.e') else f'{digits}.0'}f"
