"""Events of runs, each one expression over columns of the result table that DuckDB evaluates.

One definition serves stop rules, report and search, on Parquet files, Arrow tables and DataFrames
alike.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ravenjax.outcomes.verdict import LIMIT_MM, TOLD, UNTOLD

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa


class Rules(NamedTuple):
    """What a campaign chose of the definitions."""

    cue: int = 0  # haptic set of the verdict
    threshold_mm: float = LIMIT_MM  # its own
    jump: str = "jump_code"  # column of the jump rule
    limit_mm: float = LIMIT_MM  # of hazards
    built_in: str = "response"  # column of what the built-in checks did by themselves
    stopping: tuple[
        tuple[int, str], ...
    ] = ()  # number and name of each detector that presses the E-stop


class Event(NamedTuple):
    """Something that happened in a run or did not."""

    name: str
    meaning: str  # continues "a run in which ..."; {limit} and {threshold} in mm
    sql: str  # over columns of the result table; {cue}, {jump} and {built_in} of the rules


def _among(words: Iterable[str]) -> str:
    return "(" + ", ".join(f"'{word}'" for word in words) + ")"


def beyond_golden_sql(column: str) -> str:
    """Time of what came first, -1 where it never came or the golden run had it by then: as
    `verdict.beyond_golden`.
    """
    own, golden = f'"{column}"', f'"golden_{column}"'
    return (
        f"CASE WHEN {own} >= 0 AND NOT ({golden} >= 0 AND {golden} <= {own}) THEN {own} ELSE -1 END"
    )


def check_ms_sql(name: str) -> str:
    """When a check first did what it does not in the golden run, -1 if never: as
    `verdict.responses`.
    """
    own = f'"check_{name}_first_ms"'
    more = f'"check_{name}_count" > "golden_check_{name}_count"'
    sooner = beyond_golden_sql(f"check_{name}_first_ms")
    return (
        f"CASE WHEN ({sooner}) >= 0 THEN {own} WHEN {more} THEN greatest({own}, first_active_ms)"
        " ELSE -1 END"
    )


CUE_MS = beyond_golden_sql("cue{cue}_first_ms")
"""When the cue came that the golden run did not have; -1 if never."""

UNTOLD_SQL = f"response IN {_among(UNTOLD)}"
TOLD_SQL = f"response IN {_among(TOLD)}"

_ALL = (
    Event(
        "evades",
        "no check told anyone, and the live robot made an unintended motion of more than {limit}",
        f"{UNTOLD_SQL} AND hazard = 'unintended motion'",
    ),
    Event(
        "evades_built_in",
        "no built-in check told anyone by itself, whatever checks and detectors of one's own did,"
        " and the live robot made an unintended motion of more than {limit}",
        f"{{built_in}} IN {_among(UNTOLD)} AND hazard = 'unintended motion'",
    ),
    Event(
        "unintended_motion",
        "the tip was more than {limit} off the golden run, the model and standing still while the"
        " robot was live",
        "hazard = 'unintended motion'",
    ),
    Event(
        "loss_of_motion", "the instrument did not follow the operator", "hazard = 'loss of motion'"
    ),
    Event(
        "false_report",
        "the reported tip was more than {limit} off the true one",
        "hazard = 'false report'",
    ),
    Event("hazard", "there was a hazard of any kind", "hazard <> 'none'"),
    Event("stopped", "a check stopped the robot", "response = 'stopped'"),
    Event("flagged", "a check told a person, and the robot went on", "response = 'flagged'"),
    Event(
        "limited",
        "a check limited a command or dropped a packet and told nobody",
        "response = 'limited'",
    ),
    Event("silent", "no check did anything", "response = 'silent'"),
    Event("told", "a check told a person or stopped the robot", TOLD_SQL),
    Event(
        "cue", "the {threshold} cue came and the golden run had none by then", f"({CUE_MS}) >= 0"
    ),
    Event("jump", "the reported tip jumped by the campaign's jump rule", "{jump}"),
    Event(
        "cable_overload",
        "a cable carried more than its strength and none had by then in the golden run",
        f"({beyond_golden_sql('cable_overload_first_ms')}) >= 0",
    ),
    Event("activated", "the fault changed at least one bit", "activated"),
    Event("diverged", "the robot's course differed from the golden run", "diverged"),
)

UNWATCHED = (
    "but the tensions of this robot's cables are not known: with a Raven-II take"
    " campaign.parameter_set = 'power_consistent'"
)
"""Why a table may have no event `cable_overload`."""

EVENTS: dict[str, Event] = {event.name: event for event in _ALL}

VALID_SQL = "failed = ''"


def sql(name: str, rules: Rules) -> str:
    """The expression of an event under a campaign's rules."""
    return EVENTS[name].sql.format(cue=rules.cue, jump=rules.jump, built_in=rules.built_in)


def meaning(name: str, rules: Rules) -> str:
    """An event in words, with the campaign's own numbers."""
    return EVENTS[name].meaning.format(
        limit=f"{rules.limit_mm:g} mm", threshold=f"{rules.threshold_mm:g} mm"
    )


def columns(names: Sequence[str], rules: Rules) -> list[str]:
    """Columns of the result table that these events and `failed` need."""
    text = " ".join(sql(name, rules) for name in names)
    words = re.findall(r"[a-z_][a-z0-9_]*", re.sub(r"'[^']*'", "", text))
    return list(dict.fromkeys(["failed", *words]))


def happened(table: pa.Table, names: Sequence[str], rules: Rules) -> np.ndarray:
    """Which rows are valid, and of which events each is a case: bool [1 + names, rows]; `valid`
    first.

    table: Arrow, with `columns` of the result table. Of a run without a valid outcome an event says
    nothing.
    """
    import duckdb
    import numpy as np

    select_list = ", ".join(
        f"coalesce(({expression})::BOOLEAN, false) AS e{place}"
        for place, expression in enumerate([VALID_SQL, *(sql(name, rules) for name in names)])
    )
    with duckdb.connect(config={"threads": 1}) as connection:
        connection.register("runs", table)
        rows = connection.execute(f"SELECT {select_list} FROM runs").fetchnumpy()
    return np.array([np.asarray(rows[f"e{place}"], bool) for place in range(1 + len(names))])
