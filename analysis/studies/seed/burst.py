"""Study of bursts of a constant on the shoulder's DAC (IROS 2016, Figures 4 and 5; targets A4, A5).

The constant is not published, so none is chosen: statements are about every constant, or about all
events of the published size. An event lasts from the onset of the fault for EVENT_TICKS, or until
the robot stops. After a stop the nominal model continues, and the tip error has no meaning.
"""

import dataclasses
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from studies.seed.motions import MODELLED, MOTIONS, Motion, by_setting, over_kinds
from studies.series import Recorder, Row, Series, rises
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    Table,
    read_notes,
    read_table,
    read_variants,
    study,
)

SHOULDER = 0
EVENTS = 4
"""Bursts that the paper shows. The last one stops the robot."""
STOP = "overdrive"
"""Cause of a stop by the magnitude of the computed DAC command."""

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


@dataclasses.dataclass(frozen=True)
class BurstEvent:
    """The effects of one burst."""

    onset_ms: int  # since the start of the run
    peak_mm: float  # largest tip error, measured tip to nominal model
    cut: bool  # the robot stopped during the event
    rebound_deg: float  # of the shoulder, from its farthest point back; NaN if cut
    rebound_ms: float  # NaN also if nothing goes back
    cue_s: float  # onset of the cue after that of the fault; NaN: none
    force: float  # largest, device units
    jumped: bool  # by the rule of the published analysis code


@dataclasses.dataclass(frozen=True)
class BurstRun:
    """One run of the campaign."""

    group: str
    # Of the fault: DAC counts or um per packet; NaN without a fault.
    value: float
    events: tuple[BurstEvent, ...]
    cause: str  # why the robot stopped, "" if it did not
    stop_ms: int  # time of the stop; -1: never
    false_cues: int  # cues that began outside the events, before the stop
    # The campaign's first cue equals the one of the series, to the millisecond.
    same_cue: bool


@dataclasses.dataclass(frozen=True)
class Criteria:
    """The bands of the acceptance targets, each as a test of a run."""

    tests: dict[str, Callable[[BurstRun], bool]]  # A4 first
    a4: tuple[str, ...]

    def all_of_a4(self, run: BurstRun) -> bool:
        """Return whether the run meets every test of target A4."""
        return all(self.tests[name](run) for name in self.a4)


def criteria(published: Published) -> Criteria:
    """Return the bands of the file of published numbers, each required of all four bursts. A burst
    that is cut short has no rebound.
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


def run(row: Row, series: Series, golden_um: np.ndarray) -> BurstRun:
    """Measure a run from its row of the result table and its series.

    `golden_um`: measured tip of the golden run, um [ticks, 3].
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
            event(series, onset, min(onset + EVENT_TICKS, stop), jumps) for onset in onsets
        ),
        cause=str(row["response_cause"]) if stopped else "",
        stop_ms=stop if stopped else -1,
        false_cues=len(outside),
        same_cue=int(row["cue0_first_ms"]) == (pulses[0] if pulses else -1),
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


SMALL = 1500.0
"""Counts. A larger constant stops the robot in the first burst."""

Runs = Mapping[Motion, Sequence[BurstRun]]


def ranges(values: Sequence[float], step: float = 50.0) -> str:
    """Write sorted numbers, with neighbours of one step joined: -200 to -100, +50."""
    runs: list[list[float]] = []
    for value in values:
        if runs and value - runs[-1][-1] == step:
            runs[-1].append(value)
        else:
            runs.append([value])
    return ", ".join(f"{r[0]:+.0f} to {r[-1]:+.0f}" if len(r) > 1 else f"{r[0]:+.0f}" for r in runs)


def _by_value(bursts: Runs) -> list[tuple[float, list[BurstRun]]]:
    key = operator.attrgetter("value")
    return [
        (value, list(runs)) for value, runs in itertools.groupby(sorted(flat(bursts), key=key), key)
    ]


def constants(bursts: Runs, rules: Criteria) -> Table:
    rows = []
    for value, runs in _by_value(bursts):
        events = [e for one in runs for e in one.events]
        rows.append(
            (
                *(f"{value:+.0f}", span((len(one.events) for one in runs), ".0f"), _stops(runs)),
                span((e.peak_mm for e in events), ".1f"),
                span((e.rebound_deg for e in events), ".1f"),
                span((e.rebound_ms for e in events), ".0f"),
                span((e.cue_s for e in events), ".2f"),
                span((e.force for e in events if e.force > 0.0), ".3f"),
                sum(e.jumped for e in events),
                *(sum(map(holds, runs)) for holds in (*rules.tests.values(), rules.all_of_a4)),
            )
        )
    return read_table(NAME, "constants", rows)


def _stops(runs: Sequence[BurstRun]) -> str:
    stopped = [len(one.events) for one in runs if one.cause]
    return (
        " ".join(str(stopped.count(number)) for number in range(1, EVENTS + 1))
        if stopped
        else "none"
    )


def span(values: Iterable[float], form: str) -> str:
    """Write the least and largest of the finite values."""
    there = [value for value in values if not math.isnan(value)]
    if not there:
        return "–"
    low, high = format(min(there), form), format(max(there), form)
    return low if low == high else f"{low} to {high}"


def what_bands_depend_on(settings: Mapping[str, Runs], rules: Criteria) -> Table:
    rows = []
    for name, runs in settings.items():
        every = flat(runs)
        met = [sum(map(holds, every)) for holds in (*rules.tests.values(), rules.all_of_a4)]
        most = max(sum(rules.tests[test](one) for test in rules.a4) for one in every)
        rows.append((name, len(every), *met, most, span(stop_peaks(every), ".1f")))
    return read_table(NAME, "bands", rows)


def stop_peaks(runs: Iterable[BurstRun]) -> list[float]:
    """Return tip error peaks, mm, of bursts that end in a stop, for constants of at most SMALL."""
    return [
        one.events[-1].peak_mm
        for one in runs
        if one.cause and one.events[-1].cut and abs(one.value) <= SMALL
    ]


def stop_words(settings: Mapping[str, Runs], published: Published) -> str:
    """Say at which tip error a burst stops the robot, by setting, in a sentence."""
    peaks = [
        f"{span(stop_peaks(flat(runs)), '.1f')} mm ({name})"
        for number, (name, runs) in enumerate(settings.items())
        if number == 0 or name.startswith("stop above")
    ]
    stopped = published.value("burst.4.peak")
    return (
        f"Bursts that end in a stop have tip error peaks of {', '.join(peaks)}; the paper's has"
        f" {stopped:g} mm."
    )


def flat(runs: Runs) -> list[BurstRun]:
    """Return the runs of all motions in one list."""
    return [one for of_motion in runs.values() for one in of_motion]


NAME = "seed_burst"
FREE, BURST = "fault_free", "burst"
"""Groups of the campaign whose runs are measured."""
VARIANTS = read_variants(NAME)


def compare(context: Context) -> Findings:
    """Measure every run and compare its events with the paper's four."""
    measured = _measured(context)
    published = Published("seed")
    rules = criteria(published)
    bursts = _of_group(measured[MODELLED], BURST)
    free = _of_group(measured[MODELLED], FREE)
    settings = {name: _of_group(runs, BURST) for name, runs in measured.items()}
    lines = (
        *_acceptance(settings, rules, published),
        *_events(bursts, published),
        _false_cues(free, published),
    )
    return Findings(
        lines=lines,
        tables=(constants(bursts, rules), what_bands_depend_on(settings, rules)),
        notes=read_notes(NAME),
    )


def _measured(context: Context) -> dict[str, dict[Motion, list[BurstRun]]]:
    recorder = Recorder()
    return {
        setting: {motion: _runs(recorder, context, name) for motion, name in names.items()}
        for setting, names in by_setting(VARIANTS).items()
    }


def _runs(recorder: Recorder, context: Context, name: str) -> list[BurstRun]:
    """Return each run of a campaign with the fault-free one, which is the first.

    Every run draws its own packets, so the first run is not exactly its golden run. It is only used
    to find steps as long as a jump's, above 100 um. A fault-free tip makes no such step (59 um at
    most in suture and peg_transfer).
    """
    folder = context.folders[name]
    golden_um = recorder.measure(folder, lambda _, series: series["position"] * 1e6, lambda _: [0])[
        0
    ]

    return recorder.measure(folder, lambda row, series: run(row, series, golden_um))


def _of_group(runs: Runs, group: str) -> dict[Motion, list[BurstRun]]:
    return {
        motion: [one for one in of_motion if one.group == group]
        for motion, of_motion in runs.items()
    }


def _acceptance(
    settings: Mapping[str, Runs], rules: Criteria, published: Published
) -> tuple[Line, ...]:
    """Return, for each band and for all of A4, in how many runs it is met. At least one is
    required, as the constant is unknown.
    """
    every = flat(settings[MODELLED])
    texts = {
        "four bursts": "all four bursts come before the stop, or none stops",
        "peaks": "the tip error peaks of all four are 3 to 7 mm",
        "rebounds": "the rebounds of all are 3 to 7 degrees",
        "rebound times": "the rebounds of all take 100 to 200 ms",
        "stop in the fourth": "the robot stops in the fourth, by the magnitude of the DAC command",
        "cue onsets": "all four have a cue, 0.15 to 0.25 s after their onset",
    }
    published_run = StudyEstimate(1, n=1, of="run, Figures 4 and 5")
    lines = [
        _count(
            f"runs in which {words}",
            every,
            rules.tests[name],
            published_run,
            "A4" if name in rules.a4 else "A5",
        )
        for name, words in texts.items()
    ]
    together = _count(
        "runs in which all of A4 holds at once", every, rules.all_of_a4, published_run, "A4"
    )
    words = stop_words(settings, published)
    reason = f"{together.reason}. {words} The limit of the check is not stated"
    jumps = StudyEstimate(
        sum(
            len(one.events) == EVENTS
            and one.events[-1].cut
            and all(event.jumped for event in one.events)
            for one in every
        ),
        n=len(every),
        of="runs, jumps by the published code's rule",
    )
    four = Line(
        "runs with four jumps, of which the last ends in the stop", "", published_run, jumps
    )
    return (dataclasses.replace(together, reason=reason), *lines, four)


def _count(
    what: str,
    runs: Sequence[BurstRun],
    holds: Callable[[BurstRun], bool],
    published: StudyEstimate,
    target: str,
) -> Line:
    met = [one for one in runs if holds(one)]
    constants = sorted({one.value for one in met})
    of = f"runs ({len({one.value for one in runs})} constants, {len(MOTIONS)} motions)"
    reason = (
        f"{len(constants)} constants: {ranges(constants)}"
        if met
        else "at no constant and with no motion"
    )
    return Line(
        what,
        "",
        published,
        StudyEstimate(len(met), n=len(runs), of=of),
        (1, math.inf),
        target,
        reason,
    )


def _events(bursts: Runs, published: Published) -> tuple[Line, ...]:
    """Return what accompanies a tip error peak of the published size, for any constant and
    motion.
    """
    low, high = published.band("a4.peak")
    sized = {
        motion: [e for one in of_motion for e in one.events if low <= e.peak_mm <= high]
        for motion, of_motion in bursts.items()
    }

    def line(
        what: str,
        unit: str,
        read: StudyEstimate,
        of: Callable[[BurstEvent], float],
        band: str = "",
        caveat: str = "",
    ) -> Line:
        values = {
            m: [v for v in map(of, events) if not math.isnan(v)] for m, events in sized.items()
        }
        prediction = over_kinds({m: float(np.mean(v)) for m, v in values.items() if v})
        every = [value for of_motion in values.values() for value in of_motion]
        words = f"middle 90 % of {len(every)} events {_percentiles(every)}{caveat}"
        where = f"{what}, events with a peak of {low:g} to {high:g} mm"
        limits = published.band(band) if band else None
        target = band.partition(".")[0].upper()
        return Line(where, unit, read, prediction, limits, target, words)

    def of_three(values: Sequence[float], of: str) -> StudyEstimate:
        return StudyEstimate(float(np.mean(values)), min(values), max(values), 3, of)

    value = published.value
    rebounds = [value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    per_mm = [value(f"pulse.{k}.force") / value(f"burst.{k}.peak") for k in (1, 2, 3)]
    read = of_three(rebounds, "events read off Figure 4")
    force = of_three(per_mm, "events below the cap, Figures 4 and 5")
    time, onset = published.estimate("burst.3.rebound_ms"), published.estimate("cue.onset")
    caveat = "; no evidence: the cue's gains were read off Figure 5"
    return (
        line("rebound of the shoulder", "deg", read, lambda e: e.rebound_deg, "a4.rebound"),
        line("time of the rebound", "ms", time, lambda e: e.rebound_ms, "a4.rebound_ms"),
        line("cue after the fault's onset", "s", onset, lambda e: e.cue_s, "a5.onset"),
        line(
            "peak force over tip error peak",
            "1/mm",
            force,
            lambda e: e.force / e.peak_mm,
            "",
            caveat,
        ),
    )


def _percentiles(values: Sequence[float]) -> str:
    if not values:
        return "none"
    low, high = np.percentile(values, (5, 95))
    return f"{low:.3g} to {high:.3g}"


def _false_cues(free: Runs, published: Published) -> Line:
    pulses = sum(one.false_cues for of_motion in free.values() for one in of_motion)
    prediction = StudyEstimate(pulses, n=len(free), of="runs of 40 s, one a motion")
    reason = "study seed_fault_free looks for them at every scale, with noise"
    words, read = "cue pulses without fault at scale 0.1", published.estimate("false_pulses")
    return Line(words, "", read, prediction, reason=reason)


STUDY = study(NAME, variants=VARIANTS, compare=compare)
