"""Study of bursts of a constant on the shoulder's DAC (IROS 2016, Figures 4 and 5; targets A4, A5).

The constant is not published, so no constant is chosen: results are for every constant, or for all
bursts of the published size. A burst is evaluated from the start of the fault for EVENT_TICKS, or
until the robot stops. After a stop the nominal model continues, so the tip error has no meaning.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from studies import study
from studies.seed.motions import MODELLED, MOTIONS, Motion, by_setting, over_kinds
from studies.series import Recorder, Row, Series, rises
from studies.study import Cell, Line, Published, StudyEstimate, read_table

NAME, BURST = "seed_burst", "burst"
"""BURST: group of the campaign whose runs are compared."""
VARIANTS = study.read_variants(NAME)
SHOULDER, EVENTS = 0, 4
"""EVENTS: bursts that the paper shows. The last one stops the robot."""
STOP, SMALL = "overdrive", 1500.0
"""Cause of a stop by the magnitude of the computed DAC command, and counts above which a constant
stops the robot in the first burst.
"""
EVENT_TICKS, FAULT_TICKS, REBOUND_TICKS = 600, 300, 300
REACH_TICKS = FAULT_TICKS + 50
"""Ticks after the onset in which the shoulder's farthest point is searched."""
JUMP_UM = 100.0
"""Limit of a step of the measured tip, exceeded twice in a row by a jump (DSN 2016)."""
A4 = {
    "four bursts": "all four bursts come before the stop, or none stops",
    "peaks": "the tip error peaks of all four are 3 to 7 mm",
    "rebounds": "the rebounds of all are 3 to 7 degrees",
    "rebound times": "the rebounds of all take 100 to 200 ms",
    "stop in the fourth": "the robot stops in the fourth, by the magnitude of the DAC command",
}
A5 = {"cue onsets": "all four have a cue, 0.15 to 0.25 s after their onset"}
"""Columns of `criteria`, in words: what holds in a run."""
ALL = "all of A4"


class BurstEvent(NamedTuple):
    """The effects of one burst."""

    peak_mm: float  # largest tip error, measured tip to nominal model
    cut: bool  # the robot stopped during the event
    rebound_deg: float  # of the shoulder, from its farthest point back; NaN if cut
    rebound_ms: float  # NaN also if nothing goes back
    cue_s: float  # onset of the cue after that of the fault; NaN: none
    force: float  # largest, device units
    jumped: bool  # by the rule of the published analysis code


class BurstRun(NamedTuple):
    """One run of the campaign."""

    group: str
    value: float  # of the fault: DAC counts or um per packet; NaN without a fault
    events: tuple[BurstEvent, ...]
    cause: str  # why the robot stopped, "" if it did not


class Bursts(NamedTuple):
    """Runs and their events, as tables with the fields of `BurstRun` and `BurstEvent`."""

    runs: pd.DataFrame  # also the setting, the motion's kind and seed, and the number of events
    events: pd.DataFrame  # index: that of the run

    def where(self, runs: pd.Series) -> "Bursts":
        """Return the runs (bool [runs]) and their events."""
        chosen = self.runs.loc[runs]
        return Bursts(chosen, self.events.loc[self.events.index.isin(chosen.index)])


def tabulate(measured: Mapping[str, Mapping[Motion, Sequence[BurstRun]]]) -> Bursts:
    """Return the tables of the runs of BURST by setting and motion."""
    rows = [
        (setting, *motion, *run)
        for setting, motions in measured.items()
        for motion, runs in motions.items()
        for run in runs
        if run.group == BURST
    ]
    runs = pd.DataFrame(rows, columns=["setting", "kind", "seed", *BurstRun._fields])
    listed = runs.pop("events").explode().dropna()
    events = pd.DataFrame(list(listed), listed.index, columns=[*BurstEvent._fields])
    return Bursts(runs.assign(number=events.groupby(level=0).size()).fillna({"number": 0}), events)


def criteria(bursts: Bursts, published: Published) -> pd.DataFrame:
    """Return which bands of the targets each run meets with all four bursts, bool [runs, ...]."""
    events, four = bursts.events, bursts.runs["number"] == EVENTS

    def every(holds: pd.Series) -> pd.Series:
        return four & holds.groupby(level=0).all().reindex(four.index, fill_value=False)

    def within(field: str, band: str) -> pd.Series:
        return events[field].between(*published.band(band))

    last_cut = events["cut"].groupby(level=0).last().reindex(four.index, fill_value=False)
    met = pd.DataFrame(
        {
            "four bursts": four,
            "peaks": every(within("peak_mm", "a4.peak")),
            "rebounds": every(within("rebound_deg", "a4.rebound") | events["cut"]),
            "rebound times": every(within("rebound_ms", "a4.rebound_ms") | events["cut"]),
            "stop in the fourth": four & (bursts.runs["cause"] == STOP) & last_cut,
            "cue onsets": every(within("cue_s", "a5.onset")),
        }
    )
    return met.assign(**{ALL: met[[*A4]].all(axis=1), "jumps": every(events["jumped"]) & last_cut})


def run(row: Row, series: Series, golden_um: np.ndarray) -> BurstRun:
    """Measure a run. `golden_um`: measured tip of the golden run, um [ticks, 3]."""
    stopped = row["response"] == "stopped"
    stop = int(row["response_ms"]) if stopped else len(series["fault_active"])
    onsets = [tick for tick in rises(series["fault_active"]) if tick < stop]
    jumps = jump_ticks(series["position"] * 1e6, golden_um)
    return BurstRun(
        group=str(row["group"]),
        value=float(row["fault0_value"]),
        events=tuple(event(series, at, min(at + EVENT_TICKS, stop), jumps) for at in onsets),
        cause=str(row["response_cause"]) if stopped else "",
    )


def event(series: Series, onset: int, end: int, jumps: np.ndarray) -> BurstEvent:
    """Measure the burst from tick `onset` until tick `end`. `jumps`: ticks of the run's jumps."""
    force = series["cue_force"][onset:end]
    felt = np.flatnonzero(force > 0.0)
    shoulder = np.degrees(series["jpos"][onset:end, SHOULDER].astype(float))
    cut = end - onset < EVENT_TICKS
    back_deg, back_ms = (math.nan, math.nan) if cut else rebound(shoulder)
    return BurstEvent(
        peak_mm=float(series["tip_error_mm"][onset:end].max()),
        cut=cut,
        rebound_deg=back_deg,
        rebound_ms=back_ms,
        cue_s=felt[0] * 1e-3 if len(felt) else math.nan,
        force=float(force.max()),
        jumped=bool(((jumps >= onset) & (jumps < end)).any()),
    )


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
    bursts, published = tabulate(_measured(context)), Published("seed")
    met = criteria(bursts, published)
    modelled = bursts.where(bursts.runs["setting"] == MODELLED)
    return study.Findings(
        (*_acceptance(modelled.runs, met, published), *_events(modelled, published)),
        (
            read_table(NAME, "constants", _constants(modelled, met)),
            read_table(NAME, "bands", _bands(bursts, met)),
        ),
        study.read_notes(NAME),
    )


def _measured(context: study.Context) -> dict[str, dict[Motion, list[BurstRun]]]:
    """Return the runs by setting and motion. Jumps are those that the first run, without a fault,
    does not make. It draws its own packets, but its tip makes no step as long as a jump's.
    """
    recorder = Recorder()

    def runs(name: str) -> list[BurstRun]:
        folder = context.folders[name]
        (golden_um,) = recorder.measure(folder, lambda _, series: series["position"] * 1e6, [0])
        return recorder.measure(folder, lambda row, series: run(row, series, golden_um))

    return {
        setting: {motion: runs(name) for motion, name in names.items()}
        for setting, names in by_setting(VARIANTS).items()
    }


def _acceptance(runs: pd.DataFrame, met: pd.DataFrame, published: Published) -> Iterator[Line]:
    """Yield in how many runs each band is met. One is required, as the constant is unknown."""
    published_run = StudyEstimate(1, n=1, of="run, Figures 4 and 5")
    met = met.loc[runs.index]
    of = f"runs ({runs['value'].nunique()} constants, {len(MOTIONS)} motions)"
    for name, words in ({ALL: "all of A4 holds at once"} | A4 | A5).items():
        constants = runs.loc[met[name], "value"].nunique()
        found = StudyEstimate(int(met[name].sum()), n=len(runs), of=of)
        target, where = "A5" if name in A5 else "A4", f"with {constants} constants"
        quantity = f"runs in which {words}"
        yield Line(quantity, "", published_run, found, (1, math.inf), target, where)
    jumps = StudyEstimate(
        int(met["jumps"].sum()), n=len(runs), of="runs, jumps by the published code's rule"
    )
    quantity = "runs with four jumps, of which the last ends in the stop"
    yield Line(quantity, "", published_run, jumps)


def _events(bursts: Bursts, published: Published) -> Iterator[Line]:
    """Yield what accompanies a peak of the published size, for any constant and motion."""
    low, high = published.band("a4.peak")
    events = bursts.events.join(bursts.runs[["kind", "seed"]])
    sized = events.loc[events["peak_mm"].between(low, high)]
    rebounds = [published.value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    ends = float(np.mean(rebounds)), min(rebounds), max(rebounds)
    for field, what, unit, read, band in (
        (
            *("rebound_deg", "rebound of the shoulder", "deg"),
            *(StudyEstimate(*ends, 3, "events read off Figure 4"), "a4.rebound"),
        ),
        (
            *("rebound_ms", "time of the rebound", "ms"),
            *(published.estimate("burst.3.rebound_ms"), "a4.rebound_ms"),
        ),
        (
            *("cue_s", "cue after the fault's onset", "s"),
            *(published.estimate("cue.onset"), "a5.onset"),
        ),
    ):
        values = sized.dropna(subset=field).groupby(["kind", "seed"], sort=False)[field]
        means = over_kinds(values.apply(lambda of_motion: of_motion.to_numpy().mean()))
        quantity = f"{what}, events with a peak of {low:g} to {high:g} mm"
        target = band.partition(".")[0].upper()
        yield Line(quantity, unit, read, means, published.band(band), target)


def _stop_peaks(bursts: Bursts) -> pd.Series:
    """Return tip error peaks, mm, of bursts that end in a stop, for constants of at most SMALL."""
    runs = bursts.runs.loc[(bursts.runs["cause"] != "") & (bursts.runs["value"].abs() <= SMALL)]
    last = bursts.events.groupby(level=0).last()
    return last.loc[last["cut"] & last.index.isin(runs.index), "peak_mm"]


def _constants(bursts: Bursts, met: pd.DataFrame) -> Iterator[tuple[Cell, ...]]:
    for value in np.unique(bursts.runs["value"]):
        runs, events = bursts.where(bursts.runs["value"] == value)
        stops = np.bincount(
            runs.loc[runs["cause"] != "", "number"].astype(int), minlength=EVENTS + 1
        )[1:]
        yield (
            f"{value:+.0f}",
            span(runs["number"], ".0f"),
            " ".join(map(str, stops)) if stops.any() else "none",
            *(span(events["peak_mm"], ".1f"), span(events["rebound_deg"], ".1f")),
            *(span(events["rebound_ms"], ".0f"), span(events["cue_s"], ".2f")),
            *(span(events.loc[events["force"] > 0.0, "force"], ".3f"), int(events["jumped"].sum())),
            *(int(count) for count in met.loc[runs.index, [*A4, *A5, ALL]].sum()),
        )


def _bands(bursts: Bursts, met: pd.DataFrame) -> Iterator[tuple[Cell, ...]]:
    for name in bursts.runs["setting"].unique():
        part = bursts.where(bursts.runs["setting"] == name)
        mine = met.loc[part.runs.index]
        counts = (int(count) for count in mine[[*A4, *A5, ALL]].sum())
        most = int(mine[[*A4]].sum(axis=1).max())
        yield name, len(mine), *counts, most, span(_stop_peaks(part), ".1f")


def span(values: Iterable[float], form: str) -> str:
    """Write the least and largest of the finite values."""
    there = pd.Series(values).dropna()
    if there.empty:
        return "–"
    ends = (format(end, form) for end in (there.min(), there.max()))
    return " to ".join(dict.fromkeys(ends))


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
