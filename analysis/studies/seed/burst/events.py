"""What a burst of the training-simulator paper does, measured on time series: tip error, rebound,
cue, jump, stop.

An event lasts from the onset of the fault for EVENT_TICKS, or until the robot stops: afterwards the
nominal model goes on and the tip error says nothing.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from studies.framework.literature import Published
from studies.framework.series import Row, Series, rises

SHOULDER = 0
EVENTS = 4
"""Bursts that the paper shows, the last of which stops the robot."""
STOP = "overdrive"
"""Cause of a stop by the magnitude of the computed DAC command."""

EVENT_TICKS = 600
FAULT_TICKS = 300
REACH_TICKS = FAULT_TICKS + 50
"""After the onset; until then the shoulder's farthest point is looked for."""
REBOUND_TICKS = 300
"""After the farthest point."""
JUMP_UM = 100.0
"""Step of the measured tip in 1 ms, twice running, the golden run's not: the published analysis
code (DSN 2016).
"""
DRAWN_TICKS = range(-100, 800, 5)
"""Ticks of an event that are drawn, from its onset."""


@dataclasses.dataclass(frozen=True, eq=False)
class EventCurves:
    """An event's series at DRAWN_TICKS, up to the robot's stop."""

    time_s: np.ndarray  # from the onset
    shoulder_deg: np.ndarray  # from where it was at the onset
    error_mm: np.ndarray
    force: np.ndarray  # device units


@dataclasses.dataclass(frozen=True)
class BurstEvent:
    """What one burst did."""

    onset_ms: int  # of the run
    peak_mm: float  # largest tip error, measured tip to nominal model
    cut: bool  # the robot stopped in it
    rebound_deg: float  # of the shoulder, from its farthest point back; NaN where cut
    rebound_ms: float  # NaN also where nothing goes back
    cue_s: float  # onset of the cue after that of the fault, NaN: none
    force: float  # largest, device units
    jumped: bool  # by the rule of the published analysis code
    curves: EventCurves | None = None


@dataclasses.dataclass(frozen=True)
class BurstRun:
    """One run of the campaign."""

    group: str
    value: float  # of the fault: DAC counts or um a packet; NaN without
    events: tuple[BurstEvent, ...]
    cause: str  # why the robot stopped, "" if it did not
    stop_ms: int  # when, -1: never
    false_cues: int  # cues that began outside the events, before the stop
    same_cue: bool  # the campaign's first cue is the series' own, to the millisecond


@dataclasses.dataclass(frozen=True)
class Criteria:
    """The bands of the acceptance targets, each as a test of a run."""

    tests: dict[str, Callable[[BurstRun], bool]]  # A4 first
    a4: tuple[str, ...]

    def all_of_a4(self, run: BurstRun) -> bool:
        """Whether the run meets every test of target A4."""
        return all(self.tests[name](run) for name in self.a4)


def criteria(published: Published) -> Criteria:
    """The bands of the file of published numbers, each asked of all four bursts; one cut short
    has no rebound.
    """
    bands = {
        name: published.band(name)
        for name in ("a4.peak", "a4.rebound", "a4.rebound_ms", "a5.onset")
    }

    def within(name: str, of: Callable[[BurstEvent], float]) -> Callable[[BurstRun], bool]:
        low, high = bands[name]

        def holds(run: BurstRun) -> bool:
            values = [of(event) for event in run.events if "rebound" not in name or not event.cut]
            return len(run.events) == EVENTS and all(low <= value <= high for value in values)

        return holds

    a4: dict[str, Callable[[BurstRun], bool]] = {
        "four bursts": lambda run: len(run.events) == EVENTS,
        "peaks": within("a4.peak", lambda event: event.peak_mm),
        "rebounds": within("a4.rebound", lambda event: event.rebound_deg),
        "rebound times": within("a4.rebound_ms", lambda event: event.rebound_ms),
        "stop in the fourth": lambda run: (
            len(run.events) == EVENTS and run.cause == STOP and run.events[-1].cut
        ),
    }
    return Criteria(a4 | {"cue onsets": within("a5.onset", lambda event: event.cue_s)}, tuple(a4))


def run(row: Row, series: Series, golden_um: np.ndarray, drawn: bool = False) -> BurstRun:
    """Measure a run by its row of the result table and its series.

    golden_um: measured tip of the golden run, um [ticks, 3]. drawn: keep the series of its events
    for a figure.
    """
    active = np.asarray(series["fault_active"], bool)
    end = len(active)
    stopped = row["response"] == "stopped"
    stop = int(row["response_ms"]) if stopped else end
    onsets = [tick for tick in rises(active) if tick < stop]
    jumps = jump_ticks(series["position"] * 1e6, golden_um)
    pulses = rises(series["cue_force"] > 0.0)
    outside = [
        t
        for t in pulses
        if t < stop and not any(onset <= t < onset + EVENT_TICKS for onset in onsets)
    ]
    return BurstRun(
        group=str(row["group"]),
        value=float(row["fault0_value"]),
        events=tuple(
            dataclasses.replace(
                event(series, onset, min(onset + EVENT_TICKS, stop), jumps),
                curves=_drawn(series, onset, stop) if drawn else None,
            )
            for onset in onsets
        ),
        cause=str(row["response_cause"]) if stopped else "",
        stop_ms=stop if stopped else -1,
        false_cues=len(outside),
        same_cue=int(row["cue0_first_ms"]) == (pulses[0] if pulses else -1),
    )


def event(series: Series, onset: int, end: int, jumps: np.ndarray) -> BurstEvent:
    """The burst from tick `onset` on, watched until tick `end`; `jumps`: ticks of all jumps of
    the run.
    """
    force = series["cue_force"][onset:end]
    felt = np.flatnonzero(force > 0.0)
    shoulder = np.degrees(series["jpos"][onset:end, SHOULDER].astype(float))
    cut = end - onset < EVENT_TICKS
    back_deg, back_ms = (math.nan, math.nan) if cut else rebound(shoulder)
    return BurstEvent(
        onset_ms=onset,
        peak_mm=float(series["tip_error_mm"][onset:end].max()),
        cut=cut,
        rebound_deg=back_deg,
        rebound_ms=back_ms,
        cue_s=felt[0] * 1e-3 if len(felt) else math.nan,
        force=float(force.max()),
        jumped=bool(((jumps >= onset) & (jumps < end)).any()),
    )


def rebound(shoulder_deg: np.ndarray) -> tuple[float, float]:
    """How far (deg) and how long (ms) a joint goes back from the farthest point that a burst
    drove it to; [ticks].
    """
    away = shoulder_deg - shoulder_deg[0]
    far = int(np.argmax(np.abs(away[:REACH_TICKS])))
    back = (away[far] - away[far : far + REBOUND_TICKS]) * np.sign(away[far])
    largest = float(back.max())
    return (largest, float(np.argmax(back))) if largest > 0.0 else (0.0, math.nan)


def jump_ticks(position_um: np.ndarray, golden_um: np.ndarray) -> np.ndarray:
    """Ticks at which the second of two long steps in a row ends; both [ticks, 3], um."""
    long, usual = (
        np.linalg.norm(np.diff(tip, axis=0), axis=1) > JUMP_UM for tip in (position_um, golden_um)
    )
    over = long & ~usual
    return np.flatnonzero(over[1:] & over[:-1]) + 2


def _drawn(series: Series, onset: int, stop: int) -> EventCurves:
    ticks = np.array(DRAWN_TICKS)
    ticks = ticks[ticks + onset < stop]
    shoulder = np.degrees(series["jpos"][:, SHOULDER].astype(float))
    return EventCurves(
        ticks / 1e3,
        shoulder[ticks + onset] - shoulder[onset],
        series["tip_error_mm"][ticks + onset],
        series["cue_force"][ticks + onset],
    )
