"""The cue as a force on a hand: what robot and nominal model do when both follow it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ravenjax.report.sections.reaction.pairs import Pairs
from ravenjax.stages.hand import HandParams, impedance
from ravenjax.stats.intervals import Estimate
from ravenjax.vocabulary.reactions import RELEASE
from studies.framework import kinds
from studies.framework.study import (
    Context,
    Findings,
    Line,
    Study,
    StudyEstimate,
    Table,
    Variant,
)
from studies.hand import pairs as hand_pairs
from studies.hand.pairs import HandEffect
from studies.hand.times import DEFAULT_MS, DELAYS_MS, MEASURED
from studies.reaction import measures, tables
from studies.reaction import pairs as reacting_pairs

CAMPAIGN = "reacting_operator.toml"
SAMPLED = 1500
"""Faults of the campaign that are sampled; they come first, so that a limit leaves out the
library.
"""
SCALE, KP, CAP = 0.1, 4.5, 0.05  # of the campaign; device units per m, device units
MIDDLE, ENDS = 0.5, (0.0, 1.0)
"""Grips: at the first the force is varied, at the others it is the strongest or none."""
FORCES = {
    3.3: "one device unit is 3.3 N",
    66.0: "the cap is 3.3 N",
    -66.0: "null: the same, away from the model",
}
"""N per device unit -> words."""
STRONG = 66.0
FORCE, GRIP, TURNED = "force", "grip", "turned"
"""Variants without a reaction."""
MOVES, STOPPED = "robot not stopped", "robot stopped by a check"
SIZES_MM = (5.0, 10.0, 20.0)


def compare(context: Context) -> Findings:
    """Effects of the force by its size and grip, its nulls, and reaction times."""
    force, grip, turned = (hand_pairs.read(context.folders[name]) for name in (FORCE, GRIP, TURNED))
    settings = [(force, newtons, MIDDLE) for newtons in FORCES] + [
        (grip, STRONG, end) for end in ENDS
    ]
    pairs = {
        (FORCES[newtons], f"{value:g}"): hand_pairs.paired(runs, newtons, value)
        for runs, newtons, value in settings
    }
    pairs["null: the cap is 3.3 N, at a drawn direction", f"{MIDDLE:g}"] = hand_pairs.paired(
        turned, STRONG, MIDDLE
    )
    effects = {
        (*words, robot): hand_pairs.effect(some.where(some.stopped == (robot == STOPPED)), SCALE)
        for words, some in pairs.items()
        for robot in (MOVES, STOPPED)
    }
    released = {
        delay: reacting_pairs.paired(reacting_pairs.read(context.folders[_delayed(delay)]), RELEASE)
        for delay in DELAYS_MS
    }
    return Findings(
        lines=tuple(_lines(effects, released)),
        tables=(_followed(effects), _changed(effects), _loop(), _measured(), _avoided(released)),
        notes=_NOTES,
    )


# --- the force ---


Effects = Mapping[tuple[str, str, str], HandEffect]
"""By force, grip, and whether a check stopped the robot."""


def _lines(effects: Effects, released: Mapping[float, Pairs]) -> Iterator[Line]:
    for (force, grip, robot), one in effects.items():
        where = f"{robot}, {force}, grip {grip}"
        of = f"faults whose cue moves the hand, {kinds.count(one.kinds)}"
        yield _line(
            f"mean change of the distance from the model: {where}", "mm", one.model, one.pulled, of
        )
        yield _line(
            f"mean change of the distance from the golden run: {where}",
            "mm",
            one.golden,
            one.pulled,
            of,
        )
    for delay, part in released.items():
        contrast = reacting_pairs.contrast(part, measures.excursion(20.0))
        of = f"faults that make it where nobody reacts, {kinds.count(contrast.affected)}"
        rate = contrast.avoided
        share = StudyEstimate(100.0 * rate.value, 100.0 * rate.low, 100.0 * rate.high, rate.n, of)
        yield Line(
            f"lifting the pedal after {delay:g} ms avoids, of motions of more than 20 mm",
            "%",
            None,
            share,
        )


def _line(quantity: str, unit: str, value: Estimate, n: int, of: str) -> Line:
    return Line(quantity, unit, None, StudyEstimate(value.value, value.low, value.high, n, of))


def _followed(effects: Effects) -> Table:
    return Table(
        "Who follows the hand",
        (
            "force",
            "grip",
            "robot",
            "faults",
            "with a moved hand",
            "hand, mm",
            "from the model, mm",
            "from the golden run, mm",
            "share that parts robot and model",
            "share that moves the robot",
        ),
        tuple(
            (
                force,
                grip,
                robot,
                one.pairs,
                f"{one.pulled}, {kinds.count(one.kinds)}",
                tables.number(one.hand),
                tables.number(one.model),
                tables.number(one.golden),
                tables.number(one.model_share),
                tables.number(one.golden_share),
            )
            for (force, grip, robot), one in effects.items()
        ),
        "Means over faults whose cue moves the hand, with the force minus without. Hand: its"
        " largest displacement. From the model, from the golden run: root mean square distance of"
        " the true tip over the run. Shares: mean absolute change of that distance, by scale times"
        f" the hand's largest displacement. {kinds.NOTE}",
    )


def _changed(effects: Effects) -> Table:
    return Table(
        "What that changes",
        (
            "force",
            "grip",
            "robot",
            "unintended motions, without",
            "with",
            "change, points",
            "cue, ms",
            "pulls",
            "path of the tip, %",
        ),
        tuple(
            (
                force,
                grip,
                robot,
                *one.unintended,
                tables.number(_times(one.difference, 100.0)),
                tables.number(one.cue_ms),
                tables.number(one.pulses),
                tables.number(_times(one.path, 100.0)),
            )
            for (force, grip, robot), one in effects.items()
        ),
        "Unintended motions: of all faults, the hazard of the report. Cue, pulls, path: mean"
        " changes over faults whose cue moves the hand. A loop that oscillates would pull more"
        " often and lengthen the path.",
    )


def _loop() -> Table:
    """Gain of the loop from the model through the cue and the hand back to the model, of a robot
    that stands still.
    """
    rows = []
    for newtons, words in FORCES.items():
        for grip in (ENDS[0], MIDDLE, ENDS[1]) if newtons > 0 else ():
            stiffness = float(impedance(HandParams(grip, newtons, 0.554, 6.45, 135.0, 5.0, 0.0))[0])
            farthest = CAP * newtons / stiffness * 1e3
            gain = KP * newtons / stiffness
            rows.append(
                (
                    words,
                    grip,
                    f"{farthest:.2g}",
                    f"{SCALE * farthest:.2g}",
                    f"{SCALE * gain:.2g}",
                    f"{1 / gain:.2g}",
                )
            )
    return Table(
        "By statics",
        (
            "force",
            "grip",
            "hand at the cap, mm",
            "tip at the cap, mm",
            "gain of the loop",
            "scale at which it is 1",
        ),
        tuple(rows),
        "Where both follow, the loop is open: the distance from model to robot does not change."
        " Where the robot stands still, the model alone follows, away from the robot, and the cue"
        " grows with it: gain = scale x spring x newtons a unit / stiffness. Below 1 the hand comes"
        " to rest; above, it runs to the cap.",
    )


# --- reaction times ---


def _measured() -> Table:
    rows = [(one.ms, one.stimulus, one.source, one.applies) for one in MEASURED]
    rows.append(
        (
            DEFAULT_MS,
            "the cue's pull, foot off the pedal",
            "assumed: `[reaction] delay_ms`",
            "the default",
        )
    )
    return Table(
        "Measured reaction times",
        ("ms", "stimulus and response", "source", "applies to"),
        tuple((f"{ms:g}", *words) for ms, *words in sorted(rows)),
        "Nobody has measured surgeons at this cue. A driver's time holds the foot's way to another"
        " pedal.",
    )


def _avoided(released: Mapping[float, Pairs]) -> Table:
    rows = []
    for delay, part in released.items():
        contrasts = [reacting_pairs.contrast(part, measures.excursion(size)) for size in SIZES_MM]
        rows.append((f"{delay:g}", contrasts[0].n, *(tables.avoided(one) for one in contrasts)))
    return Table(
        "What an operator of each time avoids by lifting the pedal",
        ("ms", "faults", *(f"of unintended motions of {size:g} mm" for size in SIZES_MM)),
        tuple(rows),
        "Sampled faults in runs of 3 s that strike after 0.6 to 1.6 s: a late reaction falls"
        f" outside some of them. The hand is not moved. {kinds.NOTE}",
    )


def _times(value: Estimate, factor: float) -> Estimate:
    return Estimate(*(factor * part if not math.isnan(part) else np.nan for part in value))


def _delayed(delay_ms: float) -> str:
    return f"delay_{delay_ms:g}"


def _crossed(name: str, values: tuple[float, ...]) -> str:
    return f"cross.hand.{name}=[{', '.join(map(str, values))}]"


_NOTES = (
    (
        "Reference: outcomes compare with the golden run, whose hand is moved by its own cues, if"
        " it has any, and with the nominal model, which follows the hand. So a tip that the cue"
        " alone moves is on its model and no unintended motion; it is off the golden run."
    ),
    (
        "A robot and a model that both follow the hand keep their distance. Faults with a cue are"
        " often such that the robot does not follow its input: a motor, a packet or the robot"
        " itself has stopped. There the model follows alone, and a pull towards the model takes it"
        " farther away. The force of the other sign is the null: it changes that distance as much"
        " the other way."
    ),
    (
        "A person who stiffens against a force that stays, or corrects by eye what it does, is not"
        " in it."
    ),
    (
        "Newtons in a device unit, the grip's factor and everything about an operator are assumed,"
        " see `stages/hand.py`."
    ),
)

_NOBODY = ("cross.reaction.action=[0]", "haptics.threshold_mm=[3]", "hand.grip=0.5")

STUDY = Study(
    name="hand",
    title="The cue as a force on a hand",
    source=(
        "a study of our own; the cue is that of the Raven-II surgical training simulator, IROS 2016"
    ),
    question=(
        "What changes when the cue's force moves the input that robot and model both follow, and"
        " what does not?"
    ),
    variants=(
        Variant(
            FORCE,
            CAMPAIGN,
            (*_NOBODY, _crossed("newtons_per_unit", (0.0, *FORCES)), _crossed("grip", (MIDDLE,))),
        ),
        Variant(
            GRIP,
            CAMPAIGN,
            (*_NOBODY, _crossed("newtons_per_unit", (0.0, STRONG)), _crossed("grip", ENDS)),
            "What does the strongest force do to a relaxed hand and to a firm one?",
        ),
        Variant(
            TURNED,
            CAMPAIGN,
            (
                *_NOBODY,
                _crossed("newtons_per_unit", (0.0, STRONG)),
                _crossed("grip", (MIDDLE,)),
                "parameters.hand.turn_deg={uniform=[-180, 180]}",
            ),
            "What does a force as large do at a direction that is drawn?",
        ),
        *(
            Variant(
                _delayed(delay),
                CAMPAIGN,
                (
                    "cross.reaction.action=[0, 1]",
                    "haptics.threshold_mm=[3]",
                    f"campaign.limit={2 * SAMPLED}",
                    f"parameters.reaction.delay_ms={{choice=[{delay:g}]}}",
                ),
                f"What if the operator acts after {delay:g} ms?",
            )
            for delay in DELAYS_MS
        ),
    ),
    compare=compare,
    minutes=2.0,
)
