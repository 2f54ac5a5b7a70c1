"""What a result says in a sentence; the numbers and the words of the report's first page."""

from __future__ import annotations

from ravenjax.evidence.sources import Source
from ravenjax.report import wording
from ravenjax.report.sections import tables


def evading(source: Source) -> str:
    """How many of the faults evade the checks, as the report's first sentence says it."""
    head = tables.headline(source.runs, source.record)
    evaded = head["evaded"]
    if not evaded.n:
        return "No fault has a valid outcome." if head["faulty"] else "No run has a fault."
    interval = wording.interval(evaded)
    bounds = (
        f" ({wording.percent(evaded.value)} of faults drawn so, 95 % interval {interval})"
        if interval
        else ""
    )
    some = wording.count(evaded.k) if evaded.k else "none"
    return (
        f"Of {wording.many(evaded.n, 'distinct fault')} of this design, {some} made the live robot"
        f" move more than {source.record.limit_mm:g} mm off its course without any check telling"
        f" anyone{bounds}."
    )


def complete(source: Source) -> str:
    """How many of the runs are there, and how many have no valid outcome."""
    record, runs = source.record, source.runs
    failed = runs.count("failed")
    without = (
        f"{wording.count(failed)} of them without a valid outcome"
        if failed
        else "each with a valid outcome"
    )
    return (
        f"{wording.count(record.done)} of the {wording.many(record.due, 'declared run')} are there,"
        f" {without}."
    )


def by_hazard(source: Source) -> dict[str, str]:
    """Hazard -> how many distinct faults ended in it, and of how many a check told; only those
    that occur.
    """
    result = {}
    rows = tables.verdict_matrix(source.runs)
    for hazard in dict.fromkeys(cell["hazard"] for cell in rows[0]["cells"]):
        counts = {
            row["name"]: sum(c["rate"].k for c in row["cells"] if c["hazard"] == hazard)
            for row in rows
        }
        k, n = sum(counts.values()), rows[0]["total"].n
        if hazard != "none" and k:
            alarms = counts["stopped"] + counts["flagged"]
            result[hazard] = (
                f"{hazard.capitalize()}: {wording.count(k)} of {wording.many(n, 'distinct fault')};"
                f" a check told a person or stopped the robot in {wording.count(alarms)}, nobody"
                f" was told in {wording.count(k - alarms)}."
            )
    return result
