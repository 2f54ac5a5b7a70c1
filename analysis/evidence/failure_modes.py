"""Counts failure modes, the table of a failure mode and effects analysis.

A line is one way in which the distinct faults of a group, site and effect ended. Its rate is over
all of these, so the lines of one group, site and effect add up to one. Faults are counted as in the
report: the first valid run of each in which nobody reacts, by the first fault of a run.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from evidence.sources import EXAMPLE_RUNS, Source, interval_in_words
from ravenjax.hazards import naming
from ravenjax.report.data.facts import FACTS
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS
from ravenjax.vocabulary.effects import EFFECTS

NOBODY = "nobody"
_AFTER = "median({0} - f.active_ms) FILTER (f.active_ms >= 0 AND {0} >= f.active_ms)"
"""SQL: median delay of an event after the fault's first effect, over the runs in which it came."""


class FailureMode(NamedTuple):
    """One line. Delays are medians after the fault's first effect, ms, over the runs in which the
    event came.
    """

    result: str
    campaign: str
    group: str
    library_hazards: str  # ids, from the group's name
    library_titles: str
    site: str
    effect: str
    local_effect: str  # layer, and what the effect does to the number there
    response: str
    hazard: str  # the end effect
    detected_by: str
    evades: bool
    rate: Rate  # over the distinct faults of this group, site and effect
    interval: str
    told_after_ms: float  # NaN: never
    cue_after_ms: float
    hazard_after_ms: float
    failed_runs_of_group: int  # without a valid outcome, counted in no rate
    example_runs: str


def count_failure_modes(source: Source) -> list[FailureMode]:
    """Return the lines of one result, by group, site and effect, most frequent end first; none
    without faults.
    """
    runs = source.runs
    if "fault0_site" not in runs.names:
        return []
    hazard_ms = "greatest(f.unintended_ms, f.loss_ms, f.misreport_ms)"
    counted = runs.table.rows(
        'SELECT f."group"::VARCHAR, f.site::VARCHAR, r.fault0_effect::VARCHAR, f.layer::VARCHAR,'
        " f.response::VARCHAR, "
        "f.hazard::VARCHAR, CASE WHEN f.response = 'silent' THEN '' ELSE r.response_cause::VARCHAR"
        " END AS cause, "
        "f.cued, f.evaded, count(*) AS k, "
        f"{', '.join(_AFTER.format(event) for event in ('f.told_ms', 'f.warned_ms', hazard_ms))},"
        f" {EXAMPLE_RUNS} "
        f"FROM {RESULTS} r JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty GROUP BY ALL"
        " ORDER BY ALL"
    )
    failed = {row["name"]: row["failed"] for row in tables.group_rows(runs)}
    totals: dict[tuple[str, ...], int] = {}
    for group, site, effect, *_, k, _, _, _, _ in counted:
        totals[group, site, effect] = totals.get((group, site, effect), 0) + k
    modes = [_row(source, line, totals[line[:3]], failed[line[0]]) for line in counted]
    return sorted(modes, key=lambda row: (row.group, row.site, row.effect, -row.rate.k))


def _row(source: Source, line: tuple[Any, ...], n: int, failed: int) -> FailureMode:
    group, site, effect, layer, response, hazard, cause, cued, evaded, k, *after, examples = line
    told_ms, cue_ms, hazard_ms = (
        float("nan") if value is None else float(value) for value in after
    )
    rate = tables.of_faults(source.runs, k, n, [group])
    return FailureMode(
        source.name,
        source.record.campaign,
        group,
        " ".join(naming.hazards_of(group)),
        naming.titles_of(group),
        site,
        effect,
        f"{layer}: {EFFECTS[effect].meaning}" if effect in EFFECTS else layer,
        response,
        hazard,
        ", ".join(_detection(response, cause, cued)) or NOBODY,
        evaded,
        rate,
        interval_in_words(rate),
        told_ms,
        cue_ms,
        hazard_ms,
        failed,
        examples,
    )


def _detection(response: str, cause: str, cued: bool) -> Iterator[str]:
    """Say who noticed the fault: a check that stopped the robot or informed a person, a check that
    only limited, or the haptic cue.
    """
    if response != "silent":
        did = {"limited": " (limited, no alarm)", "stopped": " (stopped the robot)"}.get(
            response, " (raised an alarm)"
        )
        yield f"check {cause or 'not recorded'}{did}"
    if cued:
        yield "haptic cue"
