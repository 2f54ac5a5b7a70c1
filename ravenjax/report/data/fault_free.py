"""Fault-free motion, in which every cue and alarm is a false one: golden runs of a campaign, and
runs in its folder fault_free.

A rate is of first alarms: a motion counts once, and its time until then. So it is the same for many
short motions and for one long one, and does not rise where a cue that has come flickers.
"""

from __future__ import annotations

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
from ravenjax.store.access.query import ResultTable, quoted
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.checks import OWN

TABLE = "motions"
MS_PER_HOUR = 3.6e6
_CHECKS = re.compile(rf"golden_check_(?!{OWN})")
"""Trips of built-in checks, of which no rate is asked."""
_ALARM = re.compile(r"detector\d+_threshold\d+_first_ms")


class Motions(NamedTuple):
    """Different fault-free motions. Golden runs of one robot and operator are one computation,
    so they count once.
    """

    # with the table TABLE: operator, length_ms, the columns golden_..., first alarms of detectors
    table: ResultTable
    count: int
    hours: float  # in pedal-down
    hands: int  # different motions of the hands among them
    beside: Companions

    def with_event(self, condition: str) -> int:
        """How many fulfil a condition of their `golden_` columns."""
        (count,) = self.table.row(f"SELECT count(*) FILTER ({condition}) FROM {TABLE}")
        return count

    def came(self, column: str) -> int:
        """In how many an event came at all; its column holds when it first did."""
        return self.with_event(f"{quoted(column)} >= 0")

    def first_rate(self, event: str, first_ms: str) -> AlarmRate | None:
        """First alarms per hour in pedal-down until then; None without any time.

        event: a condition of the columns. first_ms: when it came, an expression, NULL where that is
        not known: then all of the motion's time counts. Pedal-down is taken as evenly spread over a
        motion.
        """
        share = f"CASE WHEN {event} THEN coalesce(({first_ms}) / length_ms, 1) ELSE 1 END"
        count, pedal_ms = self.table.row(
            f"SELECT count(*) FILTER ({event}), sum(golden_pedal_down_ms * ({share})) FROM {TABLE}"
        )
        hours = float(pedal_ms or 0) / MS_PER_HOUR
        return alarm_rate(count, hours) if hours else None

    def cue_rate(self, cue: int) -> AlarmRate | None:
        """False cues an hour of one haptic set."""
        first_ms = quoted(f"golden_cue{cue}_first_ms")
        return self.first_rate(f"{first_ms} >= 0", first_ms)


def command(folder: Path, manifest: Manifest, hours: float) -> str | None:
    """The command that computes so many hours of motion beside a result; None where there is no
    other to generate.
    """
    operator = manifest.config.get("operator") or {}
    if operator.get("file") or operator.get("motion") in UNVARIED:
        return None
    return f"ravenjax fault-free {shlex.quote(str(folder))} {rounded_up(hours):g}"


def rounded_up(hours: float) -> float:
    """To two significant digits."""
    step = 10.0 ** (math.floor(math.log10(hours)) - 1)
    return round(math.ceil(hours / step * (1 - 1e-9)) * step, 12)


def make(
    table: ResultTable, names: Sequence[str], source: str, end: str, beside: Companions
) -> Motions:
    """Make TABLE of the golden runs of `source`, rows of a result table with columns `names` and
    runs until `end` (ms, a number or a column), and of the motion beside."""
    golden = [
        name
        for name in names
        if name == "operator" or (name.startswith("golden_") and _CHECKS.match(name) is None)
    ]
    alarms = [name for name in names if _ALARM.fullmatch(name)]
    columns = [*map(quoted, golden), f"{end} AS length_ms"]
    columns += [f"NULL::INTEGER AS {quoted(name)}" for name in alarms]
    if end in names:  # of golden runs that some run ended before their end, the longest part
        own = ", ".join(
            quoted(name)
            for name in names
            if name in ("operator", "seed") or name.startswith("param:")
        )
        source = f"(SELECT * FROM {source} QUALIFY {end} = max({end}) OVER (PARTITION BY {own}))"
    table.run(f"CREATE TABLE {TABLE} AS SELECT DISTINCT {', '.join(columns)} FROM {source}")
    for path, manifest in beside.motions:
        available = {column.name for column in schema.columns(manifest.shape)}
        columns = [_beside(name, available) for name in golden]
        columns += [str(manifest.duration_ms), *map(quoted, alarms)]
        rows = query.of_files(query.whole_parts(path))
        table.run(
            f"INSERT INTO {TABLE} SELECT DISTINCT {', '.join(columns)} FROM {rows} WHERE failed"
            " = ''"
        )
    count, pedal_ms = table.row(f"SELECT count(*), sum(golden_pedal_down_ms) FROM {TABLE}")
    return Motions(
        table, count, float(pedal_ms or 0) / MS_PER_HOUR, 1 + len(beside.motions), beside
    )


def _beside(name: str, available: set[str]) -> str:
    """A column of motions as an expression over fault-free runs, which are golden runs
    themselves.
    """
    own = name.removeprefix("golden_")
    if name not in available and own in available:
        return quoted(own)
    return (
        quoted(name) if name in available else "-1"
    )  # nobody reacts there: what is not known is when somebody did
