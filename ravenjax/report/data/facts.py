"""Computes facts about each run, such as whether its fault evaded, by SQL from the result table.

With SQL, the table may be larger than the memory. `define_facts` creates the table `facts` in a
database connection that contains results.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax import resources, robots
from ravenjax.outcomes import events, verdict
from ravenjax.outcomes.events import Rules
from ravenjax.report import wording
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, ResultTable, quote_name, quote_text
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.effects import RANDOM
from ravenjax.vocabulary.reactions import ACTIONS
from ravenjax.vocabulary.robot import OTHER_LAYER, Robot

OUTCOME_WORDS = resources.read_tables(__file__, "outcomes.toml")
_COLUMNS = resources.read_tables(__file__, "facts.toml")
OUTCOMES = {name: words["meaning"] for name, words in OUTCOME_WORDS.items()}
"""Outcomes of a run. Each run has exactly one; "felt" and "unseen": it evaded the checks."""
VALID_OUTCOMES = [name for name in OUTCOMES if name != "failed"]

ACTION = "param:reaction.action"

FACTS = "facts"
"""Name of the table that `define_facts` creates, with one row for each run."""


class Choices(NamedTuple):
    """Choices of a campaign that affect how its runs are judged."""

    rules: Rules  # rules that define the outcomes
    # Operator's action at a cue, an index into ACTIONS, for runs whose parameters do not set it.
    action: int
    robot: Robot = robots.USUAL
    end_ms: int = 3_600_000  # length of each run


def recorded_choices(manifest: Manifest) -> Choices:
    """Return the choices recorded in a manifest."""
    reaction = manifest.config.get("reaction") or {}
    return Choices(
        manifest.rules,
        ACTIONS.index(reaction.get("action", "none")),
        manifest.robot,
        manifest.duration_ms,
    )


def register_table(table: ResultTable, frame: pd.DataFrame) -> None:
    """Register a DataFrame as the result table of a connection."""
    columns = {}
    for name in frame:
        # Keep NaN as NaN, as stored parts do. Arrow would convert it to a missing value.
        is_float = frame[name].dtype.kind == "f"
        values = frame[name].to_numpy() if is_float else frame[name]
        columns[name] = pa.array(values, from_pandas=not is_float)
    table.register("given", pa.table({"row": np.arange(len(frame), dtype=np.int32), **columns}))
    table.run(f"CREATE VIEW {RESULTS} AS SELECT * FROM given")


def define_facts(table: ResultTable, chosen: Choices, more: Mapping[str, str] = {}) -> bool:
    """Create the table `facts` on a connection whose table `results` has a unique column `row`.

    Words and truth values: group, faulty, activated, failed; response and hazard, "" for failed
    runs; told and evaded, events of `ravenjax.outcomes`; unintended, loss and misreport, the run's
    hazard; halted, a loss of motion because the robot was not live; cued, a cue that the golden run
    did not have; jump, of the reported tip; outcome, one of OUTCOMES.

    For counting: distinct is equal for runs that differ only in seed or crossed parameters. Each
    copy of a fault that draws numbers itself is distinct. action is an index into ACTIONS. `plain`
    marks runs in which nobody reacts, or all runs if every operator reacts. `sample` marks the
    first valid plain run of each distinct input whose fault, if any, changed a bit. Rates,
    intervals and tests take these runs as their draws.

    Of the first fault: site, layer, block (site and effect), onset_ms, length_ms, magnitude. Times
    in ms, -1 if the event never came: active_ms, response_ms, told_ms, cue_ms, warned_ms (-1 if the
    golden run had the cue too), unintended_ms, loss_ms and misreport_ms.

    `more`: further columns, as expressions over `results`. Return True if all inputs are distinct.
    """
    rules = chosen.rules
    types = table.types()
    names = list(types)
    unique = _number_faults(table, types, chosen.end_ms)
    action, plain = action_sql(names, chosen.action), "true"
    if ACTION in names:
        (idle,) = table.row(f"SELECT count(*) FILTER ({action} = 0) FROM {RESULTS}")
        plain = f"{action} = 0" if idle else "true"
    valid, cue = events.VALID_SQL, f"cue{rules.cue}_first_ms"
    terms = {"valid": valid, "cue": cue, "warned": events.beyond_golden_sql(cue)}
    happened = {name: events.event_sql(event, rules) for name, event in _COLUMNS["events"].items()}
    base = {
        "faulty": faulty_sql(names),
        **{name: f"{valid} AND {sql}" for name, sql in happened.items()},
        **{name: sql.format(**terms) for name, sql in _COLUMNS["columns"].items()},
        "action": f"({action})::TINYINT",
        "plain": plain,
        **_first_fault_sql(names, chosen.robot),
        **more,
    }
    derived = dict(_COLUMNS["derived"])
    for name, words in _list_words(table, names, chosen.robot).items():
        base[name] = f"({base[name]})::{query.enum_type(words)}"
    base["response"] = f"({base['response']})::{query.enum_type(['', *verdict.RESPONSES])}"
    base["hazard"] = f"({base['hazard']})::{query.enum_type(['', *verdict.HAZARDS])}"
    derived["outcome"] = f"({derived['outcome']})::{query.enum_type(list(OUTCOMES))}"
    # If all faults differ, the number of a fault is its row.
    source, fault_number = RESULTS, "row"
    if not unique:
        source, fault_number = f"{RESULTS} JOIN numbers USING (row)", '"distinct"'
    table.run(
        f"CREATE TABLE {FACTS} AS WITH base AS (SELECT {_select_list(base)}, {fault_number}"
        f' AS "distinct" FROM {source}) SELECT *, {_select_list(derived)}, plain AND NOT failed AND'
        " (activated OR NOT faulty) AS sample FROM base"
    )
    if not unique:
        table.run(
            f"UPDATE {FACTS} SET sample = false WHERE sample AND row NOT IN "
            f'(SELECT min(row) FROM {FACTS} WHERE sample GROUP BY "distinct")'
        )
        table.run("DROP TABLE numbers")
    return unique


def faulty_sql(names: Sequence[str]) -> str:
    """Return SQL for whether a run has a fault, over columns of `results`."""
    sites = [name for name in names if name.startswith("fault") and name.endswith("_site")]
    return "(" + (" OR ".join(f"{quote_name(name)} <> ''" for name in sites) or "false") + ")"


def action_sql(names: Sequence[str], usual: int) -> str:
    """Return SQL for the operator's action, an index into ACTIONS; `usual` is the default."""
    if ACTION not in names:
        return str(usual)
    action = quote_name(ACTION)
    return f"CASE WHEN {action} IS NULL OR isnan({action}) THEN {usual} ELSE {action}::INTEGER END"


def first_sql(*times_ms: str) -> str:
    """Return SQL for the earliest of several times. Each time, and the result, is -1 for never."""
    # `least` ignores NULL, which replaces the times that mean never.
    known = [f"CASE WHEN {time} >= 0 THEN {time} END" for time in times_ms]
    return f"coalesce(least({', '.join(known)}), -1)"


def beyond_sql(name: str, limit: float, types: Mapping[str, str]) -> str:
    """Return SQL for whether a column is above a limit, in the column's precision; NaN is not."""
    column = quote_name(name)
    return f"({column} > {limit!r}::{types[name]} AND NOT isnan({column}::DOUBLE))"


def _number_faults(table: ResultTable, types: Mapping[str, str], end_ms: int) -> bool:
    # Returns whether each run has another fault. If not, creates the table `numbers` with the
    # columns `row` and `distinct`, the first row with the run's fault. Runs have the same fault if
    # their inputs are equal, unless an effect draws random numbers. All runs of a pair have the
    # same fault. The template has three SQL expressions: whether an effect of the run draws random
    # numbers, a hash of the inputs, and a hash that differs between runs with different faults.
    prefixes = "operator", "param:", "fault"
    inputs = {name: kind for name, kind in types.items() if name.startswith(prefixes)}
    draws_numbers, input_hash, fault_hash = wording.fill_template(
        "inputs.sql.j2", types=inputs, columns=types, end_ms=end_ms, random=RANDOM, quote=quote_name
    )
    (any_draws,) = table.row(f"SELECT coalesce(bool_or({draws_numbers}), false) FROM {RESULTS}")
    # Without such effects both hashes distinguish the same runs, and `input_hash` is faster.
    keyed = f"(SELECT row, pair, {fault_hash if any_draws else input_hash} AS input FROM {RESULTS})"
    is_unique = "count(*) = count(DISTINCT input) AND bool_and(pair = row)"
    (unique,) = table.row(f"SELECT {is_unique} FROM {keyed}")
    if not unique:
        table.run(
            f"CREATE TABLE numbers AS WITH keyed AS {keyed},"
            " inputs AS (SELECT input, min(row) AS first FROM keyed GROUP BY input),"
            ' pairs AS (SELECT pair, min(first) AS "distinct" FROM keyed JOIN inputs USING (input)'
            ' GROUP BY pair) SELECT row, "distinct" FROM keyed JOIN pairs USING (pair)'
        )
    return bool(unique)


def _list_words(table: ResultTable, names: Sequence[str], robot: Robot):
    # Returns the different words in columns of text, which become enumerated types.
    columns = {"group": '"group"'} | _first_fault_sql(names, robot)
    columns = {name: columns[name] for name in columns if name in ("group", "site", "block")}
    rows = table.rows(f"SELECT DISTINCT {', '.join(columns.values())} FROM {RESULTS}")
    vocabulary = {name: sorted({row[index] for row in rows}) for index, name in enumerate(columns)}
    return vocabulary | {"layer": [*robot.layers.values(), OTHER_LAYER]}


def _first_fault_sql(names: Sequence[str], robot: Robot):
    # Returns SQL for the columns that describe a run's first fault. Without `fault0_site`, the
    # campaign has no faults. The layer follows from the site by the robot's definition.
    if "fault0_site" not in names:
        return {"site": "''", "layer": quote_text(OTHER_LAYER)}
    layers = ((quote_text(site), quote_text(robot.layer(site))) for site in robot.sites)
    cases = " ".join(f"WHEN {site} THEN {layer}" for site, layer in layers)
    layer = f"CASE fault0_site {cases} ELSE {quote_text(OTHER_LAYER)} END"
    return _COLUMNS["first_fault"] | {"layer": layer}


def _select_list(columns: Mapping[str, str]) -> str:
    # Returns SQL for a list of columns. columns: name -> expression.
    return ", ".join(f"{sql} AS {quote_name(name)}" for name, sql in columns.items())
