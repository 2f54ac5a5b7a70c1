"""Counts unsafe control actions, the table of a system-theoretic process analysis (STPA).

`KINDS` defines the kind of unsafe control action of a run: the first matching entry applies. A
control action is a signal at a fault site: the operator's packets at the console and network, set
points in the process model, motor commands at the DAC.
"""

from typing import NamedTuple

import pandas as pd

from evidence.sources import EXAMPLE_RUNS, Source, interval_in_words
from ravenjax.report.data.facts import FACTS
from ravenjax.report.sections import tables
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


def count_control_actions(source: Source) -> pd.DataFrame:
    """Return the lines of one result, by site, most frequent kind first; none without faults.

    A line has the distinct faults at one site that made its control action unsafe in one way.
    `evaded` and `alarms` count those with an unintended motion that no check reported, and those
    that a check reported to a person or for which it stopped the robot.
    """
    runs = source.runs
    if "fault0_site" not in runs.names:
        return pd.DataFrame()
    cases = " ".join(f"WHEN {kind.sql} THEN {quote_text(kind.name)}" for kind in KINDS)
    actions = runs.table.frame(
        f"SELECT f.site::VARCHAR AS site, f.layer::VARCHAR AS layer,"
        f" CASE {cases} ELSE 'none' END AS kind, f.hazard::VARCHAR AS hazard, count(*) AS k,"
        " count(*) FILTER (f.evaded) AS evaded, count(*) FILTER (f.told) AS alarms,"
        """ array_to_string(list_sort(list(DISTINCT f."group"::VARCHAR)), '; ') AS groups,"""
        f" {EXAMPLE_RUNS} AS example_runs"
        f" FROM {RESULTS} r JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty"
        " GROUP BY ALL ORDER BY ALL"
    )
    groups, meanings = runs.groups_by("site"), {kind.name: kind.meaning for kind in KINDS}
    totals = actions.groupby("site")["k"].transform("sum")
    rates = [
        tables.fault_share(runs, k, n, groups[site])
        for k, n, site in zip(actions["k"], totals, actions["site"], strict=True)
    ]
    actions = actions.assign(
        result=source.name,
        campaign=source.record.campaign,
        control_action="what passes " + actions["site"] + " (" + actions["layer"] + ")",
        mapping=[meanings[kind] for kind in actions["kind"]],
        rate=rates,
        interval=[interval_in_words(rate) for rate in rates],
    )
    unsafe = actions.query("kind != @KINDS[0].name")
    ordered = unsafe.sort_values(by=["site", "k", "kind"], ascending=[True, False, True])
    return ordered.filter(
        [
            *("result", "campaign", "control_action", "site", "layer", "kind", "mapping"),
            *("hazard", "rate", "interval", "evaded", "alarms", "groups", "example_runs"),
        ]
    )
