"""Counts unsafe control actions, the table of a system-theoretic process analysis (STPA).

`KINDS` defines the mapping: its first matching line decides. A control action is what passes a site
of the robot's loop: the operator's packets at the console and network, set points in the process
model, motor commands at the DAC.
"""

from collections import Counter
from typing import Any, NamedTuple

from evidence.sources import EXAMPLE_RUNS, Source, interval_in_words
from ravenjax.report.data.facts import FACTS
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS, quote_text
from ravenjax.vocabulary.effects import NETWORK_EFFECTS


class Kind(NamedTuple):
    """One kind of unsafe control action, and the runs that are mapped to it."""

    name: str
    meaning: str  # the mapping in words
    sql: str  # over facts `f` and results `r`


_LATE = ", ".join(quote_text(NETWORK_EFFECTS[name].channel) for name in ("duplicate", "delay"))
KINDS = (
    Kind("none", "no hazard", "f.hazard = 'none'"),
    Kind(
        "feedback wrong",
        "a false report: no control action is unsafe in itself, but who acts on the report may make"
        " one unsafe",
        "f.hazard = 'false report'",
    ),
    Kind(
        "too early, too late or out of order",
        "packets delayed or sent twice (effects delay, duplicate), and a hazard of motion",
        f"f.site = 'network' AND r.fault0_channel IN ({_LATE})",
    ),
    Kind(
        "stopped too soon",
        "a loss of motion for no other reason than that the robot left live motion while the"
        " operator wanted it",
        "f.halted",
    ),
    Kind(
        "not provided",
        "any other loss of motion: the instrument did not follow the operator",
        "f.loss",
    ),
    Kind(
        "applied too long",
        "an unintended motion by a number that was held (effects stuck, latch_offset)",
        "f.unintended AND r.fault0_effect IN ('stuck', 'latch_offset')",
    ),
    Kind("provided wrongly", "any other unintended motion", "f.unintended"),
)
"""Kinds in the order in which they are tried."""


class ControlAction(NamedTuple):
    """One line: the distinct faults at one site that made its control action unsafe in one way."""

    result: str
    campaign: str
    control_action: str
    site: str
    layer: str
    kind: str
    mapping: str
    hazard: str
    rate: Rate  # of the distinct faults at this site
    interval: str
    evaded: int  # of these: faults with an unintended motion that no check reported
    # Of these: faults that a check reported to a person, or for which it stopped the robot.
    alarms: int
    groups: str
    example_runs: str


def count_control_actions(source: Source) -> list[ControlAction]:
    """Return the lines of one result, by site, most frequent kind first; none without faults."""
    runs = source.runs
    if "fault0_site" not in runs.names:
        return []
    cases = " ".join(f"WHEN {kind.sql} THEN {quote_text(kind.name)}" for kind in KINDS)
    counted = runs.table.rows(
        f"SELECT f.site::VARCHAR, f.layer::VARCHAR, CASE {cases} ELSE 'none' END AS kind,"
        " f.hazard::VARCHAR, count(*), "
        "count(*) FILTER (f.evaded), count(*) FILTER (f.told), "
        f"""list_sort(list(DISTINCT f."group"::VARCHAR)), {EXAMPLE_RUNS} """
        f"FROM {RESULTS} r JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty GROUP BY ALL"
        " ORDER BY ALL"
    )
    totals = Counter[str]()
    for site, _, _, _, k, *_ in counted:
        totals[site] += k
    groups = runs.groups_by("site")
    actions = [
        _row(source, line, totals[line[0]], groups[line[0]])
        for line in counted
        if line[2] != KINDS[0].name
    ]
    return sorted(actions, key=lambda row: (row.site, -row.rate.k, row.kind))


def _row(source: Source, line: tuple[Any, ...], n: int, groups: set[str]) -> ControlAction:
    site, layer, name, hazard, k, evaded, alarms, own, examples = line
    (kind,) = (kind for kind in KINDS if kind.name == name)
    rate = tables.of_faults(source.runs, k, n, groups)
    return ControlAction(
        source.name,
        source.record.campaign,
        f"what passes {site} ({layer})",
        site,
        layer,
        kind.name,
        kind.meaning,
        hazard,
        rate,
        interval_in_words(rate),
        evaded,
        alarms,
        "; ".join(own),
        examples,
    )
