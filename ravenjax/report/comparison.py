"""Compares the configurations, outcomes and rates of two campaigns that share faults.

A run of one result folder is paired with the run of the other folder that has the same run id. The
remaining runs are paired if their faults are equal, and each parameter that both campaigns vary has
the same value. If several runs have the same fault, they are paired in the order of the tables.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.errors import UserError
from ravenjax.outcomes.events import VALID_SQL, Rules, event_meaning, event_sql
from ravenjax.outcomes.verdict import CUES, HAZARDS, RESPONSES
from ravenjax.report import wording
from ravenjax.report.data import draws, pair_intervals
from ravenjax.report.data.facts import faulty_sql
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.units import Units
from ravenjax.store import manifest
from ravenjax.store.access import query
from ravenjax.store.access.query import ResultTable, quote_name
from ravenjax.store.manifest import Change, Manifest
from ravenjax.vocabulary.robot import Robot

RATES = ("evades", "unintended_motion", "loss_of_motion", "false_report", *RESPONSES, "cue")
"""Events of `ravenjax.outcomes` whose rates are compared."""
WORDS = {"response": RESPONSES, "hazard": HAZARDS, "cue": CUES}
"""The parts of a run's verdict, and the words that each part can have."""
SIDES = ("first", "second")


class ComparedPairs(NamedTuple):
    """Numbers of paired and unpaired runs."""

    by_run_id: int
    by_fault: int
    unpaired: tuple[int, int]  # runs without a partner in each folder
    compared: int  # pairs with two valid outcomes of a fault that changed a bit in some run
    inactive: int = 0  # pairs with two valid outcomes of a fault that changed no bit in either run
    faults: int = 0  # different faults among the compared pairs
    sampled: bool = False  # True if both campaigns drew their faults


class RateChange(NamedTuple):
    """The rate of one event in both folders, over the compared pairs."""

    name: str
    meaning: str
    first: Rate
    second: Rate
    difference: Estimate  # second minus first, as a fraction
    first_only: int
    second_only: int


class Transition(NamedTuple):
    """The number of runs whose outcome changed from one word to another."""

    first: str
    second: str
    runs: int


class RunChange(NamedTuple):
    """The outcome of one fault in both folders."""

    run_ids: tuple[str, str]
    fault: str
    verdicts: tuple[str, str]
    unintended_mm: tuple[float, float]


class FolderComparison(NamedTuple):
    """The complete comparison of two result folders."""

    folders: tuple[Path, Path]
    campaigns: tuple[str, str]
    limits_mm: tuple[float, float]
    harms: tuple[str, str]  # what counts as unintended motion in each campaign
    configuration: Sequence[Change]
    environment: Sequence[Change]  # engine, device, code, versions
    pairs: ComparedPairs
    rates: Sequence[RateChange]  # empty without a compared pair
    transitions: dict[str, Sequence[Transition]]  # for each key of WORDS: all occurring transitions
    changed: Sequence[RunChange]  # the most changed first

    def sentences(self) -> list[str]:
        """Return sentences that describe what is compared."""
        return wording.fill_template("comparison.txt.j2", **self._asdict())


def compare_folders(first: Path, second: Path, most: int = 10) -> FolderComparison:
    """Compare two result folders and list at most `most` changed runs.

    Raises StoreError as `query.open_folder` does, and UserError if the folders share no fault.
    """
    if most < 0:
        raise UserError(f"--most {most}: expected a number of runs to list, 0 or more")
    records = manifest.read_manifest(first), manifest.read_manifest(second)
    with query.open_folder(first) as table:
        table.run(f"ALTER VIEW {query.RESULTS} RENAME TO runs_first")
        files = query.of_files(query.whole_parts(second))
        table.run(f'CREATE VIEW runs_second AS SELECT *, "index" AS row FROM {files}')
        pairs = _pair_runs(table, (first, second))
        for side, record, key in zip(SIDES, records, _fault_key_sql(table), strict=True):
            _create_judged_table(table, side, record.rules, key)
        names = ["group", *WORDS, *(f"is_{name}" for name in RATES)]
        aliases = (f"{s}.{quote_name(n)} AS {quote_name(f'{s}_{n}')}" for s in "ab" for n in names)
        compared = table.frame(
            f"SELECT a.fault AS fault, {', '.join(aliases)} FROM {_JOINED} ORDER BY pairs.first"
        )
        faults = compared["fault"].to_numpy()
        drawn = zip("ab", (draws.drawn_groups(record.config) for record in records), strict=True)
        sampled = all(
            groups is None or groups.issuperset(compared[f"{side}_group"]) for side, groups in drawn
        )
        units = pair_intervals.pair_faults(faults, sampled)
        (inactive,) = table.row(f"SELECT count(*) FROM {_VALID} AND NOT {_ACTING}")
        pairs = pairs._replace(
            compared=len(faults), inactive=inactive, faults=len(np.unique(faults)), sampled=sampled
        )
        return FolderComparison(
            (first, second),
            (records[0].campaign, records[1].campaign),
            (records[0].limit_mm, records[1].limit_mm),
            (records[0].rules.harm, records[1].rules.harm),
            manifest.find_changes(records[0].config, records[1].config),
            manifest.find_changes(*map(_describe_origin, records)),
            pairs,
            _compare_rates(compared, records[0].rules, units) if len(faults) else [],
            {word: _transitions(compared, word) for word in WORDS},
            _list_changed_runs(records[0].robot, table, most),
        )


def _describe_origin(record: Manifest):
    # Returns the engine, device and versions with which a result was computed.
    return {
        "engine": record.engine,
        "device": record.device,
        "code_hash": record.code_hash[:16],
        "versions": record.versions | record.settings,
    }


def _pair_runs(table: ResultTable, folders: tuple[Path, Path]) -> ComparedPairs:
    # Creates the table `pairs`: runs with the same run id, then with equal faults and parameters.
    table.run(
        "CREATE TABLE pairs AS SELECT a.row AS first, b.row AS second, true AS same_id "
        "FROM runs_first AS a JOIN runs_second AS b USING (run_id)"
    )
    for side, key in zip(SIDES, _fault_key_sql(table), strict=True):
        table.run(
            f"CREATE TABLE unpaired_{side} AS WITH keyed AS (SELECT row, hash({key}) AS key FROM"
            f" runs_{side} ANTI JOIN (SELECT {side} AS row FROM pairs) USING (row)) SELECT row,"
            " key, row_number() OVER (PARTITION BY key ORDER BY row) AS nth FROM keyed"
        )
    table.run(
        "INSERT INTO pairs SELECT a.row, b.row, false FROM unpaired_first AS a"
        " JOIN unpaired_second AS b USING (key, nth)"
    )
    counts = "count(*) FILTER (same_id), count(*) FILTER (NOT same_id)"
    by_run_id, by_fault = table.row(f"SELECT {counts} FROM pairs")
    if not by_run_id + by_fault:
        raise UserError(
            f"{folders[0]} and {folders[1]} share no fault. Two runs are compared if they have the"
            " same run id, or the same faults and the same values of all parameters that both"
            " campaigns vary. Compare runs of one campaign, for example with different --set."
        )
    runs = [table.row(f"SELECT count(*) FROM runs_{side}")[0] for side in SIDES]
    first, second = (count - by_run_id - by_fault for count in runs)
    return ComparedPairs(by_run_id, by_fault, unpaired=(first, second), compared=0)


def _fault_key_sql(table: ResultTable) -> list[str]:
    # Returns for both folders the SQL of a key that equal faults share. A fault slot that a folder
    # lacks is empty there. A parameter that a folder lacks is left out.
    types = [table.types(f"runs_{side}") for side in SIDES]
    faults = sorted(name for name in types[0] | types[1] if name.startswith("fault"))
    shared = sorted(name for name in types[0] if name.startswith("param:") and name in types[1])
    names = [*faults, *shared]
    return wording.fill_template("fault_keys.sql.j2", folders=types, names=names, quote=quote_name)


def _create_judged_table(table: ResultTable, side: str, rules: Rules, key: str):
    """Create `judged_<side>`: each run's fault and outcome by its own campaign's rules. key: SQL
    that is equal for equal faults. Column `counts` is true for valid runs with a fault.
    """
    names = list(table.types(f"runs_{side}"))
    happened = {name: f"coalesce(({event_sql(name, rules)})::BOOLEAN, false)" for name in RATES}
    listed = ", ".join(f"{sql} AS {quote_name('is_' + name)}" for name, sql in happened.items())
    table.run(
        f'CREATE TABLE judged_{side} AS SELECT row, run_id, hash({key}) AS fault, "group"::VARCHAR'
        ' AS "group", verdict::VARCHAR AS verdict, response::VARCHAR AS response, hazard::VARCHAR'
        f" AS hazard, CASE WHEN {happened['cue']} THEN 'cue' ELSE 'no cue' END AS cue,"
        " activated::BOOLEAN AS activated, unintended_mm::DOUBLE AS unintended_mm,"
        f" {VALID_SQL} AND {faulty_sql(names)} AS counts, {listed} FROM runs_{side}"
    )


_VALID = (
    "pairs JOIN judged_first AS a ON a.row = pairs.first JOIN judged_second AS b ON b.row ="
    " pairs.second WHERE a.counts AND b.counts"
)
# A change of the robot may end a run before its fault acts. Such a pair counts.
_ACTING = "(a.activated OR b.activated)"
_JOINED = f"{_VALID} AND {_ACTING}"


def _compare_rates(table: pd.DataFrame, rules: Rules, units: Units | None) -> list[RateChange]:
    # Returns the rate of each event in both folders. table: one row per pair, whose columns begin
    # with a_ (first folder) and b_ (second). units: the faults, to draw for the intervals.
    changes = []
    for name in RATES:
        first, second = (table[f"{side}_is_{name}"].to_numpy(bool) for side in "ab")
        # The difference is second minus first. The p-value is not shown.
        rates = pair_intervals.compare_rates(after=second, before=first, faults=units)[:-1]
        changes.append(RateChange(name, event_meaning(name, rules), *rates))
    return changes


def _transitions(compared: pd.DataFrame, word: str) -> list[Transition]:
    # Counts pairs by the word of one part of the verdict in the first and in the second folder.
    counts = Counter(zip(compared[f"a_{word}"], compared[f"b_{word}"], strict=True))
    words = itertools.product(WORDS[word], repeat=2)
    return [Transition(a, b, counts[a, b]) for a, b in words if counts[a, b]]


def _list_changed_runs(robot: Robot, table: ResultTable, most: int) -> list[RunChange]:
    # Returns the runs whose outcome changed, those whose unintended distance changed most first.
    rows = table.rows(
        "SELECT pairs.first, a.run_id, b.run_id, a.verdict, b.verdict, a.unintended_mm,"
        f" b.unintended_mm FROM {_JOINED} AND (a.verdict <> b.verdict OR a.unintended_mm <>"
        " b.unintended_mm) ORDER BY abs(a.unintended_mm - b.unintended_mm) DESC, a.verdict ="
        f" b.verdict, pairs.first LIMIT {most}"
    )
    if not rows:
        return []
    listed = ", ".join(str(row[0]) for row in rows)
    query_faults = f"SELECT row, COLUMNS('fault.*') FROM runs_first WHERE row IN ({listed})"
    faults, changes = table.frame(query_faults).set_index("row"), []
    # Each quantity has a value of the first and of the second folder.
    for row, *values in rows:
        fault = wording.describe_fault(faults.loc[row].to_dict(), robot)
        run_ids, verdicts, mm = zip(values[::2], values[1::2], strict=True)
        changes.append(RunChange(run_ids, fault, verdicts, mm))
    return changes
