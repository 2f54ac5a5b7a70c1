"""Counts failure modes, the table of a failure mode and effects analysis.

A row is one outcome of the distinct faults of a group, site and effect. Its rate is over all these
faults, so the rows of one group, site and effect add up to one. Faults are counted as in the
report: the first valid run of each fault without a reaction. If a run has several faults, the first
fault counts.
"""

import pandas as pd

from evidence.sources import EXAMPLE_RUNS, Source, interval_in_words
from ravenjax.hazards import naming
from ravenjax.report.data.facts import FACTS
from ravenjax.report.sections import tables
from ravenjax.store.access.query import RESULTS
from ravenjax.vocabulary.effects import EFFECTS

_AFTER = "median({0} - f.active_ms) FILTER (f.active_ms >= 0 AND {0} >= f.active_ms)"
"""SQL: median delay of an event after the fault's first effect, over the runs in which it came."""


def count_failure_modes(source: Source) -> pd.DataFrame:
    """Return the lines of one result, by group, site and effect, most frequent end first; none
    without faults.

    Delays (`_after_ms`) are medians after the fault's first effect, over the runs in which the
    event came; NaN: never. `failed_runs_of_group` are counted in no rate.
    """
    runs = source.runs
    if "fault0_site" not in runs.names:
        return pd.DataFrame()
    hazard_ms = "greatest(f.unintended_ms, f.loss_ms, f.misreport_ms)"
    modes = runs.table.frame(
        'SELECT f."group"::VARCHAR AS "group", f.site::VARCHAR AS site,'
        " r.fault0_effect::VARCHAR AS effect, f.layer::VARCHAR AS layer,"
        " f.response::VARCHAR AS response, f.hazard::VARCHAR AS hazard,"
        " CASE WHEN f.response = 'silent' THEN '' ELSE r.response_cause::VARCHAR END AS cause,"
        " f.cued, f.evaded AS evades, count(*) AS k,"
        f" {_AFTER.format('f.told_ms')} AS told_after_ms,"
        f" {_AFTER.format('f.warned_ms')} AS cue_after_ms,"
        f" {_AFTER.format(hazard_ms)} AS hazard_after_ms, {EXAMPLE_RUNS} AS example_runs"
        f" FROM {RESULTS} r JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty"
        " GROUP BY ALL ORDER BY ALL"
    )
    totals = modes.groupby(["group", "site", "effect"])["k"].transform("sum")
    rates = [
        tables.fault_share(runs, k, n, [group])
        for k, n, group in zip(modes["k"], totals, modes["group"], strict=True)
    ]
    failed = {row["name"]: row["failed"] for row in tables.group_rows(runs)}
    modes = modes.assign(
        result=source.name,
        campaign=source.record.campaign,
        library_hazards=[" ".join(naming.hazards_of(group)) for group in modes["group"]],
        library_titles=modes["group"].map(naming.titles_of),
        local_effect=[
            f"{layer}: {EFFECTS[effect].meaning}" if effect in EFFECTS else layer
            for layer, effect in zip(modes["layer"], modes["effect"], strict=True)
        ],
        detected_by=[
            _name_detectors(*row)
            for row in zip(modes["response"], modes["cause"], modes["cued"], strict=True)
        ],
        rate=rates,
        interval=[interval_in_words(rate) for rate in rates],
        failed_runs_of_group=[failed[group] for group in modes["group"]],
    )
    order = ["group", "site", "effect", "k"]
    ordered = modes.sort_values(order, ascending=[True, True, True, False])
    return ordered.filter(
        [
            *("result", "campaign", "group", "library_hazards", "library_titles", "site"),
            *("effect", "local_effect", "response", "hazard", "detected_by", "evades", "rate"),
            *("interval", "told_after_ms", "cue_after_ms", "hazard_after_ms"),
            *("failed_runs_of_group", "example_runs"),
        ]
    )


def _name_detectors(response: str, cause: str, cued: bool) -> str:
    """Say who noticed the fault: a check that stopped the robot or informed a person, a check that
    only limited, or the haptic cue.
    """
    did = {"limited": "limited, no alarm", "stopped": "stopped the robot"}
    check = f"check {cause or 'not recorded'} ({did.get(response, 'raised an alarm')})"
    names = [check] * (response != "silent") + ["haptic cue"] * cued
    return ", ".join(names) or "nobody"
