"""What the report says about each run, derived once from the result table: SQL, so that a table may exceed memory.

`define` makes the table `facts` beside a result table, `derive` the same of a DataFrame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax.report import layers
from ravenjax.store import query, schema
from ravenjax.store.manifest import Manifest
from ravenjax.store.query import RESULTS, Table, quoted, text

OUTCOMES = {
    "stopped": "a built-in check stopped the robot",
    "flagged": "a built-in check responded without a stop",
    "felt": "no check; the instrument left the model, the cue fired",
    "unseen": "no check; the instrument left the model, no cue fired",
    "phantom": "no check; the instrument stayed near, the cue fired all the same",
    "jumped": "no check, no cue; the reported tip jumped, the instrument stayed near",
    "quiet": "no check, no cue, no jump; the instrument stayed near",
    "failed": "the run gave no valid outcome",
}
"""Each run has exactly one; "felt" and "unseen" evaded the checks and moved the instrument off the model by more than
the cue's threshold."""

EVADED = ("felt", "unseen")


HARM_MM = 3.0
"""As the column moved_first_ms: the true tip is so far off the nominal model while the robot is live."""

HARM = f"the true tip more than {HARM_MM:g} mm off the nominal model while the robot was live, or a jump"
"""What counts as harm, for a run that its fault-free twin does not also have by then."""

ACTION = "param:reaction.action"
ACTIONS = ("none", "release", "slow", "correct")
"""As ravenjax.stages.reaction.ACTIONS, which cannot be imported without importing jax."""

FACTS = "facts"
"""The table of what `define` derives."""


class Rules(NamedTuple):
    """What the words mean in one campaign."""

    cue: int = 0  # haptic set of the verdicts
    threshold_mm: float = HARM_MM  # its own
    jump: str = "jump_code"  # column of the jump rule
    action: int = 0  # what the operator does at a cue where the run's parameters do not say, of ACTIONS


def rules(manifest: Manifest) -> Rules:
    """Those of the campaign that a manifest describes."""
    cue = manifest.cues[manifest.verdict_cue] if manifest.cues else None
    reaction = manifest.config.get("reaction") or {}
    return Rules(
        manifest.verdict_cue,
        cue.threshold_mm if cue else HARM_MM,
        manifest.verdict_jump,
        ACTIONS.index(reaction.get("action", "release")) if manifest.shape.reacts else 0,
    )


def of(frame: pd.DataFrame, manifest: Manifest) -> pd.DataFrame:
    """`derive` with the cue, the jump rule and the reaction of the campaign that a manifest describes."""
    return derive(frame, *rules(manifest))


def derive(
    frame: pd.DataFrame, cue: int = 0, threshold_mm: float = HARM_MM, jump: str = "jump_code", action: int = 0
) -> pd.DataFrame:
    """The facts of a result table in memory, one row per run, the index of `frame` kept; arguments as in `Rules`.

    Columns as of `define`, and run_id.
    """
    asked = Rules(cue, threshold_mm, jump, action)
    with query.empty() as table:
        take(table, frame.loc[:, needed(list(frame), asked)])
        define(table, asked)
        facts = table.frame(f"SELECT * EXCLUDE row FROM {FACTS} ORDER BY row")
    words = ("response", "outcome", "site", "layer", "block")
    facts = facts.astype({name: "str" for name in words if name in facts})
    facts.index = frame.index
    facts.insert(0, "run_id", frame["run_id"])
    facts["group"] = facts["group"].astype("category")
    return facts


def take(table: Table, frame: pd.DataFrame) -> None:
    """Make a DataFrame the result table of a connection."""
    # a NaN stays one, as in the parts: Arrow would make it a missing value
    plain = {name: frame[name].to_numpy() if frame[name].dtype.kind == "f" else frame[name] for name in frame}
    given = {name: pa.array(values, from_pandas=not isinstance(values, np.ndarray)) for name, values in plain.items()}
    table.register("given", pa.table({"row": np.arange(len(frame), dtype=np.int32), **given}))
    table.run(f"CREATE VIEW {RESULTS} AS SELECT * FROM given")


def needed(names: Sequence[str], rules: Rules) -> list[str]:
    """Columns of a result table, among its own, that `define` reads."""
    cue, jump = f"cue{rules.cue}_first_ms", rules.jump
    plain = {"verdict", "failed", "group", "activated", "pair", "operator", "first_active_ms", "response_ms", "run_id"}
    plain |= {"peak_model_deviation_mm", cue, f"twin_{cue}", "moved_first_ms", "twin_moved_first_ms", jump}
    plain.add(f"{jump}_first_ms")
    return [name for name in names if name in plain or name.startswith(("fault", "param:"))]


def define(table: Table, rules: Rules, more: Mapping[str, str] | None = None) -> bool:
    """Make the table `facts` of a connection that has `results` with a column `row`, different in each.

    Columns: row, group, faulty, activated, failed, response, haptic, jump (from the verdict), moved (the true tip
    left the nominal model by more than the threshold, which encoders need not see), outcome (of OUTCOMES), evaded,
    distinct (equal for runs that differ in seed or in crossed parameters alone), action (of ACTIONS, by number), plain
    (nobody reacts, or everybody does; so that one fault is not counted once for each action), sample (the first valid
    plain run of each distinct input: what intervals and tests take as one draw), site, layer and block (site and
    effect) of the first fault, onset_ms, length_ms, magnitude (of the first fault), active_ms, cue_ms, response_ms,
    warned_ms (the cue, where the fault-free twin had none by then), moved_ms (more than HARM_MM off, and the twin not),
    harm_ms (see HARM); times are -1 where never. harm is whether it came. `more`: further columns, by expressions of
    columns of `results`.

    Returns whether no input occurs twice; then `distinct` is `row`.
    """
    types = table.types()
    names = list(types)
    unique = _number(table, types)
    action, anybody = action_sql(names, rules), "true"
    if ACTION in names:
        (idle,) = table.row(f"SELECT count(*) FILTER ({action} = 0) FROM {RESULTS}")
        anybody = f"{action} = 0" if idle else "true"
    base = {
        "row": "row",
        "group": '"group"',
        "faulty": faulty_sql(names),
        "activated": "activated::BOOLEAN",
        "failed": "failed <> ''",
        "response": "split_part(verdict, '/', 1)",
        "haptic": "split_part(verdict, '/', 2) = 'haptic'",
        "jump": "split_part(verdict, '/', 3) = 'jump'",
        "moved": beyond_sql("peak_model_deviation_mm", rules.threshold_mm, types),
        "active_ms": "first_active_ms",
        "cue_ms": f"cue{rules.cue}_first_ms",
        "response_ms": "response_ms",
        "warned_ms": warned_sql(rules.cue),
        "moved_ms": f"CASE WHEN failed <> '' THEN -1 ELSE {own_sql('moved_first_ms')} END",
        "jumped_ms": f"CASE WHEN {rules.jump} AND failed = '' THEN {rules.jump}_first_ms ELSE -1 END",
        "action": f"({action})::TINYINT",
        "plain": anybody,
        **_first_fault(names),
        **(more or {}),
    }
    told = {
        "outcome": "CASE WHEN failed OR response = '' THEN 'failed' WHEN response <> 'silent' THEN response "
        "WHEN haptic AND moved THEN 'felt' WHEN moved THEN 'unseen' WHEN haptic THEN 'phantom' "
        "WHEN jump THEN 'jumped' ELSE 'quiet' END",
        "harm_ms": first_sql("moved_ms", "jumped_ms"),
        "harm": f"{first_sql('moved_ms', 'jumped_ms')} >= 0",
    }
    for name, words in _words(table, names).items():
        base[name] = f"({base[name]})::{query.enum(words)}"
    base["response"] = f"({base['response']})::{query.enum(['', *schema.RESPONSES])}"
    told["outcome"] = f"({told['outcome']})::{query.enum(list(OUTCOMES))}"
    numbered, own = (f"{RESULTS}", "row") if unique else (f"{RESULTS} JOIN numbers USING (row)", '"distinct"')
    table.run(
        f'CREATE TABLE {FACTS} AS WITH base AS (SELECT {_listed(base)}, {own} AS "distinct" FROM {numbered}), '
        f"told AS (SELECT * EXCLUDE jumped_ms, {_listed(told)} FROM base) "
        f"SELECT *, outcome IN ({', '.join(map(text, EVADED))}) AS evaded, plain AND NOT failed AS sample FROM told"
    )
    if not unique:
        table.run(
            f"UPDATE {FACTS} SET sample = false WHERE sample AND row NOT IN "
            f'(SELECT min(row) FROM {FACTS} WHERE sample GROUP BY "distinct")'
        )
        table.run("DROP TABLE numbers")
    return unique


def faulty_sql(names: Sequence[str]) -> str:
    """Whether a run has a fault, of columns of `results`."""
    sites = [name for name in names if name.startswith("fault") and name.endswith("_site")]
    return "(" + (" OR ".join(f"{quoted(name)} <> ''" for name in sites) or "false") + ")"


def action_sql(names: Sequence[str], rules: Rules) -> str:
    """What the operator does at a cue, by number, of columns of `results`."""
    if ACTION not in names:
        return str(rules.action)
    given = quoted(ACTION)
    return f"CASE WHEN {given} IS NULL OR isnan({given}) THEN {rules.action} ELSE {given}::INTEGER END"


def own_sql(name: str) -> str:
    """As `own`, of a column and its twin's."""
    mine, twin = quoted(name), quoted(f"twin_{name}")
    return f"CASE WHEN {mine} >= 0 AND NOT ({twin} >= 0 AND {twin} <= {mine}) THEN {mine} ELSE -1 END"


def warned_sql(cue: int) -> str:
    """As `warned`."""
    return own_sql(f"cue{cue}_first_ms")


def first_sql(*times_ms: str) -> str:
    """As `first_of`, of expressions."""
    came = [f"CASE WHEN {time} >= 0 THEN {time} END" for time in times_ms]
    return f"coalesce(least({', '.join(came)}), -1)"


def beyond_sql(name: str, limit: float, types: Mapping[str, str]) -> str:
    """Whether a number, which may be NaN, is above a limit; compared in the precision that the table has."""
    return f"({quoted(name)} > {limit!r}::{types[name]} AND NOT isnan({quoted(name)}::DOUBLE))"


def _number(table: Table, types: Mapping[str, str]) -> bool:
    """Make the table `numbers` (row, distinct) where some input occurs twice, and say whether none does."""
    inputs = [name for name in types if name == "operator" or name.startswith(("param:", "fault"))]
    # 0 + x: a negative zero is a zero
    given = [f"0 + {quoted(name)}" if types[name] in ("FLOAT", "DOUBLE") else quoted(name) for name in inputs]
    key = f"hash({', '.join(given) or '0'})"
    (unique,) = table.row(f"SELECT count(*) = count(DISTINCT {key}) AND bool_and(pair = row) FROM {RESULTS}")
    if not unique:
        table.run(
            f"CREATE TABLE numbers AS WITH keyed AS (SELECT row, pair, {key} AS input FROM {RESULTS}), "
            "inputs AS (SELECT input, min(row) AS first FROM keyed GROUP BY input), "
            'pairs AS (SELECT pair, min(first) AS "distinct" FROM keyed JOIN inputs USING (input) GROUP BY pair) '
            'SELECT row, "distinct" FROM keyed JOIN pairs USING (pair)'
        )
    return bool(unique)


def _words(table: Table, names: Sequence[str]) -> dict[str, list[str]]:
    """Columns of words that a campaign chooses, and which occur; they are stored as one small number a row."""
    first = {name: sql for name, sql in _first_fault(names).items() if name in ("site", "block")}
    asked = {"group": '"group"', **first}
    found = table.rows(f"SELECT DISTINCT {', '.join(asked.values())} FROM {RESULTS}")
    told = {name: sorted({row[place] for row in found}) for place, name in enumerate(asked)}
    return told | {"layer": [*layers.LAYERS.values(), layers.OTHER]}


def _first_fault(names: Sequence[str]) -> dict[str, str]:
    if "fault0_site" not in names:
        return {"site": "''", "layer": text(layers.OTHER)}  # a campaign without any fault
    known = " ".join(f"WHEN {text(site)} THEN {text(layers.name(site))}" for site in layers.OF_SITE)
    return {
        "site": "fault0_site",
        "layer": f"CASE fault0_site {known} ELSE {text(layers.OTHER)} END",
        "block": "fault0_site || ' · ' || fault0_effect",
        "onset_ms": "fault0_start_ms",
        "length_ms": "fault0_duration_ms",
        "magnitude": "fault0_value",
    }


def _listed(columns: Mapping[str, str]) -> str:
    return ", ".join(f"{sql} AS {quoted(name)}" for name, sql in columns.items())


def own(first_ms: np.ndarray, twin_ms: np.ndarray) -> np.ndarray:
    """Time [n] of what came first in each run, -1 where it never came or the fault-free twin had it by then, too."""
    return np.where((first_ms >= 0) & ~((twin_ms >= 0) & (twin_ms <= first_ms)), first_ms, -1)


def first_of(*times_ms: np.ndarray) -> np.ndarray:
    """The earliest of several times [n] of each run; -1 stands for never, of each and of the result."""
    came = [np.where(time < 0, np.inf, time) for time in times_ms]
    earliest = np.min(came, axis=0)
    return np.where(np.isinf(earliest), -1, earliest).astype(int)


def warned(frame: pd.DataFrame, cue: int) -> np.ndarray:
    """When each run's cue of this number came and its twin's had not, -1 if never: a cue that the twin has too tells
    of the motion and not of the fault."""
    return own(frame[f"cue{cue}_first_ms"].to_numpy(), frame[f"twin_cue{cue}_first_ms"].to_numpy())


def motions(frame: pd.DataFrame, facts: pd.DataFrame) -> pd.DataFrame:
    """The fault-free motions of a campaign's plain runs, as `twins`."""
    return twins(frame, facts["plain"].to_numpy(bool))


def twins(frame: pd.DataFrame, chosen: np.ndarray) -> pd.DataFrame:
    """The different fault-free motions among the chosen rows (bool), one row each: operator and `twin_` columns.

    The twins of runs that share robot and operator are one computation, so they count once.
    """
    names = [name for name in frame if name == "operator" or name.startswith("twin_")]
    return frame.loc[chosen, names].drop_duplicates()


def hours(free: pd.DataFrame) -> float:
    """Hours in pedal-down of fault-free motions."""
    return float(free["twin_pedal_down_ms"].to_numpy().sum()) / 3.6e6


def first_came(frame: pd.DataFrame, column: str) -> np.ndarray:
    """Whether an event came at all, bool [rows]; its column holds when it first did."""
    return frame[column].to_numpy() >= 0
