"""Study that simulates the whole hazard library: outcome classes of every hazard, severities, and
risk by hazard, by class and by adverse event reports.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ravenjax.hazards import library
from ravenjax.report import wording
from ravenjax.stats.intervals import Estimate
from ravenjax.store import folder
from studies import study
from studies.hazards import risk, safecomp45
from studies.hazards.risk import PoolRisk
from studies.hazards.safecomp45 import NOT_SIMULATED, HazardOutcome
from studies.study import Cell, Line, Published, StudyEstimate, own_line

NAME, BASELINE, EVERY_CYCLE = "hazard_library", "library", "every_cycle"
DOCUMENTED = ("id", "layer", "title", "source", "expected", "documented_only")


def compare(context: study.Context) -> study.Findings:
    """Compare every row of the library, and its risk."""
    runnable = [row for row in library.all_hazards() if row.runnable]
    frames = [folder.read_all(context.folders[name]) for name in (BASELINE, EVERY_CYCLE)]
    outcomes, others = (safecomp45.hazard_outcomes(frame, runnable) for frame in frames)
    unrun = [
        [getattr(row, field) for field in DOCUMENTED]
        for row in library.all_hazards()
        if not row.runnable
    ]
    counts, pools = risk.counts(frames[0]), risk.report_pools()
    meaning = "all simulated categories, by their shares; a hazard of two categories counts in both"
    risks = [
        *(risk.by_pool(counts, pool) for pool in pools),
        risk.together(counts, pools, "all", meaning),
    ]
    return study.findings(
        NAME,
        _lines(outcomes, others),
        {"rows": map(_row, outcomes), "documented": unrun, "risk": map(_pool_row, risks)},
    )


def _row(one: HazardOutcome) -> tuple[Cell, ...]:
    row = one.hazard
    return (
        *(row.id, row.layer, row.title, row.source, one.runs, one.activated),
        *(", ".join(row.expected_class), one.said, one.verdict, one.reason),
    )


def _pool_row(one: PoolRisk) -> tuple[Cell, ...]:
    pool = one.pool
    return (
        *(pool.name, pool.meaning, ", ".join(dict.fromkeys(pool.hazards)) or NOT_SIMULATED),
        wording.format_percent(pool.weight),
        "" if math.isnan(one.mean) else round(one.mean, 2),
        *map(_percent, (one.injury, one.silent)),
    )


def _percent(mean: Estimate | None) -> str:
    if mean is None:
        return ""
    value, low, high = map(wording.format_percent, mean)
    return value if math.isnan(mean.low) else f"{value} ({low} to {high})"


def _lines(found: Sequence[HazardOutcome], others: Sequence[HazardOutcome]) -> Iterator[Line]:
    counts = {
        "rows that ran": sum(one.runs > 0 for one in found),
        "rows with at least one activated run": sum(one.activated > 0 for one in found),
        "rows whose every run was activated": sum(0 < one.runs == one.activated for one in found),
    }
    for quantity, count in counts.items():
        value = StudyEstimate(count, n=len(found), of="rows that can be run")
        yield own_line(quantity, "rows", value)
    reason, published = (
        "published: drawn values; here every value and hazard counts alike",
        Published(NAME),
    )
    for packets, part in {"": found, ", a packet each cycle": others}.items():
        for key, row in published.numbers.items():
            mine = [one for one in part if one.valid and one.hazard.id in row["rows"]]
            predicted = _manifest(mine, jumps=key == "put_usb_jumps") if mine else None
            what = f"{row['what']}{packets}"
            yield Line(what, "%", published.estimate(key), predicted, reason=reason)


def _manifest(rows: Sequence[HazardOutcome], jumps: bool) -> StudyEstimate:
    """Return the share of activated runs with a jump, or with an effect. Rows count equally."""
    runs, ids = np.array([one.valid for one in rows]), [one.hazard.id for one in rows]
    hits = [one.counts["jump"] if jumps else one.valid - one.without_effect for one in rows]
    rate = risk.mean_over(hits / runs, ids, np.ones(len(rows)))
    percent = (100 * end for end in rate)
    return StudyEstimate(*percent, int(runs.sum()), f"runs of {', '.join(ids)}")


STUDY = study.study(NAME, study.read_variants(NAME), compare)
