"""Checks of one's own: what each saw, how early, what it cost without a fault, and what only it
knew of.

Rates are of one run of each fault, times over faults with an unintended motion, as of detectors. A
check trips where it does so more often than in the golden run, or sooner; what it does in
fault-free motion is its false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from ravenjax.report.data.runs import Runs, after_onset
from ravenjax.report.sections import tables
from ravenjax.report.sections.detection import performance
from ravenjax.report.sections.detection.performance import DetectorThreshold, ThresholdAlarms
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.checks import OWN, Check


class OwnCheckRow(NamedTuple):
    """One check of one's own."""

    name: str
    at: str
    does: str
    threshold: str  # in words
    tripped: Rate  # of all faults, those in which it tripped
    alone: Rate  # of those, the ones of which nothing else had told anyone by then
    alarms: DetectorThreshold  # the same numbers as a detector at one threshold has


def rows(runs: Runs, manifest: Manifest) -> list[OwnCheckRow]:
    """One row a check, in the order of the campaign's file."""
    checks = manifest.shape.own_checks
    per_check = list(_alarms(runs, manifest))
    trips = [f"({after_onset(one.column)}) >= 0" for one in per_check]
    alone = [_alone(number, manifest) for number in range(len(checks))]
    total, *counts = runs.counts(
        ["true", *trips, *(f"{a} AND {b}" for a, b in zip(trips, alone, strict=True))],
        where="sample AND faulty",
    )
    at_thresholds = performance.thresholds(runs, manifest, per_check)
    sections = {f"{OWN}{one['name']}": one for one in manifest.config.get("check", ())}
    result = []
    for number, (check, alarms) in enumerate(zip(checks, at_thresholds, strict=True)):
        tripped, only = counts[number], counts[len(checks) + number]
        section = sections.get(check.name, {})
        result.append(
            OwnCheckRow(
                _plain(check),
                str(section.get("at", "")),
                check.does,
                _threshold(section, *_varied(runs, check)),
                tables.of_faults(runs, tripped, total),
                tables.of_faults(runs, only, tripped),
                alarms,
            )
        )
    return result


def _plain(check: Check) -> str:
    return check.name.removeprefix(OWN)


def _varied(runs: Runs, check: Check) -> tuple[float | None, float | None]:
    """Least and largest threshold among the runs that rates are of; None where it is the same in
    the whole campaign.
    """
    name = f"param:checks.threshold.{_plain(check)}"
    if name not in runs.names:
        return None, None
    least, most = runs.table.row(
        f'SELECT min("{name}"), max("{name}") FROM {runs.those("sample AND faulty")}'
    )
    return least, most


def _threshold(section: dict[str, Any], least: float | None, most: float | None) -> str:
    value = least if least is not None else float(section.get("threshold", 1.0))
    words = (
        f"above {value:g}"
        if most is None or most == value
        else f"above {value:g} to {most:g}, together"
    )
    in_a_row = section.get("consecutive", 1)
    return f"{words}, {in_a_row} ms in a row" if in_a_row > 1 else words


def _alarms(runs: Runs, manifest: Manifest) -> Iterator[ThresholdAlarms]:
    free = runs.motions()
    for number, check in enumerate(manifest.shape.own_checks):
        rate = count = None
        same = not any(
            _differs(runs, name) for name in runs.names if name.startswith("param:checks.")
        )
        if same:
            first_ms = f'"golden_check_{check.name}_first_ms"'
            event = f"{first_ms} >= 0"
            rate, count = free.first_rate(event, first_ms), free.with_event(event)
        yield ThresholdAlarms(_plain(check), math.nan, f"own{number}_ms", count, rate, count == 0)


def _differs(runs: Runs, name: str) -> bool:
    """Whether a parameter has several values; what the whole campaign has, its fault-free motion
    has, too.
    """
    (values,) = runs.table.row(f'SELECT count(DISTINCT "{name}") FROM {RESULTS}')
    return values > 1


def _alone(number: int, manifest: Manifest) -> str:
    """Condition of facts: no built-in check had told anyone by itself, and no other check of
    one's own tripped.
    """
    others = [f"own{k}_ms < 0" for k in range(len(manifest.shape.own_checks)) if k != number]
    return " AND ".join(["built_in_told_ms < 0", *others])
