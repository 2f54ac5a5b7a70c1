"""Defines events of runs as SQL expressions over columns of the result table, for DuckDB.

Stop rules, reports and searches use the same events, on Parquet files, Arrow tables and DataFrames.
"""

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ravenjax import resources
from ravenjax.outcomes.verdict import LIMIT_MM, TOLD, UNTOLD

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa


class Rules(NamedTuple):
    """The settings of a campaign on which the definitions of outcomes depend."""

    cue: int = 0  # number of the haptic set for the verdict
    threshold_mm: float = LIMIT_MM  # threshold of this haptic set
    jump: str = "jump_code"  # column of the rule for jumps
    limit_mm: float = LIMIT_MM  # unintended motion above which a run has a hazard
    built_in: str = "response"  # column with the response of the built-in checks alone
    stopping: tuple[tuple[int, str], ...] = ()  # numbers and names of detectors that stop the robot
    harms: tuple[str, ...] = ()  # harms that the campaign defines and that count, as text
    limit_counts: bool = True  # unintended motion beyond the limit counts as harm

    @property
    def harm(self) -> str:
        """What counts as harm, in words."""
        own = [f"harm {text.partition(':')[0]}" for text in self.harms]
        return " or ".join(["unintended motion"] * self.limit_counts + own)


def _sql_list(words: Iterable[str]) -> str:
    # Returns words as the right side of SQL's IN: "('limited', 'silent')".
    return "(" + ", ".join(f"'{word}'" for word in words) + ")"


def beyond_golden_sql(column: str) -> str:
    """Return SQL for the time of an event in ms; -1 if the event never occurs, or if it had
    occurred in the golden run by that time. The SQL equals `verdict.beyond_golden`.
    """
    ms, golden = f'"{column}"', f'"golden_{column}"'
    return f"CASE WHEN {ms} >= 0 AND NOT ({golden} >= 0 AND {golden} <= {ms}) THEN {ms} ELSE -1 END"


def check_ms_sql(name: str) -> str:
    """Return SQL for the first time at which a check acted more than in the golden run; -1: never.
    The SQL equals `verdict.classify_responses`.
    """
    ms = f'"check_{name}_first_ms"'
    more_often = f'"check_{name}_count" > "golden_check_{name}_count"'
    sooner_ms = beyond_golden_sql(f"check_{name}_first_ms")
    # If the check tripped only more often, its first trip may be that of the golden run. The time
    # of the added trip is unknown, but it is not before the fault.
    later_ms = f"greatest({ms}, first_active_ms)"
    return f"CASE WHEN ({sooner_ms}) >= 0 THEN {ms} WHEN {more_often} THEN {later_ms} ELSE -1 END"


EVENTS: dict[str, dict[str, str]] = resources.read_tables(__file__, "events.toml")
"""Meaning and SQL of each event."""

TOLD_SQL = f"response IN {_sql_list(TOLD)}"

UNWATCHED = (
    "but the cable tensions of this robot are unknown; for a Raven-II write"
    " campaign.parameter_set = 'power_consistent'"
)
"""Reason why a table may lack the event `cable_overload`."""

VALID_SQL = "failed = ''"


def event_sql(name: str, rules: Rules) -> str:
    """Return the SQL expression of an event for a campaign's rules."""
    return EVENTS[name]["sql"].format(
        untold=_sql_list(UNTOLD),
        told=_sql_list(TOLD),
        cue_ms=beyond_golden_sql(f"cue{rules.cue}_first_ms"),
        cable_overload_ms=beyond_golden_sql("cable_overload_first_ms"),
        jump=rules.jump,
        built_in=rules.built_in,
    )


def event_meaning(name: str, rules: Rules) -> str:
    """Return the meaning of an event as text, with the limits of the campaign."""
    note = describe_harms(rules) if "unintended motion" in EVENTS[name]["sql"] else ""
    limits = {"limit": f"{rules.limit_mm:g} mm", "threshold": f"{rules.threshold_mm:g} mm"}
    return f"{EVENTS[name]['meaning'].format(**limits)} {note}".rstrip()


def describe_harms(rules: Rules) -> str:
    """Return as text the harms that the campaign defines and that count; "" if there are none."""
    return f"({'or ' * rules.limit_counts}{' or '.join(rules.harms)})" if rules.harms else ""


def name_harm(text: str, rules: Rules, own: Iterable[str] = ()) -> str:
    """Return a text with "unintended motion" replaced by the harms that the campaign defines, if
    any. own: words of the user, in which nothing is replaced.
    """
    if not rules.harms:
        return text
    # Group 1 of the pattern matches the user's words, which are kept. (?!) matches nothing.
    kept = "|".join(map(re.escape, own)) or "(?!)"
    motion = r"\b(?:[Aa]n )?[Uu]nintended(?: |<br>)motions?(?: over [\d.]+ mm)?"
    text = re.sub(f"({kept})|{motion}", lambda match: match[1] or rules.harm, text)
    return re.sub(r"the motion (reache[sd]|exceed(s|ed)) [\d.]+ mm", "the harm began", text)


def event_columns(names: Sequence[str], rules: Rules) -> list[str]:
    """Return the columns of the result table that these events need, and `failed`."""
    sql = " ".join(event_sql(name, rules) for name in names)
    # Texts in quotes are values, and words in upper case are SQL. All other words are columns.
    columns = re.findall(r"[a-z_][a-z0-9_]*", re.sub(r"'[^']*'", "", sql))
    return list(dict.fromkeys(["failed", *columns]))


def events_happened(
    table: "pa.Table", names: Sequence[str], rules: Rules, valid: str = VALID_SQL
) -> "np.ndarray":
    """Return which rows are valid, and in which rows each event happened: bool [1 + names, rows].
    The first row of the result is for `valid`, an SQL expression; the next rows are for `names`.
    Events of rows that are not valid have no meaning. table: Arrow table with `event_columns`.
    """
    import duckdb
    import numpy as np

    conditions = [valid, *(event_sql(name, rules) for name in names)]
    columns = [f"coalesce(({sql})::BOOLEAN, false) AS e{k}" for k, sql in enumerate(conditions)]
    with duckdb.connect(config={"threads": 1}) as connection:
        connection.register("runs", table)
        values = connection.execute(f"SELECT {', '.join(columns)} FROM runs").fetchnumpy()
    return np.array([np.asarray(column, bool) for column in values.values()])
