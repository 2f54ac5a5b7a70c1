"""Study that runs the whole hazard library: outcome classes of every row, severities, and risk by
hazard, class and reports.
"""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pandas as pd

from ravenjax.hazards import expansion, library
from ravenjax.hazards.library import Hazard
from ravenjax.report import wording
from ravenjax.stats.intervals import Estimate
from ravenjax.store import folder
from studies.hazards import maude, risk, safecomp45
from studies.hazards.risk import Pool, PoolRisk
from studies.hazards.safecomp45 import NOT_SIMULATED, HazardOutcome, normal
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    Variant,
    own_line,
    read_notes,
    read_table,
    study,
)

NAME, BASELINE, EVERY_CYCLE = "hazard_library", "library", "every_cycle"
MANIFEST: dict[str, tuple[str, ...]] = {
    "network": ("C01", "C02", "C03", "C05", "C06", "C07", "C08"),
    "get_usb": ("B01", "B02", "B03", "B23"),
    "put_usb": ("B07", "B08", "B10"),
    "put_usb_jumps": ("B11",),
    "in_range": ("C06",),
}
"""Maps published shares of MCPS 2015 to the rows of the library that are injected in the
same way.
"""


def compare(context: Context) -> Findings:
    """Compare every row of the library, and its risk."""
    frame = folder.read_all(context.folders[BASELINE])
    outcomes = safecomp45.hazard_outcomes(frame)
    others = safecomp45.hazard_outcomes(folder.read_all(context.folders[EVERY_CYCLE]))
    values = {one.hazard.id: documented(frame, one.hazard) for one in outcomes}
    fields = ("id", "layer", "title", "source", "expected", "documented_only")
    unrun = [
        [getattr(row, field) for field in fields]
        for row in library.all_hazards()
        if not row.runnable
    ]
    risks = report_risk(risk.counts(frame))
    return Findings(
        lines=tuple(_lines(outcomes, others, Published(NAME))),
        tables=(
            read_table(NAME, "rows", row_rows(outcomes, values)),
            read_table(NAME, "documented", unrun),
            read_table(NAME, "risk", map(pool_row, risks), caveat=maude.CAVEAT),
        ),
        notes=read_notes(NAME),
    )


def report_risk(counts: risk.Counts) -> list[PoolRisk]:
    """Return risk by category of adverse event reports, and of all simulated categories together.
    Show `maude.CAVEAT` beside it.
    """
    pools = [
        Pool(one.name, one.source, tuple(row.id for row in one.rows), one.share)
        for one in maude.reports().category
    ]
    meaning = "all simulated categories, by their shares; a hazard of two categories counts in both"
    return [
        *(risk.by_pool(counts, pool) for pool in pools),
        risk.together(counts, pools, "all", meaning),
    ]


def documented(frame: pd.DataFrame, row: Hazard) -> tuple[int, int]:
    """Return the runs of a row in which all faults have a value that the library documents, and all
    its runs.
    """
    if not row.runnable:
        return 0, 0
    ids = frame["group"].astype(str).str.rpartition("/")[2]
    inside = total = 0
    for group in expansion.expand_group({"name": "library", "hazards": row.id}):
        runs = frame.loc[ids == group["name"].rpartition("/")[2]]
        within = pd.Series(True, runs.index)
        for slot, fault in enumerate(group["fault"]):
            within &= _within(runs[f"fault{slot}_value"], fault.get("value"))
        inside, total = inside + int(within.sum()), total + len(runs)
    return inside, total


def row_rows(
    found: Sequence[HazardOutcome], values: dict[str, tuple[int, int]]
) -> Iterator[tuple[str | int, ...]]:
    """Yield one line per row of the library that is run."""
    for one in found:
        row = one.hazard
        if one.verdict != NOT_SIMULATED:
            yield (
                *(row.id, row.layer, row.title, row.source, one.runs, one.activated),
                *("{} of {}".format(*values[row.id]), normal(row), ", ".join(row.expected_class)),
                *(one.said, one.verdict, one.reason),
            )


def pool_row(one: PoolRisk) -> tuple[str | float, ...]:
    """Return the risk of a category. One without a simulated hazard is listed as such."""
    pool = one.pool
    return (
        *(pool.name, pool.meaning, ", ".join(dict.fromkeys(pool.hazards)) or NOT_SIMULATED),
        "" if math.isnan(pool.weight) else wording.format_percent(pool.weight),
        "" if math.isnan(one.mean) else round(one.mean, 2),
        *map(_mean, (one.injury, one.silent)),
    )


def _within(values: pd.Series, documented_values: object) -> pd.Series:
    """Return which values are among those that a plain group writes, or between the ends of what it
    draws.
    """
    if documented_values is None:
        return values.isna()
    if isinstance(documented_values, dict):
        (kind, numbers), *_ = documented_values.items()
        return (
            values.isin(numbers) if kind == "choice" else values.between(min(numbers), max(numbers))
        )
    listed = (
        documented_values if isinstance(documented_values, list | tuple) else [documented_values]
    )
    return values.isin(listed)


def _lines(
    found: Sequence[HazardOutcome], others: Sequence[HazardOutcome], published: Published
) -> Iterator[Line]:
    runnable = [one for one in found if one.verdict != NOT_SIMULATED]

    def count(quantity: str, holds: Callable[[HazardOutcome], bool]) -> Line:
        value = StudyEstimate(sum(map(holds, runnable)), n=len(runnable), of="rows that can be run")
        return own_line(quantity, "rows", value)

    yield count("rows that ran", lambda one: one.runs > 0)
    yield count("rows with at least one activated run", lambda one: one.activated > 0)
    yield count("rows whose every run was activated", lambda one: 0 < one.runs == one.activated)
    words = {
        "network": "operator's packets: injections with an effect",
        "get_usb": "USB read: injections with an effect",
        "put_usb": "USB write: injections with an effect",
        "put_usb_jumps": "USB write, motor commands: injections with a jump",
        "in_range": "operator's packets in their range: injections with an effect",
    }
    for packets, part in {"": found, ", a packet each cycle": others}.items():
        by_id = {one.hazard.id: one for one in part}
        for key, ids in MANIFEST.items():
            rows = [by_id[name] for name in ids if name in by_id and by_id[name].valid]
            predicted = _manifest(rows, "jump" if key == "put_usb_jumps" else "")
            reason = "published: drawn values; here every value and hazard counts alike"
            quantity = f"{words[key]}{packets}"
            yield Line(quantity, "%", published.estimate(key), predicted, reason=reason)


def _manifest(rows: Sequence[HazardOutcome], name: str) -> StudyEstimate | None:
    """Return the share of activated runs that have a class (""; any except `none` and `message`
    alone).

    Each row counts equally, and the interval is over rows.
    """
    if not rows:
        return None
    hits = [one.counts[name] if name else one.valid - one.without_effect for one in rows]
    runs = [one.valid for one in rows]
    ids = [one.hazard.id for one in rows]
    rate = risk.mean_over(np.divide(hits, runs), ids, np.ones(len(rows)))
    return StudyEstimate(
        100 * rate.value, 100 * rate.low, 100 * rate.high, sum(runs), f"runs of {', '.join(ids)}"
    )


def _mean(mean: Estimate | None) -> str:
    if mean is None:
        return ""
    if math.isnan(mean.low):
        return wording.format_percent(mean.value)
    return (
        f"{wording.format_percent(mean.value)} ({wording.format_percent(mean.low)} to"
        f" {wording.format_percent(mean.high)})"
    )


_PACKETS = Variant(
    EVERY_CYCLE,
    "hazard_library.toml",
    (f"campaign.packets={EVERY_CYCLE}",),
    "And with a packet in each control cycle?",
)
STUDY = study(NAME, (Variant(BASELINE, "hazard_library.toml"), _PACKETS), compare)
