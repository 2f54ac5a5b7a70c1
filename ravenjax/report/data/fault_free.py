"""Counts false cues and false alarms in fault-free motion.

Fault-free motions are the golden runs of a campaign and the runs in its folder fault_free. Each
motion contributes at most one cue or alarm, and its time counts only until then. A cue that stops
and starts again therefore does not raise the rate.
"""

import math
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.store import schema
from ravenjax.store.access import query
from ravenjax.store.access.fault_free import UNVARIED, Companions
from ravenjax.store.access.query import ResultTable, quote_name
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.checks import OWN

TABLE = "motions"
MS_PER_HOUR = 3.6e6
_CHECKS = re.compile(rf"golden_check_(?!{OWN})")
"""Columns of trips of built-in checks. The report gives no false-alarm rate for these."""
_ALARM = re.compile(r"detector\d+_threshold\d+_first_ms")


class Motions(NamedTuple):
    """Different fault-free motions. Golden runs of one robot and operator count once."""

    # Database with the table TABLE: operator, length_ms, golden_..., first alarms of detectors.
    table: ResultTable
    count: int
    hours: float  # in pedal-down
    hands: int  # number of different hand motions
    beside: Companions

    def count_motions(self, condition: str) -> int:
        """Return the number of motions that fulfil a condition over their `golden_` columns."""
        (count,) = self.table.row(f"SELECT count(*) FILTER ({condition}) FROM {TABLE}")
        return count

    def count_with_event(self, column: str) -> int:
        """Return the number of motions with an event. column: time of the first event, -1: none."""
        return self.count_motions(f"{quote_name(column)} >= 0")

    def first_rate(self, event: str, first_ms: str) -> AlarmRate | None:
        """Return the number of motions with an alarm, divided by the hours in pedal-down, in which
        each motion counts until its alarm. Return None without such hours.

        event: SQL condition of the motions with an alarm. first_ms: SQL for the time of the alarm;
        NULL where the time is unknown, and then the whole motion counts.
        Pedal-down time is assumed to be spread evenly over a motion.
        """
        # The share of the motion's time that counts, and as much of its time in pedal-down.
        share = f"CASE WHEN {event} THEN coalesce(({first_ms}) / length_ms, 1) ELSE 1 END"
        count, pedal_ms = self.table.row(
            f"SELECT count(*) FILTER ({event}), sum(golden_pedal_down_ms * ({share})) FROM {TABLE}"
        )
        hours = float(pedal_ms or 0) / MS_PER_HOUR
        return alarm_rate(count, hours) if hours else None

    def cue_rate(self, cue: int) -> AlarmRate | None:
        """Return the rate of false cues per hour for one haptic set."""
        first_ms = quote_name(f"golden_cue{cue}_first_ms")
        return self.first_rate(f"{first_ms} >= 0", first_ms)


def fault_free_command(folder: Path, manifest: Manifest, hours: float) -> str | None:
    """Return the command that computes these hours of motion; None if none can be generated."""
    operator = manifest.config.get("operator") or {}
    if operator.get("file") or operator.get("motion") in UNVARIED:
        return None
    return f"ravenjax fault-free {shlex.quote(str(folder))} {rounded_up(hours):g}"


def rounded_up(hours: float) -> float:
    """Round up to two significant digits."""
    step = 10.0 ** (math.floor(math.log10(hours)) - 1)
    return round(math.ceil(hours / step * (1 - 1e-9)) * step, 12)


def make_fault_free_table(
    table: ResultTable, names: Sequence[str], source: str, end: str, beside: Companions
) -> Motions:
    """Create TABLE, which has a row for each different fault-free motion.

    source: table of a campaign's runs, with the columns `names`, also of their golden runs. end:
    time in ms at which a run ends, a number or a column. beside: results of fault-free runs.
    """
    golden = [name for name in names if name == "operator" or name.startswith("golden_")]
    # The report gives no false-alarm rate for built-in checks.
    golden = [name for name in golden if not _CHECKS.match(name)]
    alarms = [name for name in names if _ALARM.fullmatch(name)]
    columns = [*map(quote_name, golden), f"{end} AS length_ms"]
    # Of golden runs, the times of detectors' alarms are unknown.
    columns += [f"NULL::INTEGER AS {quote_name(name)}" for name in alarms]
    # If `end` is a column, runs with the same golden run may end at different times. Keep the run
    # that ends last. Golden runs are the same if all of these keys are equal.
    if end in names:
        shared = [name for name in names if name.startswith("param:")]
        shared += {"operator", "seed"}.intersection(names)
        keys = ", ".join(map(quote_name, shared))
        source = f"(SELECT * FROM {source} QUALIFY {end} = max({end}) OVER (PARTITION BY {keys}))"
    table.run(f"CREATE TABLE {TABLE} AS SELECT DISTINCT {', '.join(columns)} FROM {source}")
    for path, manifest in beside.motions:
        available = {column.name for column in schema.table_columns(manifest.shape)}
        columns = [_golden_column_sql(name, available) for name in golden]
        columns += [str(manifest.duration_ms), *map(quote_name, alarms)]
        rows = query.of_files(query.whole_parts(path))
        valid = f"SELECT DISTINCT {', '.join(columns)} FROM {rows} WHERE failed = ''"
        table.run(f"INSERT INTO {TABLE} {valid}")
    count, pedal_ms = table.row(f"SELECT count(*), sum(golden_pedal_down_ms) FROM {TABLE}")
    hours = float(pedal_ms or 0) / MS_PER_HOUR
    return Motions(table, count, hours, 1 + len(beside.motions), beside)


def _golden_column_sql(name: str, available: set[str]) -> str:
    # Returns SQL for the column `name` from a table of fault-free runs. Such runs are golden runs
    # themselves, so a column without the prefix `golden_` has the same content.
    for column in (name, name.removeprefix("golden_")):
        if column in available:
            return quote_name(column)
    # Only golden_reaction_ms is missing, because nobody reacts in these runs. -1 means never.
    return "-1"
