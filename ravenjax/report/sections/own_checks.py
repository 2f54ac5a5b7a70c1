"""Section "Your checks": what each user-defined check detected, how early, and its false alarms.

A check detected a fault if it tripped more often than in the golden run, or sooner. In fault-free
motion, its trips are false alarms.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data.runs import DISTINCT_FAULTS, Runs, after_onset
from ravenjax.report.sections import detectors, tables
from ravenjax.report.sections.detectors import DetectorThreshold, ThresholdAlarms
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.vocabulary.checks import OWN


class OwnCheckRow(NamedTuple):
    """One user-defined check."""

    name: str
    at: str
    does: str
    threshold: str  # in words
    tripped: Rate  # of all faults: those in which it tripped
    alone: Rate  # of these: those that nothing else had reported by then
    alarms: DetectorThreshold  # the same numbers as a detector at one threshold has


def own_check_rows(runs: Runs) -> list[OwnCheckRow]:
    """Return one row per check, in the order of the campaign's file."""
    checks, per_check = runs.manifest.shape.own_checks, list(_false_alarms(runs))
    trips = [f"({after_onset(alarms.column)}) >= 0" for alarms in per_check]
    # SQL for faults that only this check detected: it trips, no built-in check reports the fault,
    # and no other user-defined check trips, at any time of the run.
    silent = [f"own{number}_ms < 0" for number in range(len(checks))]
    alone = [
        " AND ".join([trip, "built_in_told_ms < 0", *silent[:number], *silent[number + 1 :]])
        for number, trip in enumerate(trips)
    ]
    total, *counts = runs.counts(["true", *trips, *alone], where=DISTINCT_FAULTS)
    tripped, tripped_alone = counts[: len(checks)], counts[len(checks) :]
    sections = {f"{OWN}{check['name']}": check for check in runs.manifest.config.get("check", ())}
    result = []
    for number, alarms in enumerate(detectors.threshold_rows(runs, per_check)):
        section = sections.get(checks[number].name, {})
        row = OwnCheckRow(
            name=alarms.detector,
            at=str(section.get("at", "")),
            does=checks[number].does,
            threshold=_describe_threshold(runs, section, alarms.detector),
            tripped=tables.fault_share(runs, tripped[number], total),
            alone=tables.fault_share(runs, tripped_alone[number], tripped[number]),
            alarms=alarms,
        )
        result.append(row)
    return result


def _describe_threshold(runs: Runs, section: dict[str, Any], check: str) -> str:
    # Describes the threshold of a check in words. A campaign may vary the threshold. Rates are then
    # over all thresholds together.
    name, value = f"param:checks.threshold.{check}", float(section.get("threshold", 1.0))
    lowest, highest = value, value
    if name in runs.names:
        lowest, highest = runs.table.row(
            f'SELECT min("{name}"), max("{name}") FROM {runs.matching(DISTINCT_FAULTS)}'
        )
    words = f"above {lowest:g}" + (f" to {highest:g}, together" if highest != lowest else "")
    in_a_row = section.get("consecutive", 1)
    return f"{words}, {in_a_row} ms in a row" if in_a_row > 1 else words


def _false_alarms(runs: Runs) -> Iterator[ThresholdAlarms]:
    # Yields the false alarms of each user-defined check. They are unknown if the campaign varies
    # parameters of checks, because fault-free motions have only one value of each parameter.
    motions, shape = runs.motions, runs.manifest.shape
    varied = [quote_name(name) for name in runs.names if name.startswith("param:checks.")]
    # A parameter with one value has this value in fault-free motions, too.
    values = ", ".join(["count(*)", *(f"count(DISTINCT {name})" for name in varied)])
    differs = max(runs.table.row(f"SELECT {values} FROM {RESULTS}")[1:], default=0) > 1
    for number, check in enumerate(shape.own_checks):
        rate = count = None
        if not differs:
            first_ms = f'"golden_check_{check.name}_first_ms"'
            event = f"{first_ms} >= 0"
            rate, count = motions.first_rate(event, first_ms), motions.count_motions(event)
        name, column = check.name.removeprefix(OWN), f"own{number}_ms"
        yield ThresholdAlarms(name, math.nan, column, count, rate, quiet=count == 0)


def _content(runs: Runs, _: Path):
    if not runs.manifest.shape.own_checks or not runs.count(DISTINCT_FAULTS):
        return None
    return {"own_checks": own_check_rows(runs)}


SECTIONS = {"own_checks": _content}
