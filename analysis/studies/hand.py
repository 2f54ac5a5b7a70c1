"""Study: the cue as a force on a hand, and what robot and nominal model do when both follow that
hand.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections.reaction import Pairs
from ravenjax.stages.hand import HandParams, hand_impedance
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate
from ravenjax.store import folder, manifest
from ravenjax.vocabulary.reactions import RELEASE
from studies import kinds, reacting_operator
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    own_line,
    read_notes,
    study,
    table,
)


class MeasuredTime(NamedTuple):
    """One published time from a stimulus to an action."""

    stimulus: str
    ms: float
    source: str
    applies: str  # the situation to which it applies


MEASURED = (
    MeasuredTime(
        "touch, expected, one response",
        155.0,
        "Robinson 1934, in Kosinski, A Literature Review on Reaction Time, Clemson University",
        "laboratory, hand on a key: the fastest that a cue can be",
    ),
    MeasuredTime(
        "sight, expected, one response",
        190.0,
        "180 to 200 ms, Welford 1980 and others in Kosinski's review; sound 140 to 160 ms",
        "laboratory: an operator who sees the instrument move and waits for it",
    ),
    MeasuredTime(
        "recognition, one response to some stimuli and none to others",
        384.0,
        "Laming 1968, in Kosinski's review; simple reactions of the same study 220 ms",
        "an operator who must tell a cue from another force",
    ),
    MeasuredTime(
        "brake light, time and place known, foot moves to the brake",
        725.0,
        "0.70 to 0.75 s, Green, Transportation Human Factors 2(3), 2000",
        "a foot that acts while the hands are busy, warned",
    ),
    MeasuredTime(
        "unexpected but common signal, foot moves to the brake",
        1250.0,
        "Green 2000",
        "an operator who knows the cue and does not wait for it",
    ),
    MeasuredTime(
        "surprise, foot moves to the brake",
        1500.0,
        "Green 2000; 1.0 to 1.3 s where it is urgent (Summala, Transportation Human Factors 2(3),"
        " 2000)",
        "an operator who has never had a cue",
    ),
)
"""Published times, sorted. Nobody has measured surgeons at this cue. Drivers' times include the
foot's way from one pedal to the other.
"""

DEFAULT_MS = 250.0
"""Default of `[reaction] delay_ms`, assumed."""

DELAYS_MS = tuple(sorted({*(one.ms for one in MEASURED), DEFAULT_MS}))


NEWTONS_COLUMN, GRIP_COLUMN, TURN_COLUMN = (
    "param:hand.newtons_per_unit",
    "param:hand.grip",
    "param:hand.turn_deg",
)


class HandRuns(NamedTuple):
    """A campaign's result table and its facts, rows in the same order."""

    frame: pd.DataFrame
    facts: pd.DataFrame


class HandPairs(NamedTuple):
    """Faults that changed a bit, one row each in the same order: with a force, and without."""

    on: HandRuns
    off: HandRuns

    @property
    def faults(self) -> Units:
        """Return the kinds of these faults."""
        return kinds.of(self.off.facts["group"])

    @property
    def stopped(self) -> np.ndarray:
        """Return pairs in which a check stopped one of the robots, bool [pairs]. Then only the
        model follows the hand.
        """
        on, off = ((part.frame["response"] == "stopped").to_numpy(bool) for part in self)
        return on | off

    def where(self, chosen: np.ndarray) -> HandPairs:
        """Return the pairs that `chosen` selects (bool [pairs])."""
        return HandPairs(
            *(HandRuns(part.frame.loc[chosen], part.facts.loc[chosen]) for part in self)
        )

    def change(self, column: str) -> np.ndarray:
        """Return the change of a column, with the force minus without, [pairs]."""
        on, off = (part.frame[column].to_numpy(float) for part in self)
        return on - off


class HandEffect(NamedTuple):
    """What a force on the hand changed, over the faults in which it moved one. Intervals are over
    kinds of faults.
    """

    pairs: int  # number of faults
    pulled: int  # of these: faults in which the hand moved
    kinds: Units  # kinds of faults in which the hand moved
    hand: Estimate  # mm, mean of the largest displacement
    model: Estimate  # mm, mean change of the root mean square distance from the model
    golden: Estimate  # mm, mean change of the root mean square distance from the golden run
    # Mean absolute change of the distance from the model, as a fraction of the commanded motion of
    # the tip.
    model_share: Estimate
    golden_share: Estimate  # the same of the distance from the golden run
    cue_ms: Estimate  # mean change of the cue's time
    pulses: Estimate  # mean change of the number of separate pulls
    path: Estimate  # mean change of the tip's path, as a share of the path
    unintended: tuple[int, int]  # faults with an unintended motion: without and with the force
    difference: Estimate  # difference of their shares of all pairs


def read(path: Path) -> HandRuns:
    """Read the runs of a result folder. Raises StoreError."""
    frame, header = folder.read_all(path), manifest.read_manifest(path)
    return HandRuns(frame, run_facts.derive_from_manifest(frame, header))


def paired(runs: HandRuns, newtons: float, grip: float) -> HandPairs:
    """Return every fault that changed a bit, with that force per unit and that grip, and without a
    force.

    Raises ValueError if the campaign has no such runs.
    """
    at_grip = np.isclose(runs.frame[GRIP_COLUMN], grip)
    on, off = (at_grip & np.isclose(runs.frame[NEWTONS_COLUMN], value) for value in (newtons, 0.0))
    if not on.any() or on.sum() != off.sum():
        raise ValueError(
            f"the campaign has {on.sum()} runs of {newtons:g} N a unit at grip {grip:g},"
            f" {off.sum()} of 0"
        )
    order = [
        np.flatnonzero(mask)[np.argsort(runs.frame.loc[mask, "pair"].to_numpy())]
        for mask in (on, off)
    ]
    both = HandPairs(*(HandRuns(runs.frame.iloc[rows], runs.facts.iloc[rows]) for rows in order))
    valid = ~(both.on.facts["failed"].to_numpy(bool) | both.off.facts["failed"].to_numpy(bool))
    return both.where(valid & both.off.facts["activated"].to_numpy(bool))


def effect(pairs: HandPairs, scale: float) -> HandEffect:
    """Return what the force changed. `scale`: teleoperation scale."""
    moved = (pairs.on.frame["hand_mm"] > 0).to_numpy()
    pulled = pairs.where(moved)
    among = pulled.faults
    hand_mm = pulled.on.frame["hand_mm"].to_numpy(float)
    model, golden = (pulled.change(f"rms_{name}_deviation_mm") for name in ("model", "golden"))
    hits = [part.facts["unintended"].to_numpy(bool) for part in pairs]
    return HandEffect(
        len(moved),
        int(moved.sum()),
        among,
        _ratio(hand_mm, 1.0, among),
        _ratio(model, 1.0, among),
        _ratio(golden, 1.0, among),
        _ratio(np.abs(model), scale * hand_mm, among),
        _ratio(np.abs(golden), scale * hand_mm, among),
        _ratio(pulled.change("cue0_ms"), 1.0, among),
        _ratio(pulled.change("cue0_count"), 1.0, among),
        _ratio(
            pulled.change("tip_path_mm"), pulled.off.frame["tip_path_mm"].to_numpy(float), among
        ),
        (int(hits[1].sum()), int(hits[0].sum())),
        kinds.difference(hits[0], hits[1], pairs.faults),
    )


def _ratio(above: np.ndarray, below: np.ndarray | float, among: Units) -> Estimate:
    band = units.ratio_band(above, below, among)
    return Estimate(band.value, band.low, band.high)


CAMPAIGN = "reacting_operator.toml"
SAMPLED = 1500
"""Number of sampled faults of the campaign. They come first, so that a limit leaves out the
library.
"""
SCALE, KP, CAP = 0.1, 4.5, 0.05  # as in the campaign; device units per m, device units
MIDDLE, ENDS = 0.5, (0.0, 1.0)
"""Grips. At the first the force is varied; at the others it is either the strongest or none."""
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
    """Compare effects of the force by its size and grip, with their null models, and reaction
    times.
    """
    force, grip, turned = (read(context.folders[name]) for name in (FORCE, GRIP, TURNED))
    settings = [(force, newtons, MIDDLE) for newtons in FORCES] + [
        (grip, STRONG, end) for end in ENDS
    ]
    pairs = {
        (FORCES[newtons], f"{value:g}"): paired(runs, newtons, value)
        for runs, newtons, value in settings
    }
    pairs["null: the cap is 3.3 N, at a drawn direction", f"{MIDDLE:g}"] = paired(
        turned, STRONG, MIDDLE
    )
    effects = {
        (*words, robot): effect(some.where(some.stopped == (robot == STOPPED)), SCALE)
        for words, some in pairs.items()
        for robot in (MOVES, STOPPED)
    }
    released = {
        delay: reacting_operator.paired(
            reacting_operator.read(context.folders[_delayed(delay)]), RELEASE
        )
        for delay in DELAYS_MS
    }
    return Findings(
        lines=tuple(_lines(effects, released)),
        tables=(_followed(effects), _changed(effects), _loop(), _measured(), _avoided(released)),
        notes=read_notes("hand"),
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
        contrast = reacting_operator.contrast_of(part, reacting_operator.excursion(20.0))
        of = f"faults that make it where nobody reacts, {kinds.count(contrast.affected)}"
        rate = contrast.avoided
        share = StudyEstimate(100.0 * rate.value, 100.0 * rate.low, 100.0 * rate.high, rate.n, of)
        yield own_line(
            f"lifting the pedal after {delay:g} ms avoids, of motions of more than 20 mm",
            "%",
            share,
        )


def _line(quantity: str, unit: str, value: Estimate, n: int, of: str) -> Line:
    return own_line(quantity, unit, StudyEstimate(value.value, value.low, value.high, n, of))


def _followed(effects: Effects) -> Table:
    return table(
        "Who follows the hand",
        [
            {
                "force": force,
                "grip": grip,
                "robot": robot,
                "faults": one.pairs,
                "with a moved hand": f"{one.pulled}, {kinds.count(one.kinds)}",
                "hand, mm": reacting_operator.number(one.hand),
                "from the model, mm": reacting_operator.number(one.model),
                "from the golden run, mm": reacting_operator.number(one.golden),
                "share that parts robot and model": reacting_operator.number(one.model_share),
                "share that moves the robot": reacting_operator.number(one.golden_share),
            }
            for (force, grip, robot), one in effects.items()
        ],
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
                reacting_operator.number(_times(one.difference, 100.0)),
                reacting_operator.number(one.cue_ms),
                reacting_operator.number(one.pulses),
                reacting_operator.number(_times(one.path, 100.0)),
            )
            for (force, grip, robot), one in effects.items()
        ),
        "Unintended motions: of all faults, the hazard of the report. Cue, pulls, path: mean"
        " changes over faults whose cue moves the hand. A loop that oscillates would pull more"
        " often and lengthen the path.",
    )


def _loop() -> Table:
    """Return the gain of the loop from the model through the cue and the hand back to the model,
    for a robot at rest.
    """
    rows = []
    for newtons, words in FORCES.items():
        for grip in (ENDS[0], MIDDLE, ENDS[1]) if newtons > 0 else ():
            stiffness = float(
                hand_impedance(HandParams(grip, newtons, 0.554, 6.45, 135.0, 5.0, 0.0))[0]
            )
            farthest = CAP * newtons / stiffness * 1e3
            gain = KP * newtons / stiffness
            rows.append(
                {
                    "force": words,
                    "grip": grip,
                    "hand at the cap, mm": f"{farthest:.2g}",
                    "tip at the cap, mm": f"{SCALE * farthest:.2g}",
                    "gain of the loop": f"{SCALE * gain:.2g}",
                    "scale at which it is 1": f"{1 / gain:.2g}",
                }
            )
    return table(
        "By statics",
        rows,
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
        contrasts = [
            reacting_operator.contrast_of(part, reacting_operator.excursion(size))
            for size in SIZES_MM
        ]
        rows.append(
            (f"{delay:g}", contrasts[0].n, *(reacting_operator.avoided(one) for one in contrasts))
        )
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


_NOBODY = ("cross.reaction.action=[0]", "haptics.threshold_mm=[3]", "hand.grip=0.5")

STUDY = study(
    "hand",
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
)
