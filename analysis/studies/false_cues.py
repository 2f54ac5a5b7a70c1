"""Study: how often does the published cue come without a fault, by motion and scale, with generated
and with recorded hands?

A cue counts once until the tip was back within the threshold for AWAY_MS, as in training sessions.
Runs in which the overdrive check clips a command are counted apart: there the robot leaves its
model because of the check. A run counts from its pedal-down until it stops.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap.units import FEWEST, group_units, ratio_band
from studies.cells import plain
from studies.dsn16 import recording
from studies.runs import SCALE
from studies.series import Recorder, Row, Series
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Variant,
    own_line,
    read_notes,
    read_table,
    study,
)

NAME, CAMPAIGN = "false_cues", "reacting_operator_free.toml"
THRESHOLDS_MM = (2.0, 3.0)
AWAY_MS = 250
DEFAULT_SCALE = 0.1
REST_MS = 500
"""Time for which hands rest at the beginning of every motion."""
KINDS = ("suture", "reach", "peg_transfer", "palpate")
SEEDS = range(11, 17)
GENERATED_S = 120
SCALES = "parameters={operator.scale=[0.05, 0.1, 0.15, 0.2]}"
COMMON = ("group.fault_free.repeats=1",)
SURGEON, CONSOLE = "operator_positions.parquet", "console_itp_packets.parquet"
WINDOWS_S = ((0.0, 2.95), (6.4, 14.9), (18.2, 47.9), (50.7, 60.9))
"""Parts of the recorded surgeon's motion that the arm reaches at the recorded scale."""
CONSOLE_S = (0.184, 40.57)


class Motion(NamedTuple):
    """One run without a fault."""

    kind: str
    recording: str
    scale: float
    hours: float
    cues: Mapping[float, int]  # by threshold
    peak_mm: float  # largest distance of the measured tip from the model
    speed: float  # mm/s, root mean square of the tip
    clipped: bool


def onsets(active: np.ndarray) -> int:
    """Return how many cues `active` (bool [ticks]) is, if pauses of less than AWAY_MS are none."""
    ticks = np.flatnonzero(active)
    return int(len(ticks) > 0) + int((np.diff(ticks) > AWAY_MS).sum())


def measure(name: str, row: Row, series: Series) -> Motion:
    """Measure a run from its row of the result table and its series."""
    stop = int(row["check_estop_first_ms"])
    error = series["tip_error_mm"][REST_MS : stop if stop >= 0 else None]
    tip = series["tip"][REST_MS : REST_MS + len(error)]
    steps = np.diff(tip[::10], axis=0)
    kind = name.rpartition("_")[0]
    return Motion(
        kind=kind,
        recording=name,
        scale=float(row[SCALE]),
        hours=len(error) / 3.6e6,
        cues={mm: onsets(error > mm) for mm in THRESHOLDS_MM},
        peak_mm=float(error.max(initial=0.0)),
        speed=float(np.sqrt((steps**2).sum(axis=1).mean()) * 1e5),
        clipped=int(row["check_overdrive_clip_count"]) > 0 or stop >= 0,
    )


def rate(runs: Sequence[Motion], mm: float) -> StudyEstimate:
    """Return cues an hour: over recordings, or exact Poisson for a count of 0 or few recordings."""
    counts, hours = (
        np.array(part) for part in zip(*((r.cues[mm], r.hours) for r in runs), strict=True)
    )
    exact = alarm_rate(int(counts.sum()), float(hours.sum()))
    low, high = exact.low, exact.high
    among = group_units([run.recording for run in runs])
    if exact.count and among.count >= FEWEST:
        _, low, high = ratio_band(counts, hours, among)
    of = f"cues in {hours.sum():.2f} h of {among.count} recordings"
    return StudyEstimate(exact.per_hour, float(low), float(high), exact.count, of)


def compare(context: Context) -> Findings:
    """Count cues by motion and scale."""
    recorder = Recorder()
    runs = [
        one
        for name, folder in context.folders.items()
        for one in recorder.measure(
            folder, lambda row, series, name=name: measure(name, row, series)
        )
    ]
    absent = "" if any(one.kind not in KINDS for one in runs) else f" Set {recording.DATA}."
    return Findings(
        tuple(_lines(runs)),
        (read_table(NAME, "motions", _rows(runs)),),
        read_notes(NAME, absent=absent),
    )


def _lines(runs: Sequence[Motion]) -> Iterator[Line]:
    at = [run for run in runs if np.isclose(run.scale, DEFAULT_SCALE) and not run.clipped]
    groups = {
        "generated motion": [run for run in at if run.kind in KINDS],
        "recorded hands": [run for run in at if run.kind not in KINDS],
        **{kind: [run for run in at if run.kind == kind] for kind in KINDS},
    }
    for words, mine in groups.items():
        for mm in THRESHOLDS_MM if mine else ():
            quantity = f"{words}: cues of {mm:g} mm without a fault, scale {DEFAULT_SCALE:g}"
            yield own_line(quantity, "1/h", rate(mine, mm))


def _rows(runs: Sequence[Motion]) -> Iterator[tuple[str | float, ...]]:
    keys = {(run.kind, round(run.scale, 3), run.clipped): None for run in runs}
    for kind, scale, clipped in sorted(keys, key=lambda key: (key[0] not in KINDS, key)):
        mine = [r for r in runs if (r.kind, round(r.scale, 3), r.clipped) == (kind, scale, clipped)]
        rates = [rate(mine, mm) for mm in THRESHOLDS_MM]
        yield (
            *(kind, scale, "yes" if clipped else "", len(mine)),
            *(round(sum(r.hours for r in mine), 3), f"{np.mean([r.speed for r in mine]):.1f}"),
            f"{max(r.peak_mm for r in mine):.2f}",
            *(f"{plain(one)}; {one.n}" for one in rates),
        )


def _variants() -> Iterator[Variant]:
    for kind in KINDS:
        for seed in SEEDS:
            motion = (f"operator.motion={kind}", f"operator.seed={seed}")
            more = (SCALES, f"campaign.duration_s={GENERATED_S}", *motion, *COMMON)
            yield Variant(f"{kind}_{seed}", CAMPAIGN, more, f"generated motion: {kind}")
    surgeon, console = recording.locate(SURGEON), recording.locate(CONSOLE)
    if surgeon is not None:
        for k, (begin, end) in enumerate(WINDOWS_S):
            overrides = (
                "parameters={operator.scale=[0.1]}",
                f"campaign.duration_s={end - begin:.2f}",
                "operator={}",
                f"operator.file={surgeon}",
                f"operator.window_s=[{begin}, {end}]",
                "operator.rate_hz=999.9508",
                "operator.cutoff_hz=5",
                "operator.at_end=hold",
                *COMMON,
            )
            yield Variant(f"recorded surgeon_{k}", CAMPAIGN, overrides, "recorded hands: a surgeon")
    if console is not None:
        for arm in ("gold", "green"):
            overrides = (
                SCALES,
                f'campaign.arms=["{arm}"]',
                f"campaign.duration_s={CONSOLE_S[1] - CONSOLE_S[0]:.1f}",
                "operator={}",
                f"operator.file={console}",
                f"operator.window_s=[{CONSOLE_S[0]}, {CONSOLE_S[1]}]",
                "operator.at_end=hold",
                *COMMON,
                "campaign.packets=every_cycle",  # of the console, as recorded
            )
            question = f"recorded hands: a peg transfer at a console, {arm} arm"
            yield Variant(f"recorded console_{arm}", CAMPAIGN, overrides, question)


STUDY = study(NAME, variants=tuple(_variants()), compare=compare)
