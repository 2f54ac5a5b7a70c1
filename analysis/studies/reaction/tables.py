"""Tables of the study of the reacting operator."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from ravenjax.report import wording
from ravenjax.report.sections.reaction.pairs import EXCURSION, Pairs
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate, wilson
from ravenjax.vocabulary.reactions import ACTIONS, CORRECT, MEANINGS, RELEASE, SLOW
from studies.framework import kinds
from studies.framework.study import Table
from studies.reaction.fault_free import FreeReactions
from studies.reaction.measures import MEASURES, Measure
from studies.reaction.pairs import Contrast, adjusted, contrast, kinds_of, mean_change
from studies.reaction.times import DELAYS_MS, Advance

Cell = str | int | float
COLUMNS = (
    "faults",
    "kinds of faults",
    "with it, nobody reacts",
    "with it, operator reacts",
    "avoided, of those with it",
    "made worse",
    "p (Holm)",
    "reactions",
    "reactions for each avoided",
)
NOTE = (
    "A fault is run twice under the same random numbers, with the operator who reacts and without;"
    " only faults that changed a bit. Avoided: of the faults that have it where nobody reacts,"
    " those that have it no more. Made worse: faults that have it with the reaction alone. p: both"
    " runs exchanged kind by kind, exact, all rows of the table together (Holm). Reactions: faults"
    " to which the operator reacts. Reactions for each avoided: number needed to cue; ∞ where none"
    f" is avoided. {kinds.NOTE}"
)

SAME = "Columns and intervals as in the first table."


def words(action: int) -> str:
    """An action."""
    return MEANINGS[ACTIONS[action]]


def contrast_rows(
    found: Sequence[tuple[tuple[Cell, ...], Contrast]],
) -> tuple[tuple[Cell, ...], ...]:
    """Rows of COLUMNS, each behind its own heads."""
    p = adjusted([one for _, one in found])
    return tuple(
        (
            *heads,
            one.n,
            kinds.count(one.kinds),
            one.without,
            one.with_,
            avoided(one),
            one.caused,
            wording.number(holm, 2),
            one.acted,
            number(one.needed),
        )
        for (heads, one), holm in zip(found, p, strict=True)
    )


def reactions(pairs: Mapping[int, Pairs]) -> Table:
    """What each reaction changes, by every measure that is fair for it."""
    rows = [
        ((words(action), measure.name), contrast(part, measure))
        for action, part in pairs.items()
        for measure in MEASURES
        if action in measure.fair
    ]
    return Table(
        "What the cue changes, by reaction and measure",
        ("reaction", "measure", *COLUMNS),
        contrast_rows(rows),
        NOTE,
    )


def split(
    title: str, head: str, pairs: Pairs, classes: Mapping[str, np.ndarray], by: Sequence[Measure]
) -> Table:
    """What lifting the pedal changes, by class of fault."""
    rows = [
        ((name, measure.name), contrast(pairs.where(mine), measure))
        for name, mine in classes.items()
        for measure in by
        if mine.any()
    ]
    return Table(title, (head, "measure", *COLUMNS), contrast_rows(rows), SAME)


def fairness() -> Table:
    """For which reaction which measure is fair."""
    why = {
        "off the model": {
            RELEASE: "fair while live; motion after the pedal was lifted is not seen",
            CORRECT: "no: the model moves with the correction, away from the robot",
        },
        "live or not": {SLOW: "no: slow hands stay behind the golden run on purpose"},
        "of the report": {
            RELEASE: "fair while live; motion after the pedal was lifted is not seen",
            SLOW: "no: slow hands stay behind the golden run on purpose",
        },
    }

    def cell(measure: Measure, action: int) -> str:
        reasons = next((rows for words, rows in why.items() if words in measure.name), {})
        return reasons.get(action, "fair" if action in measure.fair else "no")

    actions = (RELEASE, SLOW, CORRECT)
    return Table(
        "Which measure is fair for which reaction",
        ("measure", *map(words, actions)),
        tuple(
            (measure.name, *(cell(measure, action) for action in actions)) for measure in MEASURES
        ),
        "After the operator reacts, the nominal model does what the hands do then, and the golden"
        " run what they would have done. A measure that is not fair is not in the other tables. Off"
        " the model counts a robot that stands while it should move; unintended motion does not.",
    )


def sizes(pairs: Mapping[int, Pairs]) -> Table:
    """Mean change of lengths and times."""
    columns = {
        EXCURSION: (RELEASE, CORRECT),
        "peak_live_deviation_mm": (RELEASE, SLOW),
        "tissue_depth_mm": (RELEASE, SLOW, CORRECT),
        "pedal_down_ms": (RELEASE,),
    }
    rows = []
    for action, part in pairs.items():
        acted = part.where((part.with_frame["reaction_ms"] >= 0).to_numpy())
        for column, fair in columns.items():
            if action in fair and len(acted.with_frame):
                rows.append(
                    (
                        words(action),
                        column,
                        len(acted.with_frame),
                        number(mean_change(acted, column)),
                    )
                )
    return Table(
        "Mean change where the operator acted",
        ("reaction", "column", "faults", "with minus without"),
        tuple(rows),
        f"Bootstrap over kinds of faults, 95 %. `{EXCURSION}`: the larger of `unintended_mm` and"
        " `unintended_off_mm`.",
    )


def variants(found: Iterable[tuple[str, Pairs]], by: Sequence[Measure]) -> Table:
    """What lifting the pedal changes under other cues and other operators, sampled faults alone."""
    questions = [(name, part, measure) for name, part in found for measure in by]
    rows = contrast_rows(
        [((name, measure.name), contrast(part, measure)) for name, part, measure in questions]
    )
    idle = [idle_rate(part) for _, part, _ in questions]
    return Table(
        "Other thresholds, gains and reaction times: lifting the pedal, sampled faults",
        ("cue and operator", "measure", *COLUMNS, "reactions where no hazard was coming"),
        tuple((*row, rate(extra)) for row, extra in zip(rows, idle, strict=True)),
        SAME
        + " No hazard was coming: of the reactions, those to a fault without any hazard even where"
        " nobody reacts.",
    )


def idle_rate(pairs: Pairs) -> Rate:
    """Of the reactions, those to a fault that has no hazard even where nobody reacts."""
    return _of_reactions(pairs, (pairs.without_facts["hazard"] == "none").to_numpy())


def unmoved_rate(pairs: Pairs) -> Rate:
    """Of the reactions, those to a fault that makes no unintended motion even where nobody
    reacts.
    """
    return _of_reactions(pairs, ~pairs.without_facts["unintended"].to_numpy(bool))


def _of_reactions(pairs: Pairs, holds: np.ndarray) -> Rate:
    acted = (pairs.with_frame["reaction_ms"] >= 0).to_numpy()
    return units.rate(holds[acted], kinds_of(pairs).where(acted))


def advances(found: Sequence[Advance]) -> Table:
    """How much time the cue leaves."""
    return Table(
        "From the cue to the unintended motion, where nobody reacts",
        (
            "cue at, mm",
            "motion",
            "faults that make it",
            "kinds of faults",
            "cue before it",
            "lead of half the faults, ms",
            "lead of the quarter with most time, ms",
            *(f"too soon for {delay} ms" for delay in DELAYS_MS),
        ),
        tuple(
            (
                one.threshold_mm,
                size(one.size_mm),
                one.lead.n,
                kinds.count(one.kinds),
                rate(one.before),
                number(one.half_ms),
                number(one.quarter_ms),
                *(rate(late) for late in one.late.values()),
            )
            for one in found
            if not defined(one)
        ),
        "The motion is the hazard of the report, with a limit of so much. Lead: Kaplan-Meier, a cue"
        " that never came is censored at the end of the run; – where so many runs never had one."
        " Too soon: the motion came in that time after the cue, at the cue, or without one; no"
        " reaction of that time can prevent it. A motion of the cue's own threshold is not listed:"
        " both are distances from one model, and that the cue is there by then is no finding.",
    )


def defined(one: Advance) -> bool:
    """Whether the cue fires at the size of the motion or above: the definitions alone decide
    that it is no earlier.
    """
    return one.size_mm is not None and one.threshold_mm >= one.size_mm


def had_time(classes: Mapping[str, tuple[Rate, Units]], size_mm: float) -> Table:
    """Whether those were spared that had time: name -> of the motions without the reaction,
    those gone with it.
    """
    return Table(
        f"Who was spared {size_mm:g} mm by lifting the pedal, by the time there was",
        (
            "time from cue to motion, less the operator's own reaction time",
            "motions without",
            "still with",
            "spared",
        ),
        tuple(
            (name, spared.n, spared.n - spared.k, of_kinds(spared, among))
            for name, (spared, among) in classes.items()
            if spared.n
        ),
        "Motion as in the table before. Spared: no unintended motion of that size, live or not,"
        " with the reaction.",
    )


def early(pairs: Mapping[float, Pairs], by: Measure) -> Table:
    """What lifting the pedal changes where the cue comes at a smaller distance than the motion;
    pairs by threshold.
    """
    rows = [
        ((f"{threshold:g} mm", by.name), contrast(part, by)) for threshold, part in pairs.items()
    ]
    return Table(
        "A cue at less than the motion: lifting the pedal, sampled faults",
        ("cue", "measure", *COLUMNS),
        contrast_rows(rows),
        SAME,
    )


def sites(pairs: Pairs, by: Measure, drawn_groups: Collection[str]) -> Table:
    """What lifting the pedal avoids, kind by kind of fault; kinds without such a motion are left
    out.
    """
    group = pairs.with_facts["group"].to_numpy().astype(str)
    names, sampled = kinds.names(group), np.isin(group, sorted(drawn_groups))
    layers = pairs.with_facts["layer"].to_numpy()
    rows = []
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        one = contrast(pairs.where(mine), by)
        if not one.without and not one.caused:
            continue
        is_drawn = bool(sampled[mine].all())
        spared = wilson(one.avoided.k, one.avoided.n) if is_drawn and one.avoided.n else one.avoided
        cells = f"{one.n} {'faults drawn' if is_drawn else 'cells of the design'}"
        rows.append((name, str(layers[mine][0]), cells, one.without, rate(spared), one.caused))
    return Table(
        f"Lifting the pedal, by kind of fault: {by.name}",
        (
            "kind of fault",
            "layer",
            "faults",
            "with it, nobody reacts",
            "avoided, of those with it",
            "made worse",
        ),
        tuple(rows),
        "Where a kind's faults were drawn: Wilson, 95 %, of faults drawn in the same way. Where"
        " values are fixed: a share of the cells of this design, without an interval. Kinds without"
        " such a motion are left out.",
    )


def price(found: Sequence[FreeReactions]) -> Table:
    """What the cue costs on fault-free motion."""
    return Table(
        "Interruptions for nothing: fault-free motion",
        (
            "motion",
            "scale",
            "threshold, mm",
            "motions",
            "with a cue",
            "hours until the first cue",
            "interruptions per hour",
            "pulses per hour",
        ),
        tuple(
            (
                one.motion,
                one.scale,
                one.threshold_mm,
                one.motions.n,
                rate(one.motions),
                one.first.hours,
                number(Estimate(one.first.per_hour, one.first.low, one.first.high)),
                number(Estimate(one.pulses.per_hour, one.pulses.low, one.pulses.high)),
            )
            for one in found
        ),
        "Interruptions: first cues in the time up to them, exact Poisson, 95 %: an operator who"
        " stops at the first pull. Pulses: all separate pulls in all the time, of one who goes on,"
        " interval over robots. Robots were drawn; the motion is one recording.",
    )


# --- cells ---


def avoided(found: Contrast) -> str:
    """52 of 230, 22.6 % (7.1–45.7 %); 31 kinds; a dash where no fault has it."""
    return of_kinds(found.avoided, found.affected)


def of_kinds(found: Rate, among: Units) -> str:
    """As `rate`, with the number of kinds behind it."""
    return f"{rate(found)}; {kinds.count(among)}" if found.n else wording.DASH


def size(size_mm: float | None) -> str:
    """A size of motion."""
    return "jump of the true tip" if size_mm is None else f"unintended motion of {size_mm:g} mm"


def rate(found: Rate) -> str:
    """52 of 230, 22.6 % (7.1–45.7 %); a dash without runs."""
    if not found.n:
        return wording.DASH
    share = f"{found.k} of {found.n}, {wording.percent(found.value)}"
    return share if math.isnan(found.low) else f"{share} ({wording.interval(found)})"


def number(found: Estimate) -> str:
    """A number with its interval; ∞ for an end without bound."""
    if math.isnan(found.value):
        return wording.DASH
    if math.isnan(found.low) and math.isnan(found.high):
        return _number(found.value)
    low, high = (
        wording.DASH if math.isnan(end) else _number(end) for end in (found.low, found.high)
    )
    return f"{_number(found.value)} ({low} to {high})"


def _number(value: float) -> str:
    return (
        "∞" if math.isinf(value) else wording.number(value + 0.0, 2 if abs(value) < 10 else 3)
    )  # no -0
