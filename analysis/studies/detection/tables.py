"""Tables of the study of detectors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ravenjax.outcomes.verdict import HAZARDS
from ravenjax.report import wording
from ravenjax.robots.raven2.layers import LAYERS
from ravenjax.stats.alarms.roc import average_precision
from ravenjax.stats.multiplicity import holm
from ravenjax.vocabulary.robot import OTHER_LAYER
from studies.detection.areas import Areas, areas
from studies.detection.points import (
    HORIZON_MS,
    MOVED,
    PER_HOUR,
    PUBLISHED,
    Chosen,
    Point,
    before,
    caught,
    percent,
    plain,
    rate,
    share,
    threshold_for,
)
from studies.detection.runs import (
    AS_MODELLED,
    CHECKS,
    CUE,
    FaultyScores,
    FreeScores,
    names,
)
from studies.framework import kinds
from studies.framework.study import Table

CLUTCHED = "clutched"
"""Begin of the recordings in which the pedal goes up and down."""


def point_table(
    quiet: Sequence[Point], published: Sequence[Point], spoken: Sequence[Point]
) -> Table:
    """Operating points side by side."""
    rows = [
        *((p, f"at most {PER_HOUR:g} false alarm an hour seen") for p in quiet),
        *((p, "as published, or as the software has it") for p in published),
        *((p, "has one threshold") for p in spoken),
    ]
    return Table(
        "Operating points",
        (
            "detector",
            "threshold",
            "chosen",
            "false alarms an hour",
            "recall",
            "other faults with an alarm",
            "precision",
            "caught before it began",
            "median delay, ms",
            f"mean delay within {HORIZON_MS / 1e3:g} s, ms",
            "median lead, ms",
        ),
        tuple(
            (
                p.name,
                "" if math.isnan(p.threshold) else p.threshold,
                how,
                rate(p.false),
                percent(p.caught),
                percent(p.disturbed),
                percent(p.precision),
                percent(p.before),
                plain(p.delay_ms),
                plain(p.mean_delay_ms),
                plain(p.lead_ms),
            )
            for p, how in rows
        ),
        "Caught: of runs with unintended motion, those with an alarm; precision: of alarms in"
        " faulty runs, those in a run with unintended motion. False alarms: separate ones on motion"
        " without a fault, robot as modelled, scales 0.05 to 0.2, interval over recordings; of the"
        " built-in checks, runs in which one tripped. Rates and times: 95 % over kinds of faults."
        " Delay: from the fault's first effect, one run of each fault that made an unintended"
        " motion, runs without an alarm censored at their end; a dash: half of them never had one."
        " Lead over the unintended motion: positive where the alarm comes first; a dash in both"
        " columns about the motion's beginning: when the alarm comes follows from the definitions.",
    )


def rule_table(points: Mapping[str, Point | None], auc: Areas, listed: Sequence[str]) -> Table:
    """Fusion rules and consecutive milliseconds of the detector of steps."""
    rows = []
    for d, name in enumerate(listed):
        if not name.startswith("steps"):
            continue
        _, fusion, count = name.split("/")
        p = points[name]
        cells = ("no threshold is quiet", *[""] * 5)
        if p is not None:
            cells = (
                p.threshold,
                percent(p.caught),
                percent(p.disturbed),
                percent(p.before),
                plain(p.mean_delay_ms),
                rate(p.false),
            )
        rows.append((fusion, int(count), plain(auc.estimate(d)), *cells))
    return Table(
        f"Steps: which must be over, and for how long, at most {PER_HOUR:g} false alarm an hour"
        " seen",
        (
            "fusion",
            "ms in a row",
            "AUC",
            "threshold",
            "recall",
            "other faults with an alarm",
            "caught before it began",
            f"mean delay within {HORIZON_MS / 1e3:g} s, ms",
            "false alarms an hour",
        ),
        tuple(rows),
        "A step of motor velocity counts when two in a row have it, as published, so that 1 and 2"
        " ms in a row are nearly the same for it.",
    )


def area_table(faulty: FaultyScores, auc: Areas) -> Table:
    """AUC and average precision of each detector, and its difference to the published rule."""
    listed = names(faulty.detectors)
    than = listed.index(PUBLISHED[0])
    differences = {name: auc.difference(d, than) for d, name in enumerate(listed) if d != than}
    tested = holm({name: p for name, (_, p) in differences.items()})
    rows = []
    for d, name in enumerate(listed):
        precision = average_precision(faulty.score[:, d], faulty.unintended)
        cells = ("", "", "")
        if name in differences:
            adjusted = tested[name].adjusted
            cells = (
                plain(differences[name][0]),
                wording.number(adjusted) if adjusted >= 1e-4 else "< 0.0001",
                "yes" if tested[name].rejected else "no",
            )
        rows.append((name, plain(auc.estimate(d)), round(precision, 3), *cells))
    return Table(
        "Areas: how well a run's score tells an unintended motion from another fault",
        (
            "detector",
            "AUC",
            "average precision",
            f"AUC minus that of {PUBLISHED[0]}",
            "p, Holm",
            "differ",
        ),
        tuple(rows),
        f"{wording.count(auc.positives)} runs with unintended motion and"
        f" {wording.count(auc.negatives)} others of {wording.count(len(np.unique(faulty.cell)))}"
        f" faults, {kinds.count(faulty.faults)}; every detector saw the same. Intervals and tests"
        " are over kinds of faults (Obuchowski 1997). Average precision of chance:"
        f" {faulty.unintended.mean():.3f}.",
    )


def first_table(faulty: FaultyScores, chosen: Sequence[Chosen]) -> Table:
    """Who speaks first of faults that make an unintended motion."""
    once = faulty.where(faulty.unintended).once()
    spoke = np.stack([once.spoke_ms(*one) for one in chosen]).astype(float)
    spoke[spoke < 0] = np.inf
    earliest = spoke.min(axis=0)
    first = np.isfinite(spoke) & (spoke <= earliest)
    count = first.sum(axis=0)
    rows = []
    for one, mine, own in zip(chosen, first, spoke, strict=True):
        others_first = np.min(
            np.delete(spoke, [k for k, c in enumerate(chosen) if c == one], axis=0), axis=0
        )
        alone = np.isfinite(own) & np.isinf(others_first)
        rows.append(
            (
                one.told,
                *(
                    percent(share(hit, np.ones(len(hit), bool), once.faults, ""))
                    for hit in (mine, mine & (count == 1))
                ),
                percent(share(alone, np.ones(len(alone), bool), once.faults, "")),
            )
        )
    nobody = np.isinf(earliest)
    late = np.isfinite(earliest) & (earliest >= once.unintended_ms)
    everyone = np.ones(len(nobody), bool)
    rows += [
        (
            "someone, but not before the motion",
            percent(share(late, everyone, once.faults, "")),
            "",
            "",
        ),
        ("nobody", percent(share(nobody, everyone, once.faults, "")), "", ""),
    ]
    return Table(
        "Who knows first",
        ("detector", "first, or with the first", "first alone", "the only one that ever knows"),
        tuple(rows),
        "One run of each fault that made an unintended motion; detectors at the threshold of the"
        " first table.",
    )


def layer_table(faulty: FaultyScores, chosen: Sequence[Chosen]) -> Table:
    """Unintended motion caught, by layer of the fault."""
    moved = faulty.where(faulty.unintended)
    parts = {layer: moved.where(moved.layer == layer) for layer in layers_of(moved.layer)}
    rows = []
    for layer, part in parts.items():
        shares = [
            percent(share(part.spoke_ms(*one) >= 0, part.unintended, part.faults, ""))
            for one in chosen
        ]
        rows.append(
            (layer, len(part.cell), len(np.unique(part.cell)), kinds.count(part.faults), *shares)
        )
    return Table(
        "Unintended motion caught, by layer of the fault",
        ("layer", MOVED, "of faults", "of kinds", *(one.told for one in chosen)),
        tuple(rows),
        "How many faults each layer has is a design, so that the rates of all layers together"
        f" depend on it. {kinds.NOTE}",
    )


def robot_table(faulty: FaultyScores, free: FreeScores, main: Sequence[str]) -> Table:
    """What an uncertain robot and noise do to false alarms, and to the threshold that would be
    needed.
    """
    modelled = free.where(free.robot == AS_MODELLED)
    rows = []
    for robot in dict.fromkeys(free.robot.tolist()):
        if robot == AS_MODELLED:
            continue
        mine = free.where(free.robot == robot)
        same = modelled.where(np.isin(modelled.recording, mine.recording))
        for name in main:
            threshold, needed = threshold_for(same, name), threshold_for(mine, name)
            rates = ["", ""]
            if threshold is not None:
                rates = [rate(part.per_hour(part.count(name, threshold))) for part in (same, mine)]
            shares = [
                percent(caught(faulty, name, one)) if one is not None else ""
                for one in (threshold, needed)
            ]
            rows.append((robot, name, _threshold(threshold), *rates, _threshold(needed), *shares))
        for name in (CUE, CHECKS):
            rates = [rate(part.per_hour(part.count(name, np.nan))) for part in (same, mine)]
            rows.append((robot, name, "", *rates, "", "", ""))
    return Table(
        "How much false alarms depend on knowing the robot",
        (
            "robot",
            "detector",
            "threshold chosen on the robot as modelled",
            "false alarms an hour there, as modelled",
            "and with this robot",
            "threshold that this robot needs",
            "caught at the first",
            "at the second",
        ),
        tuple(rows),
        "On the same recordings each time. Uncertain robot: friction x 0.7 to 1.4, mass x 0.8 to"
        " 1.25, cable stiffness x 0.5 to 2, motor constant x 0.9 to 1.1, drawn anew for each run."
        " Noise: the encoders' quantisation and the controller's torque step; more noise: 2 counts"
        " and 0.02 N m, assumed. Caught: unintended motion of the robot as modelled.",
    )


def condition_table(
    faulty: FaultyScores, fast: FaultyScores, modelled: FreeScores, main: Sequence[str]
) -> Table:
    """What the motion that a threshold must be quiet on does to the threshold, and so to what is
    caught.
    """
    still_down = unclutched(modelled)
    conditions = (
        ("every motion and scale", modelled, faulty, 0.1),
        ("every motion, scale 0.1", at_scale(modelled, 0.1), faulty, 0.1),
        ("no clutching, scale 0.1", at_scale(still_down, 0.1), faulty, 0.1),
        ("every motion and scale", modelled, fast, 0.2),
        ("no clutching, scale 0.2", at_scale(still_down, 0.2), fast, 0.2),
    )
    rows = []
    for words, free, runs, scale in conditions:
        if not free.hours.sum() > 0:
            continue
        for name in main:
            threshold = threshold_for(free, name)
            cells: tuple[str | float, ...] = ("none is quiet", "", "", "", "")
            if threshold is not None:
                spoke_ms = runs.spoke_ms(name, threshold)
                cells = (
                    threshold,
                    rate(free.per_hour(free.count(name, threshold))),
                    percent(caught(runs, name, threshold)),
                    percent(share(spoke_ms >= 0, ~runs.unintended, runs.faults, "")),
                    percent(before(runs, name, threshold)),
                )
            rows.append((words, scale, name, *cells))
    return Table(
        "What a threshold must be quiet on, and what that costs",
        (
            "quiet on",
            "faults at scale",
            "detector",
            "threshold",
            "false alarms an hour",
            "recall",
            "other faults with an alarm",
            "caught before it began",
        ),
        tuple(rows),
        f"Thresholds: the lowest with at most {PER_HOUR:g} false alarm an hour on that motion."
        " Faults at 0.1 under four motions; at 0.2 while suturing.",
    )


def recording_table(modelled: FreeScores, main: Sequence[str]) -> Table:
    """Highest score of each recording without a fault."""
    listed = names(modelled.detectors)
    rows = []
    for recording in dict.fromkeys(modelled.recording.tolist()):
        mine = modelled.where(modelled.recording == recording)
        for k in np.argsort(mine.scale):
            scores = [float(f"{mine.score[k, listed.index(name)]:.3g}") for name in main]
            rows.append((recording, float(mine.scale[k]), *scores, int(mine.others[CUE][k])))
    return Table(
        "Highest score without a fault, robot as modelled",
        ("recording", "scale", *main, "pulses of the cue"),
        tuple(rows),
        "Scores grow with the scale, and there where the control software clips its commands"
        " (overdrive over 1) the robot falls behind its model. With clutching the distance to the"
        " model grows over the run at every scale.",
    )


def published_table(modelled: FreeScores, chosen: Sequence[tuple[str, float]]) -> Table:
    """False alarms of the published thresholds, by scale."""
    rows = []
    for name, threshold in chosen:
        for scale in np.unique(modelled.scale):
            mine = modelled.where(modelled.scale == scale)
            counts = mine.count(name, threshold)
            alarmed = len(np.unique(mine.recording[counts > 0]))
            rows.append(
                (
                    name,
                    threshold,
                    float(scale),
                    rate(mine.per_hour(counts)),
                    f"{alarmed} of {len(np.unique(mine.recording))}",
                )
            )
    return Table(
        "False alarms of the published thresholds, by scale",
        ("detector", "threshold", "scale", "false alarms an hour", "recordings with one"),
        tuple(rows),
        "A percentile of samples fixes the share of milliseconds above each threshold on the motion"
        " that it was learned on, here scales 0.05 and 0.1; not how often an alarm comes, nor what"
        " happens at another scale.",
    )


def hazard_table(faulty: FaultyScores, main: Sequence[str]) -> Table:
    """How areas depend on what a detector is to tell."""
    listed = names(faulty.detectors)
    calm = (faulty.hazard == "none") & ~faulty.jumped & ~faulty.leapt
    kinds = {
        **{
            f"{word}, the run's hazard": faulty.hazard == word for word in HAZARDS if word != "none"
        },
        "jump of the true tip": faulty.leapt,
        "jump of the reported tip alone": faulty.jumped & ~faulty.leapt,
    }
    rows = []
    for words, kind in kinds.items():
        rows_in = kind | calm
        auc = areas(faulty.score[rows_in], kind[rows_in], faulty.kind[rows_in])
        rows.append(
            (words, auc.positives, *(plain(auc.estimate(listed.index(name))) for name in main))
        )
    return Table(
        "AUC by kind of hazard",
        ("what a detector is to tell", "runs", *main),
        tuple(rows),
        f"Against {wording.count(int(calm.sum()))} faulty runs without hazard and jump each time. A"
        " run's hazard is the gravest that it has. Jumps are those of the published code's rule:"
        " with faults of encoders and estimates the reported tip jumps and the robot need not."
        " tip_error and the cue measure the distance of the reported tip from the model, of which"
        " the true one's belongs to the definition of an unintended motion and of a loss of"
        " motion, while the steps look for jumps. A robot that stops early shows less motion than"
        " one that goes on, and so scores less: areas below 0.5 are of such.",
    )


def hours_table(free: FreeScores) -> Table:
    """How much motion without a fault there was."""
    rows = []
    for robot in dict.fromkeys(free.robot.tolist()):
        mine = free.where(free.robot == robot)
        for scale in np.unique(mine.scale):
            part = mine.where(mine.scale == scale)
            rows.append(
                (
                    robot,
                    float(scale),
                    len(part.hours),
                    len(np.unique(part.recording)),
                    round(float(part.hours.sum()), 2),
                )
            )
        rows.append(
            (
                robot,
                "all",
                len(mine.hours),
                len(np.unique(mine.recording)),
                round(float(mine.hours.sum()), 2),
            )
        )
    return Table(
        "Motion without a fault",
        ("robot", "scale", "runs", "recordings", "hours in pedal-down"),
        tuple(rows),
        "A recording is one generated motion of one seed; its runs at several scales and robots"
        " resemble each other, so that intervals resample recordings.",
    )


def layers_of(layer: np.ndarray) -> list[str]:
    """Layers that there are among those of some runs [runs], in the robot's order."""
    there = set(layer.tolist())
    return [name for name in (*LAYERS.values(), OTHER_LAYER) if name in there]


def unclutched(free: FreeScores) -> FreeScores:
    """Motion in which the pedal stays down."""
    return free.where(~np.char.startswith(free.recording.astype(str), CLUTCHED))


def at_scale(free: FreeScores, scale: float) -> FreeScores:
    """Motion of one scale."""
    return free.where(np.isclose(free.scale, scale))


def _threshold(threshold: float | None) -> str | float:
    return "none is quiet" if threshold is None else threshold
