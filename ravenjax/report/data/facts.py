"""Derives the facts of each run that the report counts from the result table, in SQL, so that a
table may exceed memory.

`define` makes the table `facts` beside a result table, `derive` the same of a DataFrame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax import robots
from ravenjax.outcomes import events, verdict
from ravenjax.outcomes.events import Rules
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, ResultTable, quoted, text
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.reactions import ACTIONS
from ravenjax.vocabulary.robot import OTHER_LAYER, Robot

OUTCOMES = {
    "stopped": "a check stopped the robot",
    "flagged": "a check told a person, the robot went on",
    "felt": "nobody was told by a check; unintended motion, the cue came",
    "unseen": "nobody was told by a check; unintended motion, no cue",
    "lost": "nobody was told by a check; loss of motion",
    "misreported": "nobody was told by a check; only the robot's report went astray",
    "phantom": "nobody was told by a check; no hazard, the cue came all the same",
    "limited": "a check limited a command or dropped a packet; no hazard, no cue",
    "quiet": "no check, no hazard, no cue",
    "failed": "the run gave no valid outcome",
}
"""Each run has exactly one; those "felt" and "unseen" evaded the checks."""

ACTION = "param:reaction.action"

FACTS = "facts"
"""The table of what `define` derives."""


class Choices(NamedTuple):
    """What a campaign chose."""

    rules: Rules = Rules()  # of the definitions of outcomes
    action: int = (
        0  # what the operator does at a cue where the run's parameters do not say, of ACTIONS
    )
    robot: Robot = robots.USUAL


def choices(manifest: Manifest) -> Choices:
    """What the campaign of a manifest chose."""
    reaction = manifest.config.get("reaction") or {}
    return Choices(
        manifest.rules,
        ACTIONS.index(reaction.get("action", "release")) if manifest.shape.reacts else 0,
        manifest.robot,
    )


def of(frame: pd.DataFrame, manifest: Manifest) -> pd.DataFrame:
    """`derive` with the choices of the campaign that a manifest describes."""
    return derive(frame, choices(manifest))


USUAL = Choices()
"""The choices of a campaign that chose nothing."""


def derive(frame: pd.DataFrame, chosen: Choices = USUAL) -> pd.DataFrame:
    """The facts of a result table in memory, one row per run, the index of `frame` kept.

    Columns as of `define`, and run_id.
    """
    with query.empty() as table:
        take(table, frame.loc[:, needed(list(frame), chosen)])
        define(table, chosen)
        facts = table.frame(f"SELECT * EXCLUDE row FROM {FACTS} ORDER BY row")
    words = ("response", "hazard", "outcome", "site", "layer", "block")
    facts = facts.astype({name: "str" for name in words if name in facts})
    facts.index = frame.index
    facts.insert(0, "run_id", frame["run_id"])
    facts["group"] = facts["group"].astype("category")
    return facts


def take(table: ResultTable, frame: pd.DataFrame) -> None:
    """Make a DataFrame the result table of a connection."""
    # a NaN stays one, as in the parts: Arrow would make it a missing value
    plain = {
        name: frame[name].to_numpy() if frame[name].dtype.kind == "f" else frame[name]
        for name in frame
    }
    columns = {
        name: pa.array(values, from_pandas=not isinstance(values, np.ndarray))
        for name, values in plain.items()
    }
    table.register("given", pa.table({"row": np.arange(len(frame), dtype=np.int32), **columns}))
    table.run(f"CREATE VIEW {RESULTS} AS SELECT * FROM given")


def needed(names: Sequence[str], chosen: Choices) -> list[str]:
    """Columns of a result table, among its own, that `define` reads."""
    cue, jump = f"cue{chosen.rules.cue}_first_ms", chosen.rules.jump
    plain = {
        "response",
        "hazard",
        "failed",
        "group",
        "activated",
        "pair",
        "operator",
        "first_active_ms",
        "run_id",
    }
    plain |= {
        "response_ms",
        "told_ms",
        "unintended_first_ms",
        "loss_first_ms",
        "false_report_first_ms",
    }
    plain |= {cue, f"golden_{cue}", jump}
    return [name for name in names if name in plain or name.startswith(("fault", "param:"))]


def define(table: ResultTable, chosen: Choices, more: Mapping[str, str] | None = None) -> bool:
    """Make the table `facts` of a connection that has `results` with a column `row`, different in
    each.

    Columns: row, group, faulty, activated, failed, response and hazard (as in the table; "" of
    failed runs), told and evaded (events of `ravenjax.outcomes`), unintended, loss, misreport
    (whether it is the run's hazard), halted (a loss of motion because the robot was not live), cued
    (a cue that the golden run had not), jump (of the reported tip), outcome (of OUTCOMES), distinct
    (equal for runs that differ in seed or in crossed parameters alone), action (of ACTIONS, by
    number), plain (nobody reacts, or everybody does; so that one fault is not counted once for each
    action), sample (the first valid plain run of each distinct input: what rates, intervals and
    tests take as one draw), site, layer and block (site and effect) of the first fault, onset_ms,
    length_ms, magnitude (of the first fault), active_ms, response_ms, told_ms, cue_ms (the first
    cue at all), warned_ms (a cue that the golden run had not), unintended_ms, loss_ms, misreport_ms
    (of the run's hazard); times are -1 where never. `more`: further columns, by expressions of
    columns of `results`.

    Returns whether no input occurs twice; then `distinct` is `row`.
    """
    rules = chosen.rules
    types = table.types()
    names = list(types)
    unique = _number(table, types)
    action, anybody = action_sql(names, chosen.action), "true"
    if ACTION in names:
        (idle,) = table.row(f"SELECT count(*) FILTER ({action} = 0) FROM {RESULTS}")
        anybody = f"{action} = 0" if idle else "true"
    valid = events.VALID_SQL
    base = {
        "row": "row",
        "group": '"group"',
        "faulty": faulty_sql(names),
        "activated": "activated::BOOLEAN",
        "failed": f"NOT ({valid})",
        "response": f"CASE WHEN {valid} THEN response::VARCHAR ELSE '' END",
        "hazard": f"CASE WHEN {valid} THEN hazard::VARCHAR ELSE '' END",
        **{name: f"{valid} AND {events.sql(event, rules)}" for name, event in _EVENTS.items()},
        "active_ms": "first_active_ms",
        "response_ms": "response_ms",
        "told_ms": "told_ms",
        "cue_ms": f"cue{rules.cue}_first_ms",
        "warned_ms": warned_sql(rules.cue),
        "unintended_ms": _of_hazard("unintended motion", "unintended_first_ms"),
        "loss_ms": _of_hazard("loss of motion", "loss_first_ms"),
        "misreport_ms": _of_hazard("false report", "false_report_first_ms"),
        "action": f"({action})::TINYINT",
        "plain": anybody,
        **_first_fault(names, chosen.robot),
        **(more or {}),
    }
    derived = {
        "halted": "loss AND loss_ms < 0",
        "outcome": (
            "CASE WHEN failed THEN 'failed' WHEN told THEN response::VARCHAR WHEN unintended AND"
            " cued THEN 'felt' WHEN unintended THEN 'unseen' WHEN loss THEN 'lost' WHEN misreport"
            " THEN 'misreported' WHEN cued THEN 'phantom' WHEN response = 'limited' THEN 'limited'"
            " ELSE 'quiet' END"
        ),
    }
    for name, words in _words(table, names, chosen.robot).items():
        base[name] = f"({base[name]})::{query.enum(words)}"
    base["response"] = f"({base['response']})::{query.enum(['', *verdict.RESPONSES])}"
    base["hazard"] = f"({base['hazard']})::{query.enum(['', *verdict.HAZARDS])}"
    derived["outcome"] = f"({derived['outcome']})::{query.enum(list(OUTCOMES))}"
    numbered, own = (
        (f"{RESULTS}", "row") if unique else (f"{RESULTS} JOIN numbers USING (row)", '"distinct"')
    )
    table.run(
        f'CREATE TABLE {FACTS} AS WITH base AS (SELECT {_listed(base)}, {own} AS "distinct" FROM'
        f" {numbered}) SELECT *, {_listed(derived)}, plain AND NOT failed AS sample FROM base"
    )
    if not unique:
        table.run(
            f"UPDATE {FACTS} SET sample = false WHERE sample AND row NOT IN "
            f'(SELECT min(row) FROM {FACTS} WHERE sample GROUP BY "distinct")'
        )
        table.run("DROP TABLE numbers")
    return unique


_EVENTS = {
    "told": "told",
    "evaded": "evades",
    "unintended": "unintended_motion",
    "loss": "loss_of_motion",
    "misreport": "false_report",
    "cued": "cue",
    "jump": "jump",
}
"""Columns that are events of `ravenjax.outcomes`, where a run is valid."""


def _of_hazard(hazard: str, column: str) -> str:
    return f"CASE WHEN {events.VALID_SQL} AND hazard = {text(hazard)} THEN {column} ELSE -1 END"


def faulty_sql(names: Sequence[str]) -> str:
    """Whether a run has a fault, of columns of `results`."""
    sites = [name for name in names if name.startswith("fault") and name.endswith("_site")]
    return "(" + (" OR ".join(f"{quoted(name)} <> ''" for name in sites) or "false") + ")"


def action_sql(names: Sequence[str], usual: int) -> str:
    """What the operator does at a cue, by number, of columns of `results`; `usual` where a run
    does not say.
    """
    if ACTION not in names:
        return str(usual)
    own = quoted(ACTION)
    return f"CASE WHEN {own} IS NULL OR isnan({own}) THEN {usual} ELSE {own}::INTEGER END"


def warned_sql(cue: int) -> str:
    """When the cue of this number came that the golden run had not by then; -1 if never."""
    return events.beyond_golden_sql(f"cue{cue}_first_ms")


def first_sql(*times_ms: str) -> str:
    """The earliest of several times, expressions; -1 stands for never, of each and of the
    result.
    """
    came = [f"CASE WHEN {time} >= 0 THEN {time} END" for time in times_ms]
    return f"coalesce(least({', '.join(came)}), -1)"


def beyond_sql(name: str, limit: float, types: Mapping[str, str]) -> str:
    """Whether a number, which may be NaN, is above a limit; compared in the precision that the
    table has.
    """
    return f"({quoted(name)} > {limit!r}::{types[name]} AND NOT isnan({quoted(name)}::DOUBLE))"


def _number(table: ResultTable, types: Mapping[str, str]) -> bool:
    """Make the table `numbers` (row, distinct) where some input occurs twice, and say whether
    none does.
    """
    inputs = [name for name in types if name == "operator" or name.startswith(("param:", "fault"))]
    # 0 + x: a negative zero is a zero
    terms = [
        f"0 + {quoted(name)}" if types[name] in ("FLOAT", "DOUBLE") else quoted(name)
        for name in inputs
    ]
    key = f"hash({', '.join(terms) or '0'})"
    (unique,) = table.row(
        f"SELECT count(*) = count(DISTINCT {key}) AND bool_and(pair = row) FROM {RESULTS}"
    )
    if not unique:
        table.run(
            f"CREATE TABLE numbers AS WITH keyed AS (SELECT row, pair, {key} AS input FROM"
            f" {RESULTS}), inputs AS (SELECT input, min(row) AS first FROM keyed GROUP BY input),"
            ' pairs AS (SELECT pair, min(first) AS "distinct" FROM keyed JOIN inputs USING (input)'
            ' GROUP BY pair) SELECT row, "distinct" FROM keyed JOIN pairs USING (pair)'
        )
    return bool(unique)


def _words(table: ResultTable, names: Sequence[str], robot: Robot) -> dict[str, list[str]]:
    """Columns of words that a campaign chooses, and which occur; they are stored as one small
    number a row.
    """
    first = {
        name: sql for name, sql in _first_fault(names, robot).items() if name in ("site", "block")
    }
    columns = {"group": '"group"', **first}
    rows = table.rows(f"SELECT DISTINCT {', '.join(columns.values())} FROM {RESULTS}")
    vocabulary = {name: sorted({row[place] for row in rows}) for place, name in enumerate(columns)}
    return vocabulary | {"layer": [*robot.layers.values(), OTHER_LAYER]}


def _first_fault(names: Sequence[str], robot: Robot) -> dict[str, str]:
    if "fault0_site" not in names:
        return {"site": "''", "layer": text(OTHER_LAYER)}  # a campaign without any fault
    cases = " ".join(f"WHEN {text(site)} THEN {text(robot.layer(site))}" for site in robot.sites)
    return {
        "site": "fault0_site",
        "layer": f"CASE fault0_site {cases} ELSE {text(OTHER_LAYER)} END",
        "block": "fault0_site || ' · ' || fault0_effect",
        "onset_ms": "fault0_start_ms",
        "length_ms": "fault0_duration_ms",
        "magnitude": "fault0_value",
    }


def _listed(columns: Mapping[str, str]) -> str:
    return ", ".join(f"{sql} AS {quoted(name)}" for name, sql in columns.items())


def warned(frame: pd.DataFrame, cue: int) -> np.ndarray:
    """The same as `warned_sql` for a result table in memory: [rows]."""
    return verdict.beyond_golden(frame[f"cue{cue}_first_ms"], frame[f"golden_cue{cue}_first_ms"])


def golden_runs(frame: pd.DataFrame, chosen: np.ndarray) -> pd.DataFrame:
    """The different fault-free motions among the chosen rows (bool), one row each: operator and
    `golden_` columns.

    The golden runs of runs that share robot and operator are one computation, so they count once.
    """
    names = [name for name in frame if name == "operator" or name.startswith("golden_")]
    return frame.loc[chosen, names].drop_duplicates()


def hours(free: pd.DataFrame) -> float:
    """Hours in pedal-down of fault-free motions."""
    return float(free["golden_pedal_down_ms"].to_numpy().sum()) / 3.6e6


def first_came(frame: pd.DataFrame, column: str) -> np.ndarray:
    """Whether an event came at all, bool [rows]; its column holds when it first did."""
    return frame[column].to_numpy() >= 0
