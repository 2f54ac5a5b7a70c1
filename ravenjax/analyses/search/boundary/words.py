"""A boundary in words: sentences and tables of what `bisection.find` found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from ravenjax.analyses.search.boundary.brackets import ALWAYS, CROSSING, INVALID, NEVER
from ravenjax.analyses.search.findings import TextTable, number, short, words

FOLDER = "verified"
"""Of the campaign of both sides of every bracket, inside the search's folder."""


def series(
    records: list[dict[str, Any]], along: str
) -> dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]]:
    """The records of each combination of what is not `along`."""
    groups: dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]] = {}
    for record in records:
        others = tuple((key, value) for key, value in record["cell"].items() if key != along)
        groups.setdefault(others, []).append(record)
    return groups


def sentences(numbers: dict[str, Any]) -> Iterator[str]:
    """The answer in short."""
    cells, searched = numbers["cells"], numbers["searched"]
    count = Counter(record["state"] for record in cells)
    unit = f" {searched['unit']}" if searched["unit"] else ""
    yield (
        f"Harm is `{numbers['harm']}`; searched is {short(searched['name'])} from"
        f" {searched['low']:g} to {searched['high']:g}{unit}, {searched['scale']},"
        f" {numbers['scan']} values of each cell and then bisection to {_tolerance(searched)}."
    )
    yield (
        f"Of {len(cells)} cells {count[CROSSING]} have a boundary, {count[NEVER]} are harmless"
        f" throughout, {count[ALWAYS]} harmful from the low end on"
        + (f", {count[INVALID]} hold runs without a valid outcome" if count[INVALID] else "")
        + "."
    )
    crossed = [record for record in cells if record["state"] == CROSSING]
    if crossed:
        least = min(crossed, key=lambda record: abs(record["harmful"]))
        where = f" ({words(least['cell'])})" if least["cell"] else ""
        yield f"The smallest boundary: {number(least['harmful'])}{unit}{where}."
        yield (
            f"Both sides of every boundary, {numbers['verified']['runs']} runs, were run again as"
            f" an ordinary campaign (folder `{FOLDER}`), which gives the same: no harm at the lower"
            " side, harm at the upper."
        )
    if odd := [record for record in cells if not record["monotone"]]:
        yield (
            f"In {len(odd)} cells harm does not grow with the fault: it comes and goes along the"
            " scan. There the boundary is the first crossing that the scan sees, and larger faults"
            " may be harmless (last table)."
        )


def tables(numbers: dict[str, Any]) -> Iterator[TextTable]:
    """The values of `along` side by side, then every cell, then those that are not monotone."""
    cells, unit, along = numbers["cells"], numbers["searched"]["unit"], numbers["along"]
    names = list(cells[0]["cell"])
    if along is not None:
        yield from _across(numbers, along)
    rows = []
    for record in cells:
        case = tuple(str(record["cell"][name]) for name in names)
        sides = (number(record["harmless"]), number(record["harmful"]))
        before, after = (
            record.get(f"{side}_peak_golden_deviation_mm", math.nan)
            for side in ("harmless", "harmful")
        )
        rows.append(
            (
                *case,
                *sides,
                _state(record),
                f"{number(before, 3)} to {number(after, 3)}" if before == before else "",
                str(record.get("harmful_response", "")),
                "" if record["monotone"] else "no",
            )
        )
    of = f", {unit}" if unit else ""
    yield TextTable(
        "Every cell",
        (
            *map(short, names),
            f"harmless{of}",
            f"harmful{of}",
            "",
            "tip off its golden run, mm",
            "response",
            "monotone",
        ),
        tuple(rows),
        "The boundary lies between the two values, which is the tolerance; n = 1 run a value,"
        " nothing is random but what the file says. Tip and response: of the runs at both sides,"
        " and at the harmful one.",
    )
    if odd := [record for record in cells if not record["monotone"]]:
        yield TextTable(
            "Cells in which harm comes and goes",
            (*map(short, names), "harm changes between"),
            tuple(
                (
                    *(str(r["cell"][n]) for n in names),
                    "; ".join(f"{number(a)} and {number(b)}" for a, b in r["changes"]),
                )
                for r in odd
            ),
        )


def _across(numbers: dict[str, Any], along: str) -> Iterator[TextTable]:
    """The smallest harmful value and the slope of its line, the values of `along` side by side."""
    unit = f", {numbers['searched']['unit']}" if numbers["searched"]["unit"] else ""
    lines = series(numbers["cells"], along)
    values = sorted({record["cell"][along] for record in numbers["cells"]})
    names = tuple(short(name) for name, _ in next(iter(lines)))
    rows = []
    for others, line in lines.items():
        cells = {record["cell"][along]: _harmful(record) for record in line}
        rows.append(
            (*(str(value) for _, value in others), *(cells.get(value, "") for value in values))
        )
    yield TextTable(
        f"Smallest harmful {short(numbers['searched']['name'])}{unit}, by {short(along)}",
        (*names, *(f"{value:g}" for value in values)),
        tuple(rows),
        f"To {_tolerance(numbers['searched'])}. > and <=: no boundary within the range, harmless up"
        " to its end or harmful from its beginning. †: not monotone.",
    )
    if not numbers["exponents"]:
        return
    steps = sorted({(one["from_ms"], one["to_ms"]) for one in numbers["exponents"]})
    slopes = {
        (tuple(one["cell"].items()), one["from_ms"], one["to_ms"]): one["exponent"]
        for one in numbers["exponents"]
    }
    rows = [
        (
            *(str(value) for _, value in others),
            *(number(slopes.get((others, *step), math.nan), 3) for step in steps),
        )
        for others in lines
    ]
    yield TextTable(
        "Slope d log(boundary) / d log(duration)",
        (*names, *(f"{begin:g} to {end:g} ms" for begin, end in steps)),
        tuple(rows),
        "-1: value x duration decides, an impulse; steeper: the fault has time to add up; 0:"
        " duration does not matter.",
    )


def _tolerance(searched: dict[str, Any]) -> str:
    return f"{searched['tolerance']:g} of the {'value' if searched['scale'] == 'log' else 'range'}"


def _harmful(record: dict[str, Any]) -> str:
    mark = "" if record["monotone"] else " †"
    text = {
        CROSSING: number(record["harmful"]),
        NEVER: f"> {number(abs(record['harmless']))}",
        ALWAYS: f"<= {number(abs(record['harmful']))}",
        INVALID: "failed",
    }[record["state"]]
    return text + mark


def _state(record: dict[str, Any]) -> str:
    return {
        CROSSING: "",
        NEVER: f"harmless up to {number(record['harmless'])}",
        ALWAYS: f"harmful already at {number(record['harmful'])}",
        INVALID: "a run failed",
    }[record["state"]]
