"""Would the haptic cue have helped? The same faults with an operator who reacts and with one who
feels nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ravenjax.report.data import draws
from ravenjax.report.sections.reaction.pairs import Pairs
from ravenjax.stats.intervals import Rate
from ravenjax.store import manifest
from ravenjax.vocabulary.reactions import CORRECT, RELEASE, SLOW
from studies.framework import kinds
from studies.framework.study import (
    Context,
    Drawing,
    Findings,
    Line,
    Study,
    StudyEstimate,
    Variant,
)
from studies.reaction import drawings, fault_free, measures, tables, times
from studies.reaction import pairs as reacting_pairs
from studies.reaction.drawings import ContrastRow
from studies.reaction.fault_free import FreeReactions
from studies.reaction.measures import SIZES_MM, Measure
from studies.reaction.pairs import Contrast, ReactionRuns
from studies.reaction.times import Advance

CAMPAIGN, FREE = "reacting_operator.toml", "reacting_operator_free.toml"
BASELINE = "pairs"
SAMPLED = 1500
"""Faults of the campaign that are sampled; they come first, so that a limit leaves out the
library.
"""
THRESHOLDS_MM = (3.0, 1.0, 2.0, 5.0)
"""Of the campaigns' haptic sets, in their order."""
BLOCKS = {
    "threshold": {
        "threshold_1": ("threshold 1 mm", ("haptics.threshold_mm=[1]",)),
        "threshold_2": ("threshold 2 mm", ("haptics.threshold_mm=[2]",)),
        BASELINE: ("threshold 3 mm, published", ()),
        "threshold_5": ("threshold 5 mm", ("haptics.threshold_mm=[5]",)),
    },
    "reaction time": {
        "delay_150": ("150 ms", ("parameters.reaction.delay_ms={choice=[150]}",)),
        "delay_250": ("250 ms", ("parameters.reaction.delay_ms={choice=[250]}",)),
        "delay_400": ("400 ms", ("parameters.reaction.delay_ms={choice=[400]}",)),
    },
    "gain and touch": {
        "gain_half": (
            "half the gain",
            ("haptics.kp_per_mm=[0.00225]", "haptics.kd_per_mm_s=[0.000045]"),
        ),
        "gain_double": (
            "double the gain",
            ("haptics.kp_per_mm=[0.009]", "haptics.kd_per_mm_s=[0.00018]"),
        ),
        "every_pull": ("every pull is felt", ("parameters.reaction.felt_force={choice=[0.0]}",)),
    },
}
"""Block -> variant -> its words, and what it changes. The baseline stands among the thresholds.
What is no longer drawn is still a choice, of one: a design of as many axes draws the same faults.
"""
MOTIONS = ("suture", "peg_transfer")
DRAWN_SIZES = (5.0, 10.0)
SPARED_MM = 10.0
HEADLINE_SCALES = (0.1, 0.2)
HEADLINE_CUES_MM = (1.0, 3.0)
EARLY = {1.0: "threshold 1 mm", 2.0: "threshold 2 mm"}
"""Thresholds below the smallest motion, and the words of their variants."""


def compare(context: Context) -> Findings:
    """Pairs, other cues and operators, times, and the price on fault-free motion."""
    runs = reacting_pairs.read(context.folders[BASELINE])
    pairs = {action: reacting_pairs.paired(runs, action) for action in (RELEASE, SLOW, CORRECT)}
    others = [(block, words, part) for block, words, part in _variants(context, pairs[RELEASE])]
    timed = [runs, *(reacting_pairs.read(context.folders[_timed(size)]) for size in SIZES_MM[1:])]
    advances = _advances(timed)
    spared = times.left_by_time(timed[SIZES_MM.index(SPARED_MM)], runs, pairs[RELEASE])
    drawn_groups = draws.groups(manifest.read(context.folders[BASELINE]).config) or ()
    free = [
        one
        for motion in MOTIONS
        for one in fault_free.free(
            reacting_pairs.read(context.folders[f"free_{motion}"]), THRESHOLDS_MM
        )
    ]
    released = pairs[RELEASE]
    two = tuple(map(measures.excursion, DRAWN_SIZES))
    early = {
        threshold: part
        for threshold, words in EARLY.items()
        for _, name, part in others
        if name == words
    }
    return Findings(
        lines=tuple(_lines(pairs, early, advances, free)),
        tables=(
            tables.reactions(pairs),
            tables.fairness(),
            tables.sizes(pairs),
            tables.variants([(f"{block}: {words}", part) for block, words, part in others], two),
            tables.early(early, measures.excursion(SIZES_MM[0])),
            tables.advances(advances),
            tables.had_time(spared, SPARED_MM),
            tables.split(
                "Lifting the pedal, by how soon the unintended motion begins",
                "fault",
                released,
                reacting_pairs.by_speed(released),
                two,
            ),
            tables.sites(released, measures.excursion(SPARED_MM), drawn_groups),
            tables.split(
                "Lifting the pedal, by layer of the fault",
                "layer",
                released,
                reacting_pairs.by_layer(released),
                two,
            ),
            tables.split(
                "Lifting the pedal, by design and by hazard of the library",
                "faults",
                released,
                {**reacting_pairs.by_design(released), **reacting_pairs.by_scenario(released)},
                two,
            ),
            tables.price(free),
        ),
        drawings=(
            Drawing(
                "leads",
                "Share of unintended motions that are still to come when an operator of a given"
                " reaction time acts on the cue, where nobody did; shaded: 150 to 400 ms. Of this"
                " design's faults.",
                drawings.leads(advances),
            ),
            Drawing(
                "rates",
                "Faults of this design that move the instrument, with and without a reaction, by"
                " measures that are fair for it.",
                drawings.rates(list(_rate_rows(pairs))),
            ),
            Drawing(
                "differences",
                "Unintended motion with the operator who lifts the pedal minus without, under other"
                " cues and other operators; left of 0 the cue helps. Sampled faults; bars: 95 %"
                " over kinds.",
                drawings.differences(
                    list(_variant_rows(others)), "points of 100 faults of the design"
                ),
            ),
        ),
        notes=_notes(runs),
    )


def _variants(context: Context, baseline: Pairs) -> Iterator[tuple[str, str, Pairs]]:
    for block, variants in BLOCKS.items():
        for name, (words, _) in variants.items():
            part = baseline
            if name != BASELINE:
                part = reacting_pairs.paired(reacting_pairs.read(context.folders[name]), RELEASE)
            yield block, words, part.where(reacting_pairs.by_design(part)["sampled faults"])


def _timed(size_mm: float) -> str:
    """Variant in which nobody reacts and this size is the limit; that of the smallest is the
    baseline.
    """
    return f"timed_{size_mm:g}"


def _advances(timed: Sequence[ReactionRuns]) -> list[Advance]:
    """Of motions of each size, and of jumps, at each threshold."""
    alone = [times.unreacted(runs) for runs in timed]
    return [
        times.advance(runs, cue, threshold, jump)
        for cue, threshold in sorted(enumerate(THRESHOLDS_MM), key=lambda item: item[1])
        for runs, jump in [*((runs, False) for runs in alone), (alone[0], True)]
    ]


# --- lines ---


def _lines(
    pairs: Mapping[int, Pairs],
    early: Mapping[float, Pairs],
    advances: list[Advance],
    free: list[FreeReactions],
) -> Iterator[Line]:
    """early: thresholds below the smallest motion -> pairs of sampled faults with a lifted
    pedal.
    """
    released = pairs[RELEASE]
    for measure in map(measures.excursion, SIZES_MM[1:]):
        yield _avoided(released, measure, f"lifting the pedal avoids, of {measure.name}")
    for threshold, part in early.items():
        measure = measures.excursion(SIZES_MM[0])
        yield _avoided(
            part,
            measure,
            f"lifting the pedal at a cue of {threshold:g} mm avoids, of {measure.name}",
        )
    for measure in map(measures.excursion, DRAWN_SIZES):
        yield _line(
            f"lifted pedals for each one avoided: {measure.name}",
            "",
            _needed(reacting_pairs.contrast(released, measure)),
        )
    for action, measure in (
        (SLOW, measures.live(SPARED_MM)),
        (CORRECT, measures.excursion(SPARED_MM)),
    ):
        yield _avoided(pairs[action], measure, f"{tables.words(action)}, avoids, of {measure.name}")
    for action, measure in (
        (RELEASE, measures.INJURY),
        (CORRECT, measures.INJURY),
        (SLOW, measures.live(SIZES_MM[0])),
    ):
        contrast = reacting_pairs.contrast(pairs[action], measure)
        words = f"{tables.words(action)}, only with the reaction: {measure.name}"
        count = StudyEstimate(
            contrast.caused, n=contrast.n - contrast.without, of="faults without it otherwise"
        )
        yield _line(words, "faults", count)
    for one in advances:
        if one.threshold_mm in HEADLINE_CUES_MM and not tables.defined(one):
            words = f"{tables.size(one.size_mm)}: came too soon for any reaction of 250 ms"
            share = _percent(one.late[250], f"faults that make it, {kinds.count(one.kinds)}")
            yield _line(f"{words}, cue at {one.threshold_mm:g} mm", "%", share)
    idle = {"unintended motion": tables.unmoved_rate, "any hazard": tables.idle_rate}
    acted = (released.with_frame["reaction_ms"] >= 0).to_numpy()
    behind = kinds.count(reacting_pairs.kinds_of(released).where(acted))
    for words, rate in idle.items():
        value = _percent(rate(released), f"reactions, {behind}")
        yield _line(f"reactions to faults without {words}", "%", value)
    for one in free:
        if one.threshold_mm == THRESHOLDS_MM[0] and one.scale in HEADLINE_SCALES:
            first = one.first
            value = StudyEstimate(
                first.per_hour,
                first.low,
                first.high,
                first.count,
                f"first cues in {first.hours:.2f} h",
            )
            yield _line(
                f"interruptions of fault-free motion, {one.motion}, scale {one.scale:g}",
                "per hour",
                value,
            )


def _line(quantity: str, unit: str, value: StudyEstimate) -> Line:
    return Line(quantity, unit, None, value)


def _avoided(pairs: Pairs, measure: Measure, words: str) -> Line:
    contrast = reacting_pairs.contrast(pairs, measure)
    of = f"faults that make it where nobody reacts, {kinds.count(contrast.affected)}"
    return _line(words, "%", _percent(contrast.avoided, of))


def _percent(rate: Rate, of: str) -> StudyEstimate:
    return StudyEstimate(100 * rate.value, 100 * rate.low, 100 * rate.high, rate.n, of)


def _needed(found: Contrast) -> StudyEstimate:
    return StudyEstimate(
        *found.needed, found.acted, f"reactions to faults of {kinds.count(found.reacted)}"
    )


# --- drawings ---


def _rate_rows(pairs: Mapping[int, Pairs]) -> Iterator[ContrastRow]:
    panels = {
        "unintended motion, live or not": (measures.excursion, (RELEASE, CORRECT)),
        "off the model, live": (measures.live, (RELEASE, SLOW)),
    }
    for block, (measure, actions) in panels.items():
        for size in SIZES_MM:
            for action in actions:
                contrast = reacting_pairs.contrast(pairs[action], measure(size))
                yield ContrastRow(block, f"{size:g} mm", tables.words(action), contrast)


def _variant_rows(others: list[tuple[str, str, Pairs]]) -> Iterator[ContrastRow]:
    for block, words, part in others:
        for size in DRAWN_SIZES:
            contrast = reacting_pairs.contrast(part, measures.excursion(size))
            yield ContrastRow(block, words, f"more than {size:g} mm", contrast)


def _notes(runs: ReactionRuns) -> tuple[str, ...]:
    failed = np.count_nonzero(runs.facts["failed"])
    idle = np.count_nonzero(~runs.facts["activated"] & (runs.facts["action"] == 0))
    return (
        (
            "Assumptions, none of them fitted to an outcome: the law of reaction times, the weakest"
            " pull that is noticed, slowed hands at a quarter of their speed, a correction by eye"
            " with a time constant of 0.2 s. The variants show how much hangs on reaction time,"
            " threshold, gain and touch."
        ),
        (
            "The faults are a design over layers, magnitudes and lengths around the boundary of"
            " unintended motion, and the library's rows with the values of their sources. Nobody"
            " knows how often each occurs, so a share of all of them is no probability of an"
            " operation. What carries over is the comparison within each fault, and who has time."
        ),
        (
            "Faults of one kind resemble each other: they strike one signal with one effect. How"
            " sure a share is depends on the number of kinds and not on that of faults, so that"
            " intervals resample kinds; where one kind makes most of what is counted, they are"
            " wide."
        ),
        (
            "What a cue avoids of motions of its own threshold is in no line: motion and cue are"
            " there at the same moment, by their definitions. A cue at 1 mm beside a motion of 3"
            " mm, and one at 3 mm beside motions of 5 mm and more, are findings. What a reaction"
            " makes worse is one at every size."
        ),
        (
            "An operator who lifts the pedal stops the arm by its brakes, 15 ms after the software"
            " has heard it; what the fault does behind the software in that time, or to a robot"
            " whose brakes are the fault, is in the runs."
        ),
        (
            "Context, not compared: a context-aware detector of unsafe events on recorded tasks is"
            " published with 1.7 s before the hazard for faults and 57 ms for human errors (Yasar"
            " and Alemzadeh, DSN 2020); mitigation by a controller, not by a person, prevented 54 %"
            " of hazards of an artificial pancreas (Zhou et al., DSN 2021). No experiment with"
            " operators and this cue on faults like these has been published."
        ),
        (
            f"{idle} faults changed no bit and {failed} runs gave no valid outcome; neither is in a"
            " table."
        ),
    )


def _alternatives() -> Iterator[Variant]:
    few = ("cross.reaction.action=[0, 1]", f"campaign.limit={2 * SAMPLED}")
    for block, variants in BLOCKS.items():
        for name, (words, overrides) in variants.items():
            if name != BASELINE:
                yield Variant(
                    name, CAMPAIGN, (*few, *overrides), f"Another {block}: {words}; sampled faults"
                )


STUDY = Study(
    name="reacting_operator",
    title="Would the haptic cue have helped?",
    source=(
        "a study of our own; the cue is that of the Raven-II surgical training simulator, IROS 2016"
    ),
    question=(
        "Of the unintended motion that faults make, how much does an operator avoid who feels the"
        " cue and reacts? At what price?"
    ),
    variants=(
        Variant(BASELINE, CAMPAIGN),
        *_alternatives(),
        *(
            Variant(
                _timed(size),
                CAMPAIGN,
                ("cross.reaction.action=[0]", f"outcomes.limit_mm={size:g}"),
                f"When is an unintended motion of {size:g} mm there, where nobody reacts?",
            )
            for size in SIZES_MM[1:]
        ),
        *(
            Variant(
                f"free_{motion}",
                FREE,
                (f"operator.motion={motion}",),
                f"What without a fault? {motion}",
            )
            for motion in MOTIONS
        ),
    ),
    compare=compare,
    minutes=1.5,
)
