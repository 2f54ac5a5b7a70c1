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
from studies.study import Line, Published, StudyEstimate, read_table

NAME = "seed_burst"
FREE, BURST = "fault_free", "burst"
"""Groups of the campaign whose runs are measured."""
VARIANTS = study.read_variants(NAME)
SHOULDER = 0
EVENTS = 4
"""Bursts that the paper shows. The last one stops the robot."""
STOP = "overdrive"
"""Cause of a stop by the magnitude of the computed DAC command."""
SMALL = 1500.0
"""Counts. A larger constant stops the robot in the first burst."""
STEP = 50.0
"""Counts from one constant to the next."""

EVENT_TICKS = 600
FAULT_TICKS = 300
REACH_TICKS = FAULT_TICKS + 50
"""Ticks after the onset in which the shoulder's farthest point is searched."""
REBOUND_TICKS = 300
"""Ticks after the farthest point."""
JUMP_UM = 100.0
"""Limit of a step of the measured tip in 1 ms, exceeded twice in a row and not in the golden run: a
jump by the published analysis code (DSN 2016).
"""

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
NOWHERE = "at no constant and with no motion"


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
    # Of the fault: DAC counts or um per packet; NaN without a fault.
    value: float
    events: tuple[BurstEvent, ...]
    cause: str  # why the robot stopped, "" if it did not
    false_cues: int  # cues that began outside the events, before the stop


class Bursts(NamedTuple):
    """Runs and their events, as tables with the fields of `BurstRun` and `BurstEvent`."""

    runs: pd.DataFrame  # also the setting, the motion's kind and seed, and the number of events
    events: pd.DataFrame  # also the fields of their runs; index: that of the run

    def where(self, runs: pd.Series) -> "Bursts":
        """Return the runs (bool [runs]) and their events."""
        chosen = self.runs.loc[runs]
        return Bursts(chosen, self.events.loc[self.events.index.isin(chosen.index)])


def tabulate(measured: Mapping[str, Mapping[Motion, Sequence[BurstRun]]]) -> Bursts:
    """Return the tables of runs by setting and motion."""
    rows = [
        (setting, *motion, *run)
        for setting, motions in measured.items()
        for motion, runs in motions.items()
        for run in runs
    ]
    runs = pd.DataFrame(rows, columns=["setting", "kind", "seed", *BurstRun._fields])
    listed = runs.pop("events").explode().dropna()
    events = pd.DataFrame(list(listed), listed.index, columns=[*BurstEvent._fields])
    return Bursts(runs.assign(number=events.groupby(level=0).size()).fillna({"number": 0}), events)


def criteria(bursts: Bursts, published: Published) -> pd.DataFrame:
    """Return which bands of the targets each run meets, bool [runs, A4 and A5 and ALL].

    All four bursts must be inside. A burst that is cut short has no rebound.
    """
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
    """Measure a run from its row of the result table and its series.

    `golden_um`: measured tip of the golden run, um [ticks, 3].
    """
    stopped = row["response"] == "stopped"
    stop = int(row["response_ms"]) if stopped else len(series["fault_active"])
    onsets = [tick for tick in rises(series["fault_active"]) if tick < stop]
    jumps = jump_ticks(series["position"] * 1e6, golden_um)
    false = [
        tick
        for tick in rises(series["cue_force"] > 0.0)
        if tick < stop and not any(onset <= tick < onset + EVENT_TICKS for onset in onsets)
    ]
    return BurstRun(
        group=str(row["group"]),
        value=float(row["fault0_value"]),
        events=tuple(event(series, at, min(at + EVENT_TICKS, stop), jumps) for at in onsets),
        cause=str(row["response_cause"]) if stopped else "",
        false_cues=len(false),
    )


def event(series: Series, onset: int, end: int, jumps: np.ndarray) -> BurstEvent:
    """Measure the burst from tick `onset` until tick `end`. `jumps`: ticks of all jumps of
    the run.
    """
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
    """Return how far (deg) and how long (ms) a joint goes back from the farthest point to which a
    burst drove it; [ticks].
    """
    away = shoulder_deg - shoulder_deg[0]
    far = int(np.argmax(np.abs(away[:REACH_TICKS])))
    back = (away[far] - away[far : far + REBOUND_TICKS]) * np.sign(away[far])
    largest = float(back.max())
    return (largest, float(np.argmax(back))) if largest > 0.0 else (0.0, math.nan)


def jump_ticks(position_um: np.ndarray, golden_um: np.ndarray) -> np.ndarray:
    """Return the ticks at which the second of two consecutive long steps ends; both arguments
    [ticks, 3], um.
    """
    long, usual = (
        np.linalg.norm(np.diff(tip, axis=0), axis=1) > JUMP_UM for tip in (position_um, golden_um)
    )
    over = long & ~usual
    return np.flatnonzero(over[1:] & over[:-1]) + 2


def compare(context: study.Context) -> study.Findings:
    """Measure every run and compare its events with the paper's four."""
    every, published = tabulate(_measured(context)), Published("seed")
    bursts = every.where(every.runs["group"] == BURST)
    met = criteria(bursts, published)
    modelled = bursts.where(bursts.runs["setting"] == MODELLED)
    free = every.runs.loc[(every.runs["group"] == FREE) & (every.runs["setting"] == MODELLED)]
    false_cues = int(free["false_cues"].sum())
    return study.Findings(
        (
            *_acceptance(bursts, met, published),
            *_events(modelled.events.join(modelled.runs), published),
            Line(
                "cue pulses without fault at scale 0.1",
                "",
                published.estimate("false_pulses"),
                StudyEstimate(false_cues, n=len(free), of="runs of 40 s, one a motion"),
                reason="study seed_fault_free looks for them at every scale, with noise",
            ),
        ),
        (
            read_table(NAME, "constants", _constants(modelled, met)),
            read_table(NAME, "bands", _bands(bursts, met)),
        ),
        study.read_notes(NAME),
    )


def _measured(context: study.Context) -> dict[str, dict[Motion, list[BurstRun]]]:
    recorder = Recorder()
    return {
        setting: {motion: _runs(recorder, context, name) for motion, name in names.items()}
        for setting, names in by_setting(VARIANTS).items()
    }


def _runs(recorder: Recorder, context: study.Context, name: str) -> list[BurstRun]:
    """Return each run of a campaign with the fault-free one, which is the first.

    Every run draws its own packets, so the first run is not exactly its golden run. It is only used
    to find steps as long as a jump's, above 100 um. A fault-free tip makes no such step (59 um at
    most in suture and peg_transfer).
    """
    folder = context.folders[name]
    (golden_um,) = recorder.measure(folder, lambda _, series: series["position"] * 1e6, [0])
    return recorder.measure(folder, lambda row, series: run(row, series, golden_um))


def _acceptance(bursts: Bursts, met: pd.DataFrame, published: Published) -> Iterator[Line]:
    """Return, for each band and for all of A4, in how many runs it is met. At least one is
    required, as the constant is unknown.
    """
    runs = bursts.runs.loc[bursts.runs["setting"] == MODELLED]
    published_run = StudyEstimate(1, n=1, of="run, Figures 4 and 5")
    peaks = [
        f"{span(_stop_peaks(part), '.1f')} mm ({name})"
        for name, part in _settings(bursts)
        if name == MODELLED or name.startswith("stop above")
    ]
    stops = (
        f". Bursts that end in a stop have tip error peaks of {', '.join(peaks)}; the paper's has"
        f" {published.value('burst.4.peak'):g} mm. The limit of the check is not stated"
    )
    met = met.loc[runs.index]
    of = f"runs ({runs['value'].nunique()} constants, {len(MOTIONS)} motions)"
    for name, words in ({ALL: "all of A4 holds at once"} | A4 | A5).items():
        values, found = np.unique(runs.loc[met[name], "value"]), int(met[name].sum())
        where = f"{len(values)} constants: {ranges(values)}" if found else NOWHERE
        yield Line(
            f"runs in which {words}",
            "",
            published_run,
            StudyEstimate(found, n=len(runs), of=of),
            (1, math.inf),
            "A5" if name in A5 else "A4",
            where + stops if name == ALL else where,
        )
    over = len(runs), "runs, jumps by the published code's rule"
    jumps = StudyEstimate(int(met["jumps"].sum()), math.nan, math.nan, *over)
    quantity = "runs with four jumps, of which the last ends in the stop"
    yield Line(quantity, "", published_run, jumps)


def _events(events: pd.DataFrame, published: Published) -> Iterator[Line]:
    """Return what accompanies a tip error peak of the published size, for any constant and
    motion.
    """
    low, high = published.band("a4.peak")
    sized = events.loc[events["peak_mm"].between(low, high)]
    sized = sized.assign(force_per_mm=sized["force"] / sized["peak_mm"])
    value = published.value

    def of_three(values: Sequence[float], of: str) -> StudyEstimate:
        return StudyEstimate(float(np.mean(values)), min(values), max(values), 3, of)

    rebounds = [value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    per_mm = [value(f"pulse.{k}.force") / value(f"burst.{k}.peak") for k in (1, 2, 3)]
    read = {
        "rebound_deg": of_three(rebounds, "events read off Figure 4"),
        "rebound_ms": published.estimate("burst.3.rebound_ms"),
        "cue_s": published.estimate("cue.onset"),
        "force_per_mm": of_three(per_mm, "events below the cap, Figures 4 and 5"),
    }
    for field, what, unit, band in (
        ("rebound_deg", "rebound of the shoulder", "deg", "a4.rebound"),
        ("rebound_ms", "time of the rebound", "ms", "a4.rebound_ms"),
        ("cue_s", "cue after the fault's onset", "s", "a5.onset"),
        ("force_per_mm", "peak force over tip error peak", "1/mm", ""),
    ):
        caveat = "" if band else "; no evidence: the cue's gains were read off Figure 5"
        values = sized.dropna(subset=field).groupby(["kind", "seed"], sort=False)[field]
        means = values.apply(lambda of_motion: of_motion.to_numpy().mean())
        every = sized[field].dropna()
        middle = "{:.3g} to {:.3g}".format(*np.percentile(every, (5, 95))) if len(every) else "none"
        yield Line(
            f"{what}, events with a peak of {low:g} to {high:g} mm",
            unit,
            read[field],
            over_kinds(means),
            published.band(band) if band else None,
            band.partition(".")[0].upper(),
            f"middle 90 % of {len(every)} events {middle}{caveat}",
        )


def _settings(bursts: Bursts) -> Iterator[tuple[str, Bursts]]:
    for name in bursts.runs["setting"].unique():
        yield name, bursts.where(bursts.runs["setting"] == name)


def _stop_peaks(bursts: Bursts) -> pd.Series:
    """Return tip error peaks, mm, of bursts that end in a stop, for constants of at most SMALL."""
    runs = bursts.runs.loc[(bursts.runs["cause"] != "") & (bursts.runs["value"].abs() <= SMALL)]
    last = bursts.events.groupby(level=0).last()
    return last.loc[last["cut"] & last.index.isin(runs.index), "peak_mm"]


def _constants(bursts: Bursts, met: pd.DataFrame) -> Iterator[tuple[str | int, ...]]:
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


def _bands(bursts: Bursts, met: pd.DataFrame) -> Iterator[tuple[str | int, ...]]:
    for name, part in _settings(bursts):
        mine = met.loc[part.runs.index]
        counts = (int(count) for count in mine[[*A4, *A5, ALL]].sum())
        most = int(mine[[*A4]].sum(axis=1).max())
        yield name, len(mine), *counts, most, span(_stop_peaks(part), ".1f")


def ranges(values: np.ndarray) -> str:
    """Write ascending constants, with neighbours of one step joined: -200 to -100, +50."""
    parts = np.split(values, np.flatnonzero(np.diff(values) != STEP) + 1)
    return ", ".join(" to ".join(f"{end:+.0f}" for end in np.unique(p[[0, -1]])) for p in parts)


def span(values: Iterable[float], form: str) -> str:
    """Write the least and largest of the finite values."""
    there = pd.Series(values).dropna()
    if there.empty:
        return "–"
    ends = (format(end, form) for end in (there.min(), there.max()))
    return " to ".join(dict.fromkeys(ends))


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
