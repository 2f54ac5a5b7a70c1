"""Study: how often does the published cue come without a fault, by motion and scale, with generated
and with recorded hands?

A new cue counts only after the tip was within the threshold for AWAY_MS. Runs in which the
overdrive check limits a command are counted separately, because the check then causes the distance
from the nominal model. A run counts from its pedal-down until it stops.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.units import MIN_UNITS, group_units, ratio_band
from studies import study
from studies.cells import plain
from studies.dsn16 import recording
from studies.runs import DEFAULT_SCALE, MOTIONS, SCALE
from studies.series import Recorder, Row, Series
from studies.study import StudyEstimate

NAME = "false_cues"
THRESHOLDS_MM, AWAY_MS, REST_MS = (2.0, 3.0), 250, 500
"""REST_MS: time for which hands rest at the beginning of every motion."""


def onsets(active: np.ndarray) -> int:
    """Return the number of cues in `active`, bool [ticks]. Pauses up to AWAY_MS do not count."""
    ticks = np.flatnonzero(active)
    return int(len(ticks) > 0) + int((np.diff(ticks) > AWAY_MS).sum())


def measure(row: Row, series: Series) -> dict[str, Any]:
    """Measure a run: cues, largest distance from the model, root mean square speed of the tip."""
    stop = int(row["check_estop_first_ms"])
    error = series["tip_error_mm"][REST_MS : stop if stop >= 0 else None]
    tip = series["tip"][REST_MS : REST_MS + len(error)]
    steps = np.diff(tip[::10], axis=0)
    return {
        "scale": float(row[SCALE]),
        "hours": len(error) / 3.6e6,
        "peak_mm": float(error.max(initial=0.0)),
        "mm_s": float(np.sqrt((steps**2).sum(axis=1).mean()) * 1e5),
        "clipped": int(row["check_overdrive_clip_count"]) > 0 or stop >= 0,
        **{f"cues of {mm:g} mm": onsets(error > mm) for mm in THRESHOLDS_MM},
    }


def rate(runs: pd.DataFrame, mm: float) -> StudyEstimate:
    """Return cues per hour. The interval is exact Poisson for a count of 0 or few recordings."""
    counts, hours = runs[f"cues of {mm:g} mm"], runs["hours"].to_numpy()
    exact, among = alarm_rate(int(counts.sum()), float(hours.sum())), group_units(runs["recording"])
    low, high = exact.low, exact.high
    if exact.count and among.count >= MIN_UNITS:
        _, low, high = ratio_band(counts, hours, among)
    of = f"cues in {hours.sum():.2f} h of {among.count} recordings"
    return StudyEstimate(exact.per_hour, float(low), float(high), exact.count, of)


def compare(context: study.Context) -> study.Findings:
    """Count cues by motion and scale."""
    recorder = Recorder()
    parts = [
        pd.DataFrame(recorder.measure(folder, measure)).assign(
            kind=name.rpartition("_")[0], recording=name
        )
        for name, folder in context.folders.items()
    ]
    runs = pd.concat(parts, ignore_index=True)
    absent = "" if set(runs["kind"]) - set(MOTIONS) else f" Set {recording.DATA}."
    return study.findings(NAME, _lines(runs), {"motions": _rows(runs)}, absent=absent)


def _lines(runs: pd.DataFrame) -> Iterator[study.Line]:
    at = runs.loc[np.isclose(runs["scale"], DEFAULT_SCALE) & ~runs["clipped"]]
    generated = at["kind"].isin(MOTIONS)
    groups = {"generated motion": generated, "recorded hands": ~generated}
    groups |= {kind: at["kind"] == kind for kind in MOTIONS}
    for words, mine in groups.items():
        for mm in THRESHOLDS_MM if mine.any() else ():
            quantity = f"{words}: cues of {mm:g} mm without a fault, scale {DEFAULT_SCALE:g}"
            yield study.own_line(quantity, "1/h", rate(at.loc[mine], mm))


def _rows(runs: pd.DataFrame) -> Iterator[tuple[str | float, ...]]:
    recorded = (~runs["kind"].isin(MOTIONS)).rename("recorded")
    for (_, kind, scale, clipped), mine in runs.groupby(
        [recorded, "kind", runs["scale"].round(3), "clipped"]
    ):
        rates = [rate(mine, mm) for mm in THRESHOLDS_MM]
        yield (
            *(kind, scale, "yes" if clipped else "", len(mine)),
            *(round(mine["hours"].sum(), 3), f"{mine['mm_s'].mean():.1f}"),
            f"{mine['peak_mm'].max():.2f}",
            *(f"{plain(cues)}; {cues.n}" for cues in rates),
        )


STUDY = study.study(NAME, study.read_variants(NAME), compare)
