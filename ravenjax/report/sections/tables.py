"""Sections with tables of rates: verdicts, groups, built-in checks and failures.

A rate has a confidence interval only if its faults were drawn at random.
"""

import functools
import itertools
import math
import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pandas as pd

from ravenjax import resources
from ravenjax.campaign.stop import decisions
from ravenjax.outcomes import definitions, events, verdict
from ravenjax.report.data.facts import FACTS, OUTCOMES, VALID_OUTCOMES
from ravenjax.report.data.runs import DISTINCT_FAULTS, UNINTENDED, Runs
from ravenjax.stats import latency
from ravenjax.stats.intervals import Estimate, Rate, share_of_cells, wilson_interval
from ravenjax.stats.latency import Delays, Incidence
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import Manifest

CAUSED = ("stopped", "flagged", "limited")

Row = dict[str, Any]
"""Named values, such as the row of a table."""
_Interval = TypeVar("_Interval", Rate, Estimate)


@functools.lru_cache(maxsize=10_000)
def wilson_share(k: int, n: int) -> Rate:
    """Return the share k of n with its Wilson interval, cached because tables repeat counts."""
    return wilson_interval(k, n)


def fault_share(runs: Runs, k: int, n: int, groups: Collection[str] | None = None) -> Rate:
    """Return the share k of n distinct faults, without an interval if they were enumerated."""
    return wilson_share(k, n) if runs.sampled(groups) else share_of_cells(k, n)


def without_interval(value: _Interval) -> _Interval:
    """Return the value without its interval."""
    return value._replace(low=math.nan, high=math.nan)


def class_counts(
    runs: Runs, by: str, columns: Sequence[str], where: str = "true"
) -> list[tuple[Any, ...]]:
    """Return one row for each value of `by`: the value, the groups of its faults, the number of its
    distinct faults, and `columns`.

    The arguments are expressions over columns of results and facts.
    """
    return runs.table.rows(
        f'SELECT {by}, list(DISTINCT {FACTS}."group"::VARCHAR), count(*), {", ".join(columns)} FROM'
        f" {RESULTS} JOIN {FACTS} USING (row) WHERE {DISTINCT_FAULTS} AND {where} GROUP BY ALL"
        " HAVING count(*) > 0 ORDER BY 1"
    )


class Quantiles(NamedTuple):
    """Quantiles over some faults, in one unit."""

    median: float
    most: float  # 95 % of the faults are at or below this
    largest: float


def quantiles_sql(column: str) -> str:
    """Return SQL for the fields of `Quantiles`, over the values of `column`."""
    return f"quantile_cont(({column})::DOUBLE, [0.5, 0.95, 1.0])"


class EventTimes(NamedTuple):
    """When an event came in runs of some faults. Intervals exist only if all faults were drawn."""

    delay: Incidence  # from the fault's first effect
    half_ms: Estimate  # time by which half of the faults had the event
    before: Rate  # faults with the event before the unintended motion
    lead_ms: Estimate  # median time from the event to the unintended motion
    alarmed: int  # faults with the event


def event_times(runs: Runs, event: str, where: str = UNINTENDED) -> EventTimes:
    """Return the times of an event from the fault's first effect and to the unintended motion.

    event: SQL for the time of the event in ms, -1 for never, over columns of facts. where: SQL
    condition of the faults, which have an unintended motion.
    """
    # The delay is the time since the first effect. The lag is the time since the unintended motion,
    # so the lead is the negative lag. The key "" stands for all runs.
    delay, lag = (
        runs.delays(event, start, runs.end, where)[""] for start in ("active_ms", "unintended_ms")
    )
    delays, lags = latency.incidence_curve(delay), latency.incidence_curve(lag)
    half_ms, lead_ms = delays.quantile_interval(0.5), lags.quantile_interval(0.5).negated
    before = latency.rate_before(lag)
    if not runs.sampled():
        half_ms, lead_ms = without_interval(half_ms), without_interval(lead_ms)
        before = without_interval(before)
    return EventTimes(delays, half_ms, before, lead_ms, lags.events)


def headline_counts(runs: Runs, manifest: Manifest) -> Row:
    """Return the counts and rates on the first page, by name.

    They count distinct faults, by the first valid run of each in which nobody reacts. loss and
    misreport are hazards that no check reported. cut_short counts faults without an alarm or hazard
    that lasted longer than their run. halted counts losses of motion only because the
    robot was not live. inactive counts valid runs whose fault changed no bit, and repeats counts
    further valid runs of the same faults. reacting counts runs with an operator who reacts, if
    others have none. faulty and failed count all runs; false_cue counts fault-free motions.
    """
    conditions = resources.read_tables(__file__, "headline.toml") | {
        name: f"outcome = '{name}'" for name in OUTCOMES
    }
    # A fault without an end cannot be cut short.
    window = f"length_ms > 0 AND onset_ms + length_ms::BIGINT > {manifest.duration_ms}"
    window = window if "length_ms" in runs.facts else "false"
    conditions["cut_short"] = f"NOT told AND hazard = 'none' AND {window}"
    counts = runs.counts(list(conditions.values()), where=DISTINCT_FAULTS)
    n = dict(zip(conditions, counts, strict=True))
    total = n["total"]
    valid = "plain AND faulty AND NOT failed AND"
    active, inactive, faulty, failed, reacting = runs.counts(
        [f"{valid} activated", f"{valid} NOT activated", "faulty", "failed", "NOT plain"]
    )
    free = runs.motions
    (lead_ms,) = runs.table.row(
        f"SELECT coalesce(median(told_ms - warned_ms), 'nan') FROM {FACTS} WHERE {DISTINCT_FAULTS}"
        f" AND {conditions['both']}"
    )
    rates = {name: fault_share(runs, count, total) for name, count in n.items()}
    hazards = ("evaded", "unintended", "loss", "misreport")
    cue_ms = f"golden_cue{manifest.verdict_cue}_first_ms"
    return {
        **n,
        **{name: rates[name] for name in hazards},
        "inactive": inactive,
        "repeats": active - total,
        "reacting": reacting,
        "faulty": faulty,
        "failed": failed,
        "outcomes": {name: rates[name] for name in VALID_OUTCOMES},
        "cue_first": fault_share(runs, n["cue_first"], n["both"]),
        "lead_ms": lead_ms,
        "false_cue": wilson_share(free.count_with_event(cue_ms), free.count),
    }


def verdict_matrix(runs: Runs) -> list[Row]:
    """Return rows by RESPONSES. Cells are by hazard and cue, each a rate of all distinct faults."""
    cube = runs.cube
    return _matrix(cube.loc[cube["faulty"] & cube["sample"]], runs.sampled())


def _matrix(cube: pd.DataFrame, sampled: bool) -> list[Row]:
    # Returns the number of faults by response (rows), hazard and cue (cells).
    rate = wilson_share if sampled else share_of_cells
    cube = cube.loc[~cube["failed"]]
    total = _count(cube)
    counts: Any = cube.groupby(["response", "hazard", "cued"])["runs"].sum()
    rows = []
    for response in verdict.RESPONSES:
        cells = [
            {
                "response": response,
                "hazard": hazard,
                "cue": "cue" if cued else "no cue",
                "share": rate(int(counts.get((response, hazard, cued), 0)), total),
                "evades": response in verdict.UNTOLD and hazard == "unintended motion",
            }
            for hazard, cued in itertools.product(verdict.HAZARDS, (True, False))
        ]
        k = sum(cell["share"].k for cell in cells)
        rows.append({"name": response, "cells": cells, "total": rate(k, total)})
    return rows


def jump_rows(runs: Runs) -> list[Row]:
    """Return one row per jump rule: the faults with such a jump, and which hazards they had."""
    outcomes = runs.manifest.config.get("outcomes") or {}
    step, large = outcomes.get("jump_step_mm", 0.1), outcomes.get("large_jump_mm", 1.0)
    rules = {
        "jump_code": f"reported tip: steps over {step:g} mm on two packets in a row",
        "jump_tip": f"true tip: steps over {step:g} mm in two ticks in a row",
        "jump_text": f"true tip: over {large:g} mm within two ticks",
    }
    rows = []
    for name, words in rules.items():
        conditions = ["true", name, f"{name} AND unintended", f"{name} AND misreport"]
        source = f"{RESULTS} JOIN {FACTS} USING (row)"
        n, k, *hazards = runs.counts(conditions, source, DISTINCT_FAULTS)
        hazard = dict(zip(("unintended", "misreport"), hazards, strict=True))
        rows.append({"rule": words, "rate": fault_share(runs, k, n), **hazard})
    return rows


def _count(cube: pd.DataFrame) -> int:
    return int(cube["runs"].to_numpy().sum())


def group_rows(runs: Runs) -> list[Row]:
    """Return one row per group, those with most evading faults first: the rates of outcomes of its
    distinct faults, and their verdict matrix.

    A group without faults has the rates of its runs in which nobody reacts. `runs` and `failed`
    count all runs of the group.
    """
    cube = runs.cube
    rows = []
    for name, part in cube.groupby("group"):
        faulty = bool(part["faulty"].any())
        counted = part.loc[~part["failed"] & (part["sample"] | (part["plain"] & (not faulty)))]
        n, groups = _count(counted), [str(name)]
        shares = {
            key: fault_share(runs, _count(counted.loc[counted["outcome"] == key]), n, groups)
            for key in VALID_OUTCOMES
        }
        rows.append(
            {
                "name": name,
                "runs": _count(part),
                "n": n,
                "faulty": faulty,
                "outcomes": shares,
                "evaded": fault_share(runs, _count(counted.loc[counted["evaded"]]), n, groups),
                "matrix": _matrix(counted, runs.sampled(groups)),
                "failed": _count(part.loc[part["failed"]]),
            }
        )
    return sorted(rows, key=lambda row: (not row["faulty"], *rate_order(row["evaded"])))


def rate_order(rate: Rate) -> tuple[bool, float]:
    """Return a sort key that puts the largest rate first and a rate of zero runs last."""
    return not rate.n, -rate.value if rate.n else 0.0


def event_delays(runs: Runs, event: str) -> tuple[Delays, int]:
    """Return the delay (ms) of an event after the first effect, for a run of each activated fault.

    `event` is a column of facts. If the event never came, the delay is censored at the end of
    observation, a stop or the run's end. Also return the number of runs that are left out because
    the event came before the fault's first effect.
    """
    condition = "sample AND activated AND NOT failed AND faulty"
    early = f"{event} >= 0 AND {event} < active_ms"
    stopped = f"CASE WHEN response = 'stopped' THEN response_ms ELSE {runs.end} END"
    end = f"greatest({stopped}, active_ms)"
    # Without a grouping column, the only key is "".
    by_name = runs.delays(event, "active_ms", end, f"{condition} AND NOT ({early})")
    return by_name[""], runs.count(f"{condition} AND {early}")


def check_rows(runs: Runs) -> list[Row]:
    """Return a row per built-in check: faults in which it tripped, least margin in silent runs."""
    manifest = runs.manifest
    user_defined = {check.name for check in manifest.shape.own_checks}
    names = [name for name in manifest.shape.checks if name not in user_defined]
    columns = [
        f"count(*) FILTER (check_{name}_first_ms >= 0), min(check_{name}_margin) FILTER (response ="
        f" 'silent' AND NOT isnan(check_{name}_margin::DOUBLE))"
        for name in names
    ]
    total, *numbers = runs.table.row(
        f"SELECT {', '.join(['count(*)', *columns])} FROM {runs.matching(DISTINCT_FAULTS)}"
    )
    # The numbers alternate: faults in which the check tripped, and its least margin (None: none).
    rows = []
    for check, tripped, margin in zip(names, numbers[::2], numbers[1::2], strict=True):
        definition = manifest.robot.check(check)
        rows.append(
            {
                "name": check,
                "what": definition.meaning,
                "does": definition.does,
                "tripped": fault_share(runs, tripped, total),
                "closest": math.nan if margin is None else float(margin),
                "unit": "" if definition.unit == "1" else definition.unit,
            }
        )
    return sorted(rows, key=lambda row: -row["tripped"].k)


def cause_rows(runs: Runs) -> list[Row]:
    """Return for each check how often it stopped, flagged or limited, most frequent first."""
    counts = ", ".join(f"count(*) FILTER (response = '{name}')" for name in CAUSED)
    return [
        {"cause": cause or "not recorded", **dict(zip(CAUSED, numbers, strict=True))}
        for cause, *numbers in runs.table.rows(
            f"SELECT response_cause::VARCHAR AS cause, {counts} FROM"
            f" {runs.matching(DISTINCT_FAULTS)} WHERE response <> 'silent' GROUP BY cause"
            " ORDER BY count(*) DESC, cause"
        )
    ]


class OverloadRow(NamedTuple):
    """Distinct faults of one site, by the first valid run of each in which nobody reacts."""

    site: str
    faults: int
    overloaded: Rate  # faults with an overloaded cable that the golden run does not have by then
    unintended: int  # of the overloaded ones: those with an unintended motion
    cable: str  # cable that was most often overloaded first; "" if none was
    load: float  # largest tension of a cable, as a multiple of its strength


EVERY_SITE = "every site"


def overload_rows(runs: Runs) -> list[OverloadRow]:
    """Return the number of faults with an overloaded cable, for all sites and for each site.

    The first row is for all sites. Then come the sites with an overload, most frequent first. There
    are no rows if no tension is known.
    """
    if "overload" not in runs.manifest.shape.stages:
        return []
    over = events.event_sql("cable_overload", runs.manifest.rules)
    columns = (
        f"count(*) FILTER ({over})",
        f"count(*) FILTER ({over} AND unintended)",
        f"coalesce(mode(cable_overload::VARCHAR) FILTER ({over}), '')",
        "max(cable_load::DOUBLE)",
    )
    every, sites = (
        [
            OverloadRow(site, n, fault_share(runs, k, n, groups), *rest)
            for site, groups, n, k, *rest in class_counts(runs, by, columns)
        ]
        for by in (f"'{EVERY_SITE}'", "site::VARCHAR")
    )
    sites = [row for row in sites if row.overloaded.k]
    return [*every, *sorted(sites, key=lambda row: (-row.overloaded.k, row.site))]


def replay_command(folder: Path, run_id: str) -> str:
    """Return the command that replays a run."""
    return f"ravenjax trace {shlex.quote(str(folder))} {run_id}"


def failure_rows(runs: Runs, folder: Path) -> list[Row]:
    """Return runs without a valid outcome by cause and group, with one run to replay."""
    return [
        {"cause": cause, "group": group, "n": n, "command": replay_command(folder, run_id)}
        for cause, group, n, run_id in runs.table.rows(
            'SELECT failed::VARCHAR AS cause, "group"::VARCHAR AS name, count(*), arg_min(run_id,'
            f" row) FROM {RESULTS} WHERE failed <> '' GROUP BY cause, name ORDER BY cause, name"
        )
    ]


def _verdicts(runs: Runs, folder: Path):
    manifest = runs.manifest
    return {
        "matrix_rows": verdict_matrix(runs),
        "jumps": jump_rows(runs),
        "overloads": overload_rows(runs),
        "cables_break": (manifest.config.get("campaign") or {}).get("cables") == "break",
        "stopped": decisions.describe_stop(folder),
        "definitions": [
            definition
            for definition in definitions.definition_rows(manifest.rules, manifest.robot)
            if definition.word != definitions.OVERLOADED or "overload" in manifest.shape.stages
        ],
    }


SECTIONS = {
    "verdicts": _verdicts,
    "groups": lambda runs, _: {"groups": group_rows(runs), "outcomes": OUTCOMES},
    "checks": lambda runs, _: {"checks": check_rows(runs), "causes": cause_rows(runs)},
    "failures": lambda runs, folder: {"failures": failure_rows(runs, folder)},
}
