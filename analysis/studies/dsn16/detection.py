"""Who would have noticed: the robot's own check, the published detector and its parts, against the
jumps of the runs.

The published accuracies were withheld from whoever wrote this; what stands here is predicted from
the definitions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from studies.dsn16 import detector
from studies.dsn16.detector import Learned, RunAlarms, score
from studies.dsn16.published_log import Log, log
from studies.dsn16.runs import VariantRuns
from studies.dsn16.signals import Series, measure
from studies.framework.study import StudyEstimate, Table, Variant

TRAINING = (
    Variant(
        "training_suture",
        "dsn16_thresholds.toml",
        (),
        "fault-free runs for the detector, first motion",
    ),
    Variant(
        "training_peg_transfer",
        "dsn16_thresholds.toml",
        ("operator.motion=peg_transfer",),
        "fault-free runs for the detector, second motion",
    ),
)
"""Two motions of 300 runs, as the 600 of the publication."""

LEAP_UM = 1000.0

CHOSEN = "99.9 % of all steps"
"""Of the thresholds, the one that single figures are given for."""


class Watched(NamedTuple):
    """What the detector made of the runs of one variant, in the order of its frame."""

    thresholds: Mapping[str, np.ndarray]  # how they were learned -> [3, 3]
    alarms: Mapping[str, Sequence[RunAlarms]]  # the same -> of each run
    largest_mvel: (
        np.ndarray
    )  # [runs] largest step of motor velocity inside the window, over its 99.9 % threshold
    leaps: (
        np.ndarray
    )  # bool [runs] the reported tip moved more than 1 mm within two packets: the text's jump
    joints: (
        np.ndarray
    )  # [runs, 3, 7] rad and m, reported in the packets of the first jump's steps; NaN: no jump


def learn(folders: Mapping[str, Path]) -> Learned:
    """From the training campaigns that are there."""
    steps: list[np.ndarray] = []
    for variant in TRAINING:
        if variant.name in folders:
            steps += measure(
                folders[variant.name], lambda _, series: detector.fault_free(log(series))
            )
    return detector.learn(steps)


def thresholds(learned: Learned) -> dict[str, np.ndarray]:
    """The published choices, by name, [3, 3] each."""
    return {
        "99.8 % of all steps": learned.percentile(99.8),
        CHOSEN: learned.percentile(99.9),
        "99.8 % of the runs' maxima": learned.percentile_of_maxima(99.8),
        "99.9 % of the runs' maxima": learned.percentile_of_maxima(99.9),
    }


def watch(folder: Path, runs: VariantRuns, thresholds: Mapping[str, np.ndarray]) -> Watched:
    """Every faulty run of a folder under the detector's eyes."""
    columns = (runs.start.tolist(), runs.duration.tolist(), runs.jump_packet.tolist())
    faults = dict(zip(runs.index.tolist(), zip(*columns, strict=True), strict=True))

    def one(row: int, series: Series) -> tuple[list[RunAlarms], float, bool, np.ndarray]:
        trace, (first, lasts, ended) = log(series), faults[row]
        inside = (trace.packet[:-1] >= first) & (trace.packet[:-1] <= first + lasts + 1)
        moved = detector.steps(trace)[inside, 1] / thresholds[CHOSEN][1]
        verdicts = [
            detector.alarms(trace, threshold, first, lasts) for threshold in thresholds.values()
        ]
        return verdicts, float(moved.max(initial=0.0)), leaps(trace), jump_steps(trace, ended)

    measured = measure(folder, one, runs.index.tolist())
    return Watched(
        thresholds=thresholds,
        alarms={name: [alarms[k] for alarms, *_ in measured] for k, name in enumerate(thresholds)},
        largest_mvel=np.array([largest for _, largest, *_ in measured]),
        leaps=np.array([leapt for *_, leapt, _ in measured]),
        joints=np.stack([joints for *_, joints in measured]),
    )


def jump_steps(found: Log, ended: int) -> np.ndarray:
    """Joints [3, 7] in the packets of a jump's two steps, of which the second ends in packet
    `ended`; 0: NaN.
    """
    if not ended:
        return np.full((3, found.joints.shape[1]), np.nan)
    row = int(np.searchsorted(found.packet, ended))
    return found.joints[row - 2 : row + 1].astype(float)


def leaps(found: Log) -> bool:
    """Whether the reported tip moves more than 1 mm within one packet or two: the jump of the
    publication's text.
    """
    return any(
        bool((np.linalg.norm(found.tip[rows:] - found.tip[:-rows], axis=1) > LEAP_UM).any())
        for rows in (1, 2)
    )


def table(runs: VariantRuns, watched: Watched, title: str) -> Table:
    """Detectors against jumps."""
    jumped, stopped = runs.hits["jump"], runs.hits["stop"]
    flags_of: dict[str, np.ndarray] = {"RAVEN: software E-stop": stopped}
    for name, alarms in watched.alarms.items():
        flags_of[f"model, all three; {name}"] = np.array([a.inside[3] for a in alarms])
    for k, part in enumerate(
        ("motor position alone", "motor velocity alone", "joint position alone")
    ):
        flags_of[f"model, {part}; {CHOSEN}"] = np.array(
            [a.inside[k] for a in watched.alarms[CHOSEN]]
        )
    fused = flags_of[f"model, all three; {CHOSEN}"]
    flags_of[f"model, all three, anywhere; {CHOSEN}"] = np.array(
        [a.anywhere[3] for a in watched.alarms[CHOSEN]]
    )
    flags_of[f"model or RAVEN; {CHOSEN}"] = fused | stopped
    rows = []
    for name, flags in flags_of.items():
        rows.append(
            (name, int(flags.sum()), *(round(100.0 * share, 1) for share in score(flags, jumped)))
        )
    heads = (
        "detector",
        "runs told",
        "true positive rate, %",
        "false positive rate, %",
        "precision, %",
        "accuracy, %",
    )
    lead = leads(runs, watched)
    note = (
        f"{len(jumped)} runs, {int(jumped.sum())} with a jump. Alarms count in packets t1 to t1 + d"
        " + 1, but for the row that says anywhere. Where both came, the model's alarm came"
        f" {lead.value:.0f} packets in the median (5 to 95 %: {lead.low:.0f} to {lead.high:.0f};"
        f" {lead.n} runs) before the jump was complete. {missed(runs, fused)}"
    )
    return Table(title, (*heads, "F1, %"), tuple(rows), note)


def missed(runs: VariantRuns, fused: np.ndarray) -> str:
    """Which cells jump unseen by both, in words."""
    cells = runs.counting(unseen=runs.hits["missed"] & ~fused).share("unseen")
    unseen = np.argwhere(cells.shares >= 0.5)
    if not len(unseen):
        return "No cell jumps unseen by both."
    listed = ", ".join(f"{cells.values[v]:g} for {cells.durations[d]}" for v, d in unseen)
    return f"{len(unseen)} cells jump unseen by model and RAVEN: {listed} packets."


def leads(runs: VariantRuns, watched: Watched) -> StudyEstimate:
    """Packets from the first fused alarm to the jump: median, 5th and 95th percentile; n counts
    runs with both.
    """
    first = np.array([a.first for a in watched.alarms[CHOSEN]])
    jump = runs.jump_packet - runs.start
    both = (first >= 0) & runs.hits["jump"]
    if not both.any():
        return StudyEstimate(math.nan, n=0, of="runs")
    low, middle, high = np.percentile((jump - first)[both], (5, 50, 95))
    return StudyEstimate(float(middle), float(low), float(high), int(both.sum()), "runs")
