"""Which detector knows first, and how often does it cry wolf: every detector beside the robot's
checks and the cue.

Faults of the whole library and about the boundary of unintended motion, under four motions; false
alarms on long motion without a fault. Thresholds are chosen by false alarms an hour
(`detector_points`), never by what they catch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.outcomes import events
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.sample_size.planning import hours_to_bound
from studies.detection import drawings, runs, tables
from studies.detection.areas import Areas, areas
from studies.detection.points import (
    CLIP,
    FORK,
    MOVED,
    PER_HOUR,
    PUBLISHED,
    Chosen,
    Point,
    by_definition,
    caught,
    hundred,
    others,
    point,
    threshold_for,
)
from studies.detection.runs import AS_MODELLED, FaultyScores, FreeScores, names
from studies.framework import kinds, motions_alike
from studies.framework.motions_alike import MOTIONS, RECORDINGS
from studies.framework.study import Context, Findings, Line, Study, StudyEstimate, Variant

CAMPAIGN = "detectors.toml"
FAST = "suture_fast"
NOISY = tuple((motion, 11) for motion in ("suture", "reach", "peg_transfer", "palpate"))
FREE_RUNS, FREE_RUNS_NOISY = 32, 8
"""Runs of the groups without faults, which come first: all, and those of the first two groups."""
FREE_S = 120
MAIN = (PUBLISHED[0], "derivative_sum", "tip_error", "overdrive")


def compare(context: Context) -> Findings:
    """All detectors over the same runs."""
    faulty = runs.faulty([context.folders[name] for name in MOTIONS])
    fast = runs.faulty([context.folders[FAST]])
    free = runs.free(
        [
            (f"{motion} {seed}", context.folders[f"{kind}_{motion}_{seed}"])
            for kind, recordings in (("free", RECORDINGS), ("noise", NOISY))
            for motion, seed in recordings
        ]
    )
    return findings(faulty, fast, free)


def findings(faulty: FaultyScores, fast: FaultyScores, free: FreeScores) -> Findings:
    """As `compare`, of runs at hand. `fast`: the faults at twice the scale."""
    modelled = free.where(free.robot == AS_MODELLED)
    auc = areas(faulty.score, faulty.unintended, faulty.kind)
    points = {name: _quiet(faulty, modelled, name) for name in names(faulty.detectors)}
    best = max(
        (p for name, p in points.items() if p is not None and name.startswith("steps")),
        key=lambda p: p.caught.value,
        default=None,
    )
    main = (MAIN[0], *([best.name] if best and best.name != MAIN[0] else []), *MAIN[1:])
    quiet = [p for name in main if (p := points[name]) is not None]
    published = [point(faulty, modelled, *one) for one in (PUBLISHED, FORK, CLIP)]
    other_points = others(faulty, modelled)
    picks = [Chosen(p.name, p.threshold) for p in (*quiet, *other_points)]
    return Findings(
        lines=tuple(_lines(faulty, modelled, auc, quiet, published, other_points)),
        tables=(
            tables.point_table(quiet, published, other_points),
            tables.rule_table(points, auc, names(faulty.detectors)),
            tables.area_table(faulty, auc),
            tables.first_table(faulty, picks),
            tables.layer_table(faulty, picks),
            tables.robot_table(faulty, free, main),
            tables.condition_table(faulty, fast, modelled, main),
            tables.recording_table(modelled, main),
            tables.published_table(modelled, (PUBLISHED, FORK, CLIP)),
            tables.hazard_table(faulty, main),
            tables.hours_table(free),
        ),
        drawings=tuple(drawings.drawings(faulty, modelled, main, picks)),
        notes=_notes(faulty, modelled, best),
    )


def _quiet(faulty: FaultyScores, modelled: FreeScores, name: str) -> Point | None:
    threshold = threshold_for(modelled, name)
    return None if threshold is None else point(faulty, modelled, name, threshold)


def _lines(
    faulty: FaultyScores,
    modelled: FreeScores,
    found: Areas,
    quiet: Sequence[Point],
    published: Sequence[Point],
    spoken: Sequence[Point],
) -> list[Line]:
    listed = names(faulty.detectors)

    moved, faults = faulty.unintended, len(np.unique(faulty.cell))
    every = StudyEstimate(faults, of=f"{kinds.count(faulty.faults)}, {len(MOTIONS)} motions")
    lines = [
        Line("faults, distinct", "", None, every),
        Line(
            "faulty runs with unintended motion",
            "runs",
            None,
            StudyEstimate(int(moved.sum()), n=len(moved), of="activated runs of this design"),
        ),
        Line(
            "motion without a fault, robot as modelled",
            "h",
            None,
            StudyEstimate(round(float(modelled.hours.sum()), 2)),
        ),
        *(
            Line(f"AUC, {p.name}", "", None, found.estimate(listed.index(p.name), of=MOVED))
            for p in quiet
        ),
    ]
    for p in quiet:
        lines.append(
            Line(
                f"{p.name}, threshold {p.threshold:g}: unintended motion caught",
                "%",
                None,
                hundred(p.caught),
            )
        )
        if not by_definition(faulty, p.name, p.threshold):
            words = f"{p.name}, threshold {p.threshold:g}: caught before it began"
            lines.append(Line(words, "%", None, hundred(p.before)))
    slow = tables.at_scale(tables.unclutched(modelled), 0.1)
    for name in (p.name for p in quiet if slow.hours.sum() > 0):
        threshold = threshold_for(slow, name)
        if threshold is not None:
            words = (
                f"{name}, threshold {threshold:g}, quiet at scale 0.1 without clutching: unintended"
                " motion caught"
            )
            lines.append(Line(words, "%", None, hundred(caught(faulty, name, threshold))))
    for p in published:
        lines.append(
            Line(
                f"{p.name}, threshold {p.threshold:g}: unintended motion caught",
                "%",
                None,
                hundred(p.caught),
            )
        )
        lines.append(
            Line(f"{p.name}, threshold {p.threshold:g}: false alarms", "1/h", None, p.false)
        )
    for p in spoken:
        lines.append(Line(f"{p.name}: unintended motion caught", "%", None, hundred(p.caught)))
        if not by_definition(faulty, p.name, p.threshold):
            lines.append(Line(f"{p.name}: caught before it began", "%", None, hundred(p.before)))
        lines.append(Line(f"{p.name}: false alarms", "1/h", None, p.false))
    return lines


def _notes(faulty: FaultyScores, modelled: FreeScores, best: Point | None) -> tuple[str, ...]:
    hours, recordings = float(modelled.hours.sum()), len(np.unique(modelled.recording))
    return (
        (
            f"Unintended motion: {events.meaning('unintended_motion', faulty.rules)}. Whether"
            " tip_error and the cue come before it is not asked where they fire at that distance"
            " or beyond: by their definitions they come with it or later. Nor is it asked of a"
            " stop, which ends what could become a motion. That they come at all is no surprise"
            " either; the table by kind of hazard shows how much hangs on it."
        ),
        (
            "Of the built-in checks those count that stop the robot or tell a person: one that"
            " clips a command or drops a packet tells nobody. Beside faults, what a check does on"
            " the golden run, too, is not counted; without a fault every trip is. A robot that was"
            " stopped is not live, so that no unintended motion follows a stop: in the runs that"
            " are counted a stop comes after it, and what stops prevented is in no rate."
        ),
        (
            "The detectors see the virtual robot as its own perfect model: their steps are those of"
            " the simulated motors and links, without a model that runs beside and drifts. A real"
            " detector adds the error of its model to every step, and no figure here holds that."
        ),
        (
            f"Thresholds stand on {hours:.1f} h of generated motion of {recordings} recordings,"
            " robot as modelled. Without any alarm the true rate could still be"
            f" {alarm_rate(0, hours).high:.1f} an hour (95 %, were the hours independent), so that"
            f" at most {PER_HOUR:g} an hour is what was seen, not what is known: to state it takes"
            f" {hours_to_bound(PER_HOUR):.1f} h without any. With a generated operator, whose speed"
            " has a ceiling, more hours add little. Surgeons have no such ceiling."
        ),
        (
            "Which faults there are is a design: the library's own values and sampled ones about"
            " the boundary of unintended motion, so rates compare detectors and are no"
            " probabilities of missing a fault in use. The table by layer shows how much they"
            " differ from place to place."
        ),
        kinds.NOTE,
        *(
            [
                f"{best.name} is the rule of 18 that caught most, picked on these very runs, which"
                " flatters it."
            ]
            if best
            else []
        ),
        (
            "Detectors are armed in pedal-down without a software E-stop, from 0.5 s on: they"
            " cannot speak of a fault that stops the robot at once, and such a run counts as"
            " without alarm. The cue goes on after a stop, where the model moves away from a robot"
            " that stands."
        ),
    )


def _variants() -> tuple[Variant, ...]:
    free = [
        motions_alike.fault_free(
            CAMPAIGN, motion, seed, FREE_RUNS, FREE_S, "How often is there an alarm for nothing?"
        )
        for motion, seed in RECORDINGS
    ]
    noisy = [
        Variant(
            f"noise_{motion}_{seed}",
            CAMPAIGN,
            (
                f"campaign.limit={FREE_RUNS_NOISY}",
                f"campaign.duration_s={FREE_S}",
                "campaign.noise=true",
                f"operator.motion={motion}",
                f"operator.seed={seed}",
            ),
            f"And with noise? {motion}, seed {seed}",
        )
        for motion, seed in NOISY
    ]
    return (
        *motions_alike.faulty(CAMPAIGN),
        Variant(FAST, CAMPAIGN, ("operator.scale=0.2",), "And at twice the scale?"),
        *free,
        *noisy,
    )


STUDY = Study(
    name="detectors",
    title="Which detector knows first, and how often does it cry wolf?",
    source=(
        "a study of our own; detectors of DSN 2016, raven2_sim, IROS 2016 and the control software"
    ),
    question=(
        "Over every layer's faults and hours of motion without one: what does each detector catch,"
        " how early, and how often is it wrong?"
    ),
    variants=_variants(),
    compare=compare,
    minutes=2.0,
)
