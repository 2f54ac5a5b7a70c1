"""Study of bursts of a constant on the shoulder's DAC (IROS 2016, Figures 4 and 5; targets A4, A5).

The constant is not published. Results are therefore for every constant, or for all bursts of the
published size. A burst is evaluated from the start of the fault for EVENT_TICKS, or until the robot
stops. After a stop the nominal model continues, so the tip error has no meaning.
"""

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from studies import study
from studies.seed.motions import MODELLED, MOTIONS, over_kinds, settings_of
from studies.series import Recorder, Row, Series, rises
from studies.study import Cell, Line, Published, StudyEstimate, read_table

NAME, BURST = "seed_burst", "burst"
"""BURST: group of the campaign whose runs are compared."""
VARIANTS = study.read_variants(NAME)
SHOULDER, EVENTS = 0, 4
"""EVENTS: number of bursts that the paper shows. The robot stops in the last burst."""
STOP, SMALL = "overdrive", 1500.0
"""Cause of a stop by the overdrive check, and counts above which a constant stops the robot in the
first burst.
"""
EVENT_TICKS, FAULT_TICKS, REBOUND_TICKS = 600, 300, 300
REACH_TICKS = FAULT_TICKS + 50
"""Ticks after the onset in which the shoulder's farthest point is searched."""
JUMP_UM = 100.0
"""Limit of a step of the reported tip. A jump exceeds it twice in a row (DSN 2016)."""
A4, A5 = study.read_toml("published/seed.toml")["criteria"].values()
"""Words of the conditions of a run, by column of `criteria`."""
ALL = "all of A4"


def criteria(runs: pd.DataFrame, events: pd.DataFrame, published: Published) -> pd.DataFrame:
    """Return which conditions each run meets with all four bursts, bool [runs, ...].
    `events`: of these runs, each with the index of its run.
    """
    four, cut = runs["number"] == EVENTS, events["cut"]

    def every(holds: pd.Series) -> pd.Series:
        return four & holds.groupby(level=0).all().reindex(runs.index, fill_value=False)

    def within(field: str, band: str) -> pd.Series:
        return events[field].between(*published.band(band))

    last_cut = cut.groupby(level=0).last().reindex(runs.index, fill_value=False)
    met = pd.DataFrame(
        {
            "four bursts": four,
            "peaks": every(within("peak_mm", "a4.peak")),
            "rebounds": every(within("rebound_deg", "a4.rebound") | cut),
            "rebound times": every(within("rebound_ms", "a4.rebound_ms") | cut),
            "stop in the fourth": four & (runs["cause"] == STOP) & last_cut,
            "cue onsets": every(within("cue_s", "a5.onset")),
        }
    )
    return met.assign(**{ALL: met[[*A4]].all(axis=1), "jumps": every(events["jumped"]) & last_cut})


def run(row: Row, series: Series, golden_um: np.ndarray) -> dict[str, Any]:
    """Measure a run. `golden_um`: measured tip of the golden run, um [ticks, 3]."""
    stopped = row["response"] == "stopped"
    stop = int(row["response_ms"]) if stopped else len(series["fault_active"])
    onsets = [tick for tick in rises(series["fault_active"]) if tick < stop]
    jumps = jump_ticks(series["position"] * 1e6, golden_um)
    return {
        "group": str(row["group"]),
        # Of the fault: DAC counts, or um per packet; NaN without a fault
        "value": float(row["fault0_value"]),
        "events": [event(series, at, min(at + EVENT_TICKS, stop), jumps) for at in onsets],
        "cause": str(row["response_cause"]) if stopped else "",
    }


def event(series: Series, onset: int, end: int, jumps: np.ndarray) -> dict[str, Any]:
    """Measure the burst from tick `onset` until tick `end`. `jumps`: ticks of the run's jumps."""
    force = series["cue_force"][onset:end]
    felt = np.flatnonzero(force > 0.0)
    shoulder = np.degrees(series["jpos"][onset:end, SHOULDER].astype(float))
    cut = end - onset < EVENT_TICKS
    back_deg, back_ms = (math.nan, math.nan) if cut else rebound(shoulder)
    return {
        # From the measured tip to the nominal model
        "peak_mm": float(series["tip_error_mm"][onset:end].max()),
        # Whether the robot stopped during the event
        "cut": cut,
        "rebound_deg": back_deg,
        "rebound_ms": back_ms,
        # From the onset of the fault to that of the cue; NaN: no cue
        "cue_s": felt[0] * 1e-3 if len(felt) else math.nan,
        # Device units
        "force": float(force.max()),
        # By the rule of the published analysis code
        "jumped": bool(((jumps >= onset) & (jumps < end)).any()),
    }


def rebound(shoulder_deg: np.ndarray) -> tuple[float, float]:
    """Return how far (deg) and how long (ms) a joint goes back from its farthest point."""
    away = shoulder_deg - shoulder_deg[0]
    far = int(np.argmax(np.abs(away[:REACH_TICKS])))
    back = (away[far] - away[far : far + REBOUND_TICKS]) * np.sign(away[far])
    largest = float(back.max())
    return (largest, float(np.argmax(back))) if largest > 0.0 else (0.0, math.nan)


def jump_ticks(position_um: np.ndarray, golden_um: np.ndarray) -> np.ndarray:
    """Return the ticks at which the second of two long steps ends; arguments [ticks, 3], um."""
    long, usual = (
        np.linalg.norm(np.diff(tip, axis=0), axis=1) > JUMP_UM for tip in (position_um, golden_um)
    )
    over = long & ~usual
    return np.flatnonzero(over[1:] & over[:-1]) + 2


def compare(context: study.Context) -> study.Findings:
    """Measure every run and compare its events with the paper's four."""
    measured, published = pd.DataFrame(_measured(context)), Published("seed")
    runs = measured.loc[measured["group"] == BURST]
    listed = runs["events"].explode().dropna()
    runs = runs.assign(number=runs.pop("events").str.len())
    events = pd.DataFrame(listed.tolist(), listed.index).join(runs)
    met = criteria(runs, events, published)
    modelled, bursts = (part.loc[part["setting"] == MODELLED] for part in (runs, events))
    return study.Findings(
        tuple(_lines(modelled, bursts, met, published)),
        (
            read_table(NAME, "constants", _constants(modelled, bursts, met)),
            read_table(NAME, "bands", _bands(runs, events, met)),
        ),
        study.read_notes(NAME),
    )


def _measured(context: study.Context) -> Iterator[dict[str, Any]]:
    """Yield the runs. Jumps are those that the first run, without a fault, does not make. It draws
    its own packets, but its tip makes no step as long as a jump's.
    """
    recorder = Recorder()
    for name, setting in settings_of(VARIANTS):
        folder = context.folders[name]
        (golden_um,) = recorder.measure(folder, lambda _, series: series["position"] * 1e6, [0])
        for found in recorder.measure(folder, functools.partial(run, golden_um=golden_um)):
            yield setting | found


def _lines(
    runs: pd.DataFrame, events: pd.DataFrame, met: pd.DataFrame, published: Published
) -> Iterator[Line]:
    """Yield in how many runs each condition is met, and rebounds and cues of bursts with a peak of
    the published size. The constant is unknown, so one run with any constant is required.
    """
    published_run = StudyEstimate(1, n=1, of="run, Figures 4 and 5")
    met = met.loc[runs.index]
    of = f"runs ({runs['value'].nunique()} constants, {len(MOTIONS)} motions)"
    for name, words in ({ALL: "all conditions of A4 hold"} | A4 | A5).items():
        constants = runs.loc[met[name], "value"].nunique()
        found = StudyEstimate(int(met[name].sum()), n=len(runs), of=of)
        target, where = "A5" if name in A5 else "A4", f"met with {constants} constants"
        quantity = f"runs in which {words}"
        yield Line(quantity, "", published_run, found, (1, math.inf), target, where)
    of = "runs (jumps by the rule of the published code)"
    jumps = StudyEstimate(int(met["jumps"].sum()), n=len(runs), of=of)
    quantity = "runs with four jumps, the last of which ends in a stop"
    yield Line(quantity, "", published_run, jumps)

    low, high = published.band("a4.peak")
    sized = events.loc[events["peak_mm"].between(low, high)]
    rebounds = [published.value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    ends = float(np.mean(rebounds)), min(rebounds), max(rebounds)
    shown = StudyEstimate(*ends, 3, "bursts read from Figure 4")
    took, onset = map(published.estimate, ("burst.3.rebound_ms", "cue.onset"))
    for band, field, what, unit, read in (
        ("a4.rebound", "rebound_deg", "rebound of the shoulder", "deg", shown),
        ("a4.rebound_ms", "rebound_ms", "time of the rebound", "ms", took),
        ("a5.onset", "cue_s", "cue after the onset of the fault", "s", onset),
    ):
        values = sized.dropna(subset=field).groupby(["kind", "seed"], sort=False)[field]
        means = over_kinds(values.apply(lambda of_motion: of_motion.to_numpy().mean()))
        quantity = f"{what}, bursts with a peak of {low:g} to {high:g} mm"
        target = band.partition(".")[0].upper()
        yield Line(quantity, unit, read, means, published.band(band), target)


def _constants(
    runs: pd.DataFrame, events: pd.DataFrame, met: pd.DataFrame
) -> Iterator[tuple[Cell, ...]]:
    for value, mine in runs.groupby("value"):
        bursts = events.loc[events["value"] == value]
        stops = np.bincount(mine.loc[mine["cause"] != "", "number"], minlength=EVENTS + 1)[1:]
        yield (
            f"{value:+.0f}",
            span(mine["number"], ".0f"),
            " ".join(map(str, stops)) if stops.any() else "none",
            *(span(bursts["peak_mm"], ".1f"), span(bursts["rebound_deg"], ".1f")),
            *(span(bursts["rebound_ms"], ".0f"), span(bursts["cue_s"], ".2f")),
            *(span(bursts.loc[bursts["force"] > 0.0, "force"], ".3f"), int(bursts["jumped"].sum())),
            *(int(count) for count in met.loc[mine.index, [*A4, *A5, ALL]].sum()),
        )


def _bands(
    runs: pd.DataFrame, events: pd.DataFrame, met: pd.DataFrame
) -> Iterator[tuple[Cell, ...]]:
    last = events.groupby(level=0).last()
    small = last.loc[last["cut"] & (last["cause"] != "") & (last["value"].abs() <= SMALL)]
    for setting, mine in runs.groupby("setting", sort=False):
        bands = met.loc[mine.index]
        counts = (int(count) for count in bands[[*A4, *A5, ALL]].sum())
        most = int(bands[[*A4]].sum(axis=1).max())
        stopped = small.loc[small["setting"] == setting, "peak_mm"]
        yield str(setting), len(mine), *counts, most, span(stopped, ".1f")


def span(values: pd.Series, form: str) -> str:
    """Write the smallest and largest of the values, without NaN."""
    if values.isna().all():
        return "–"
    ends = (format(end, form) for end in (values.min(), values.max()))
    return " to ".join(dict.fromkeys(ends))


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
