"""Section "After a stop": how long each check took to stop the robot, and how far the tip moved."""

from typing import NamedTuple

from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.report.sections.tables import Quantiles
from ravenjax.stats.intervals import Rate

ALL = "every stop"


class StopRow(NamedTuple):
    """Stops by one check. A fault that was run several times counts once."""

    cause: str
    n: int
    took_ms: Quantiles  # from the fault's first effect to the stop
    off_mm: Quantiles  # largest distance of the tip from its course while the robot was not live
    before: Rate  # runs whose motion was beyond the limit before the stop
    after: Rate  # runs whose motion was beyond the limit only after the stop
    cue_before: Rate
    cue_after: Rate  # cue in the millisecond of the stop or later
    no_cue: Rate
    restarted: Rate  # runs in which the robot went live again while the foot stayed on the pedal


def stop_rows(runs: Runs) -> list[StopRow]:
    """Return a row for all stops, then one for each check that stopped, most frequent first."""
    causes = _count_stops(runs, "response_cause::VARCHAR")
    causes.sort(key=lambda row: (-row.n, row.cause))
    if len(causes) == 1:
        return [causes[0]._replace(cause=f"{ALL}: {causes[0].cause}")]
    return [*_count_stops(runs, f"'{ALL}'"), *causes]


def _count_stops(runs: Runs, by: str) -> list[StopRow]:
    # Returns a row for each value of `by` (SQL). Only runs that a check stopped are counted.
    stop = f"{FACTS}.response_ms"
    moved = f"unintended_ms >= 0 AND unintended_ms <= {stop}"
    is_beyond = run_facts.beyond_sql("unintended_off_mm", runs.manifest.limit_mm, runs.types)
    # In the order of the rates in StopRow: motion beyond the limit before the stop, and only after
    # the stop; cue before the stop, later, and never; robot live again.
    conditions = (
        moved,
        f"NOT ({moved}) AND {is_beyond}",
        f"warned_ms >= 0 AND warned_ms < {stop}",
        f"warned_ms >= {stop}",
        "warned_ms < 0",
        "restart_ms >= 0" if "restart_ms" in runs.types else "false",
    )
    columns = (
        tables.quantiles_sql(f"{stop} - active_ms"),
        tables.quantiles_sql("unintended_off_mm"),
        *(f"count(*) FILTER ({condition})" for condition in conditions),
    )
    counts = tables.class_counts(runs, by, columns, f"{FACTS}.response = 'stopped'")
    rows = []
    for cause, groups, n, took, off_mm, *events in counts:
        rates = [tables.fault_share(runs, k, n, groups) for k in events]
        quantiles = Quantiles(*took), Quantiles(*off_mm)
        rows.append(StopRow(cause or "not recorded", n, *quantiles, *rates))
    return rows


SECTIONS = {"after_stop": lambda runs, _: {"stops": found} if (found := stop_rows(runs)) else None}
