"""Writes the tables of a risk file: failure modes, unsafe control actions (signals at fault sites),
and the runs of each hazard with the result file that contains each run. Faults are counted as in
the report. If a run has several faults, the first fault counts.
"""

import bisect
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from evidence.record import EXAMPLE_RUNS, Source, interval_in_words
from ravenjax.hazards import naming
from ravenjax.outcomes import verdict
from ravenjax.report import wording
from ravenjax.report.data.facts import FACTS
from ravenjax.report.sections import tables
from ravenjax.store.access.query import RESULTS, quote_name, quote_text
from ravenjax.store.files import without_formula
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS


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
        "a loss of motion only because the robot was not in pedal-down, or had a software E-stop,"
        " while the operator held the pedal down",
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
"""Kinds of unsafe control actions. The first that matches a run applies."""
COLUMNS = (
    *("result", "campaign", "hazard", "group", "run_id", "index", "fault", "response"),
    *("response_cause", "cue", "evades", "in_rates", "hazard_ms", "told_ms", "part", "part_sha256"),
)
"""Columns of the trace. `in_rates`: neither a repetition nor a run with a reaction."""
BATCH = 20_000
"""Rows that are read together."""
TRACED = tuple(name for name in verdict.HAZARDS if name != "none")
_SAMPLE = f"FROM {RESULTS} r JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty"
_HAZARD_MS = "greatest(f.unintended_ms, f.loss_ms, f.misreport_ms)"
_AFTER = "median({0} - f.active_ms) FILTER (f.active_ms >= 0 AND {0} >= f.active_ms)"
"""SQL: median delay of an event after the fault's first effect, over the runs in which it came."""


def _rates(source: Source, rows: pd.DataFrame, of: list[str], groups: pd.Series) -> dict[str, Any]:
    """Return the columns of both tables. A rate is over rows with equal `of` and of `groups`."""
    totals = rows.groupby(of)["k"].transform("sum")
    rates = [
        tables.fault_share(source.runs, k, n, names)
        for k, n, names in zip(rows["k"], totals, groups, strict=True)
    ]
    return {
        "result": source.name,
        "campaign": source.record.campaign,
        "rate": rates,
        "interval": [interval_in_words(rate) for rate in rates],
    }


def count_failure_modes(source: Source) -> pd.DataFrame:
    """Return the failure modes of one result by group, site and effect, whose rates add up to one.
    Delays (`_after_ms`) are NaN if an event never came. No rate has `failed_runs_of_group`.
    """
    runs = source.runs
    if "fault0_site" not in runs.names:
        return pd.DataFrame()
    modes = runs.table.frame(
        'SELECT f."group"::VARCHAR AS "group", f.site::VARCHAR AS site,'
        " r.fault0_effect::VARCHAR AS effect, f.layer::VARCHAR AS layer,"
        " f.response::VARCHAR AS response, f.hazard::VARCHAR AS hazard,"
        " CASE WHEN f.response = 'silent' THEN '' ELSE r.response_cause::VARCHAR END AS cause,"
        " f.cued, f.evaded AS evades, count(*) AS k,"
        f" {_AFTER.format('f.told_ms')} AS told_after_ms,"
        f" {_AFTER.format('f.warned_ms')} AS cue_after_ms,"
        f" {_AFTER.format(_HAZARD_MS)} AS hazard_after_ms, {EXAMPLE_RUNS} AS example_runs"
        f" {_SAMPLE} GROUP BY ALL ORDER BY ALL"
    )
    rates = _rates(source, modes, ["group", "site", "effect"], modes["group"].map(lambda g: [g]))
    failed = {row["name"]: row["failed"] for row in tables.group_rows(runs)}
    modes = modes.assign(
        library_hazards=[" ".join(naming.hazards_of(group)) for group in modes["group"]],
        library_titles=[naming.titles_of(group, runs.robot) for group in modes["group"]],
        local_effect=[
            f"{layer}: {EFFECTS[effect].meaning}" if effect in EFFECTS else layer
            for layer, effect in zip(modes["layer"], modes["effect"], strict=True)
        ],
        detected_by=[
            _name_detectors(*row)
            for row in zip(modes["response"], modes["cause"], modes["cued"], strict=True)
        ],
        **rates,
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
    """Say who noticed the fault: a check (stop, alarm or limit), or the haptic cue."""
    did = {"limited": "limited, no alarm", "stopped": "stopped the robot"}
    check = f"check {cause or 'not recorded'} ({did.get(response, 'raised an alarm')})"
    names = [check] * (response != "silent") + ["haptic cue"] * cued
    return ", ".join(names) or "nobody"


def count_control_actions(source: Source) -> pd.DataFrame:
    """Return the unsafe control actions of one result by site, and how many of their faults evade
    the checks, or cause an alarm or a stop.
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
        f" {_SAMPLE} GROUP BY ALL ORDER BY ALL"
    )
    groups, meanings = runs.groups_by("site"), {kind.name: kind.meaning for kind in KINDS}
    rates = _rates(source, actions, ["site"], actions["site"].map(groups))
    actions = actions.assign(
        control_action="what passes " + actions["site"] + " (" + actions["layer"] + ")",
        mapping=[meanings[kind] for kind in actions["kind"]],
        **rates,
    )
    unsafe = actions.query("kind != @KINDS[0].name")
    ordered = unsafe.sort_values(by=["site", "k", "kind"], ascending=[True, False, True])
    return ordered.filter(
        [
            *("result", "campaign", "control_action", "site", "layer", "kind", "mapping"),
            *("hazard", "rate", "interval", "evaded", "alarms", "groups", "example_runs"),
        ]
    )


def count_matrix(source: Source) -> pd.DataFrame:
    """Return how many distinct faults of each group ended in each hazard."""
    cube = source.runs.cube
    counted = cube.loc[cube["faulty"] & cube["sample"]].astype({"group": str, "hazard": str})
    by_hazard = counted.pivot_table("runs", "group", "hazard", "sum", 0)
    matrix = by_hazard.reindex(columns=list(verdict.HAZARDS), fill_value=0)
    matrix.columns = [name.replace(" ", "_") for name in matrix]
    matrix.insert(0, "faults", matrix.sum(axis=1))
    evading = counted[counted["evaded"]].groupby("group")["runs"].sum()
    matrix["evade"] = evading.reindex(matrix.index, fill_value=0)
    names = pd.DataFrame({"result": source.name, "campaign": source.record.campaign}, matrix.index)
    return names.join(matrix.reset_index().set_index("group", drop=False))


def write_trace(path: Path, sources: Sequence[Source]) -> None:
    """Write every valid run with a fault and a hazard, by result and hazard, in batches."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for source in sources:
            for hazard in TRACED:
                lines = _lines(source, hazard)
                writer.writerows(map(without_formula, line) for line in lines)


def _lines(source: Source, hazard: str) -> Iterator[list[Any]]:
    runs, record = source.runs, source.record
    slots = [name for name in runs.names if name.startswith("fault")]
    query = (
        'SELECT f.row, r.run_id, f."group"::VARCHAR AS "group", f.response::VARCHAR AS response, '
        "r.response_cause::VARCHAR AS cause, f.cued, f.evaded, f.sample, f.told_ms, "
        f"{_HAZARD_MS} AS hazard_ms, "
        f"{', '.join(f'r.{quote_name(name)}' for name in slots)} FROM {RESULTS} r JOIN {FACTS} f ON"
        " r.row = f.row "
        f"WHERE f.faulty AND NOT f.failed AND f.hazard = '{hazard}' ORDER BY f.row"
    )
    ordered = sorted(record.parts, key=lambda part: part.first)
    starts = [part.first for part in ordered]
    for batch in runs.table.connection.sql(query).to_arrow_reader(BATCH):
        for row in batch.to_pylist():
            part = ordered[bisect.bisect_right(starts, row["row"]) - 1]
            fault = wording.describe_fault(row, record.robot)
            yield [
                *(source.name, record.campaign, hazard, row["group"], row["run_id"], row["row"]),
                *(fault, row["response"], row["cause"]),
                *("yes" if row[name] else "no" for name in ("cued", "evaded", "sample")),
                *(row[name] if row[name] >= 0 else "" for name in ("hazard_ms", "told_ms")),
                *(part.file, part.sha256),
            ]
