"""Study: would the haptic cue have helped?

The same faults are run with an operator who reacts and with one who feels nothing. A measure
compares the robot with a reference, and a reaction may change that reference too. An operator who
slows down slows the nominal model as well, and one who corrects pushes it away. So a measure is
applied only to reactions for which it means the same as without a reaction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections import reaction as reactions
from ravenjax.report.sections.reaction import EXCURSION
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.comparison.paired import mcnemar_test
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval
from ravenjax.stats.latency import Delays, Lead
from ravenjax.stats.multiplicity import holm_test
from ravenjax.store import folder, manifest
from ravenjax.vocabulary.reactions import ACTIONS, CORRECT, MEANINGS, RELEASE, SLOW
from studies import kinds
from studies.hazards import severity
from studies.kinds import difference
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

SIZES_MM = (LIMIT_MM, 5.0, 10.0, 20.0)
"""Sizes of motion. At the first one the published cue fires too, so that motion is reached when the
operator feels the cue, not before.
"""


class Measure(NamedTuple):
    """One quantity that is counted."""

    name: str
    hits: Callable[
        [pd.DataFrame, pd.DataFrame], np.ndarray
    ]  # maps (result table, its facts) to bool [runs]


def excursion(size_mm: float) -> Measure:
    """Return the measure of unintended motion of more than a size, live or not."""
    return Measure(
        f"unintended motion of more than {size_mm:g} mm, live or not",
        lambda frame, facts: (frame[EXCURSION] > size_mm).to_numpy(),
    )


def live(size_mm: float) -> Measure:
    """Return the measure of a distance from the nominal model above a size, while the robot is
    live.
    """

    def hits(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
        here, golden = frame["peak_live_deviation_mm"], frame["golden_peak_live_deviation_mm"]
        return ((here > size_mm) & ~(golden > size_mm)).to_numpy()

    return Measure(f"off the model by more than {size_mm:g} mm, live", hits)


INJURY = Measure(
    f"injury-capable motion (jump, unintended motion of {LIMIT_MM:g} mm live or not, or deeper)",
    lambda frame, facts: severity.injury_capable(frame).to_numpy(),
)


class ReactionRuns(NamedTuple):
    """A variant's result table, with a column EXCURSION, and its facts."""

    frame: pd.DataFrame
    facts: pd.DataFrame
    end_ms: int
    limit_mm: float  # limit of the hazards in `facts`

    def where(self, chosen: np.ndarray) -> ReactionRuns:
        """Return the runs that `chosen` selects (bool [runs])."""
        return self._replace(frame=self.frame.loc[chosen], facts=self.facts.loc[chosen])


class Pairs(NamedTuple):
    """Each run with an action beside the run in which nobody reacts: result tables and facts."""

    with_facts: pd.DataFrame
    without_facts: pd.DataFrame
    with_frame: pd.DataFrame
    without_frame: pd.DataFrame

    def where(self, chosen: np.ndarray) -> Pairs:
        """Return the pairs that `chosen` marks (bool [pairs])."""
        return Pairs(*(side.loc[chosen] for side in self))


class Contrast(NamedTuple):
    """One measure over pairs. Intervals are over kinds of faults."""

    n: int  # distinct faults, each one pair
    kinds: Units  # of these faults
    without: int  # faults that have it if nobody reacts
    with_: int  # faults that have it with the reaction
    # With the reaction minus without, as a fraction of the faults. A negative difference means that
    # the reaction avoids it.
    difference: Estimate
    avoided: (
        # Of the faults that have it if nobody reacts: those without it with the reaction.
        Rate
    )
    affected: Units  # kinds of the faults that have it if nobody reacts
    caused: int  # faults that have it only with the reaction
    p: float  # exact, labels exchanged kind by kind; NaN if no pair differs
    acted: int  # pairs in which the operator acted
    reacted: Units  # kinds of faults of these pairs
    # Number of reactions for each one avoided; infinite if none is avoided.
    needed: Estimate


def read(path: Path) -> ReactionRuns:
    """Read the runs of a result folder. Raises StoreError."""
    frame, header = folder.read_all(path), manifest.read_manifest(path)
    frame[EXCURSION] = frame[["unintended_mm", "unintended_off_mm"]].max(axis=1)
    return ReactionRuns(
        frame, run_facts.derive_from_manifest(frame, header), header.duration_ms, header.limit_mm
    )


def paired(runs: ReactionRuns, action: int) -> Pairs:
    """Return every fault that changed a bit if nobody reacts, with this action and without one."""
    frame, facts = runs.frame, runs.facts
    joined = frame.drop(columns=frame.columns.intersection(facts.columns)).join(facts)
    sides = [side.index for side in reactions.paired_runs(joined, action)]
    every = Pairs(*(facts.loc[side] for side in sides), *(frame.loc[side] for side in sides))
    return every.where(every.without_facts["activated"].to_numpy())


def kinds_of(pairs: Pairs) -> Units:
    """Return the kinds of the faults of these pairs."""
    return kinds.of(pairs.with_facts["group"])


def contrast_of(pairs: Pairs, measure: Measure) -> Contrast:
    """Return the measure over these pairs."""
    with_ = measure.hits(pairs.with_frame, pairs.with_facts)
    without = measure.hits(pairs.without_frame, pairs.without_facts)
    acted = (pairs.with_frame["reaction_ms"] >= 0).to_numpy()
    among = kinds_of(pairs)
    affected = among.where(without)
    return Contrast(
        len(with_),
        among,
        int(without.sum()),
        int(with_.sum()),
        difference(with_, without, among),
        units.rate_band(~with_[without], affected),
        affected,
        mcnemar_test(with_, without).first_only,
        exchange_p(with_, without, among.unit),
        int(acted.sum()),
        among.where(acted),
        needed(difference(with_[acted], without[acted], among.where(acted))),
    )


def needed(difference: Estimate) -> Estimate:
    """Return the number needed to treat from a difference of rates (negative: fewer); infinite if
    nothing is avoided.

    Its interval is the reciprocal of the difference's (Altman, BMJ 317, 1998). An end that includes
    no effect is infinite.
    """

    def reciprocal(rate: float) -> float:
        return -1.0 / rate if rate < 0 else math.inf

    def end(rate: float) -> float:
        return math.nan if math.isnan(rate) else reciprocal(rate)

    return Estimate(*map(end, difference))


def adjusted(contrasts: Sequence[Contrast]) -> list[float]:
    """Return Holm's p of each contrast, adjusted over all; NaN if no pair differs."""
    return [
        finding.adjusted
        for finding in holm_test({str(k): one.p for k, one in enumerate(contrasts)}).values()
    ]


# --- classes of faults: name -> which pairs ---


def by_design(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Return pairs of sampled faults, and pairs of the library."""
    group = pairs.with_facts["group"].astype(str)
    sampled = group.str.startswith("sampled/").to_numpy()
    return {"sampled faults": sampled, "hazards of the library": ~sampled}


def by_layer(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Return pairs by layer of the first fault, in the robot's order."""
    from ravenjax.robots.raven2.declaration import LAYERS

    layer = pairs.with_facts["layer"].to_numpy()
    return {name: mine for name in LAYERS.values() if (mine := layer == name).any()}


DELAYS_MS = (150, 250, 400)


class Advance(NamedTuple):
    """How long before unintended motion of one size the cue came, over runs in which nobody
    reacted.
    """

    threshold_mm: float
    size_mm: float | None  # None: a jump of the true tip
    kinds: Units  # kinds of the faults that cause the motion
    lead: Lead  # ms; its bands assume that faults are independent
    # Motions with the cue before them. This and the following fields have intervals over kinds of
    # faults.
    before: Rate
    half_ms: Estimate  # lead that half of the motions have or exceed
    quarter_ms: Estimate
    # Maps a reaction time in ms to the share of motions that come too soon for it, or without a
    # cue.
    late: dict[int, Rate]


def unreacted(runs: ReactionRuns) -> ReactionRuns:
    """Return runs with a fault that changed a bit, in which nobody reacts."""
    return runs.where((runs.facts["activated"] & (runs.facts["action"] == 0)).to_numpy())


def began_ms(runs: ReactionRuns, jump: bool = False) -> np.ndarray:
    """Return when the unintended motion of each run exceeded the limit of its campaign. `jump`:
    when its true tip jumped. NaN: never.
    """
    if jump:
        came = np.where(runs.frame["jump_tip"], runs.frame["jump_tip_first_ms"], -1)
    else:
        came = runs.facts["unintended_ms"].to_numpy()
    return np.where(came >= 0, came, np.nan)


def leads_ms(runs: ReactionRuns, cue: int, jump: bool = False) -> np.ndarray:
    """Return the time from cue to motion of every run. Negative: the cue came after; NaN: no
    motion; -inf: no cue.
    """
    cued, began = run_facts.warning_times(runs.frame, cue), began_ms(runs, jump)
    return np.where(np.isnan(began), np.nan, np.where(cued >= 0, began - cued, -np.inf))


def advance(runs: ReactionRuns, cue: int, threshold_mm: float, jump: bool = False) -> Advance:
    """Return the advance over runs in which nobody reacts.

    `cue`: number of the haptic set with that threshold. `jump`: as in `began_ms`.
    """
    lead, began = leads_ms(runs, cue, jump), began_ms(runs, jump)
    moved = ~np.isnan(lead)
    came, among = lead[moved], kinds.of(runs.facts["group"].to_numpy()[moved])
    cue_came = np.isfinite(came)
    lag = np.where(cue_came, -came, runs.end_ms - began[moved])
    lead_curve = latency.lead_time(Delays(lag, cue_came, np.ones(len(lag), int)))

    def exceeded(fraction: float) -> Estimate:
        value, low, high = latency.delay_quantile(lag, cue_came, fraction, among)
        return Estimate(-value, -high, -low)

    return Advance(
        threshold_mm,
        None if jump else runs.limit_mm,
        among,
        lead_curve,
        units.rate_band(came > 0, among),
        exceeded(0.5),
        exceeded(0.25),
        {delay: units.rate_band(came < delay, among) for delay in DELAYS_MS},
    )


SCALE = "param:operator.scale"
MS_PER_HOUR = 3.6e6


class FreeReactions(NamedTuple):
    """Cues of one threshold in fault-free motion at one scale."""

    motion: str
    scale: float
    threshold_mm: float
    first: AlarmRate  # rate of first cues over the time up to them


def free_reactions(runs: ReactionRuns, thresholds_mm: tuple[float, ...]) -> list[FreeReactions]:
    """Return reactions by scale and threshold, with the haptic sets in their order. Failed runs are
    left out.
    """
    valid = runs.frame.loc[~runs.facts["failed"]]
    results = []
    for scale, mine in valid.groupby(SCALE):
        for cue, threshold in sorted(enumerate(thresholds_mm), key=lambda item: item[1]):
            first = mine[f"cue{cue}_first_ms"].to_numpy()
            cued = first >= 0
            live = mine["pedal_down_ms"].to_numpy()
            began = runs.end_ms - live  # once the motion is live, it stays live to its end
            exposed = np.where(cued, np.maximum(first - began, 0), live).sum() / MS_PER_HOUR
            results.append(
                FreeReactions(
                    str(mine["operator"].iloc[0]),
                    float(np.asarray(scale)),
                    threshold,
                    alarm_rate(int(cued.sum()), float(exposed)),
                )
            )
    return results


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

SAME = "Columns and intervals as in the first table."


def action_words(action: int) -> str:
    """Write an action in words."""
    return MEANINGS[ACTIONS[action]]


def contrast_rows(
    found: Sequence[tuple[tuple[Cell, ...], Contrast]],
) -> tuple[tuple[Cell, ...], ...]:
    """Return rows of COLUMNS, each after its own head columns."""
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
            wording.format_number(holm, 2),
            one.acted,
            number(one.needed),
        )
        for (heads, one), holm in zip(found, p, strict=True)
    )


def split(
    title: str, head: str, pairs: Pairs, classes: Mapping[str, np.ndarray], by: Sequence[Measure]
) -> Table:
    """Return what lifting the pedal changes, by class of fault."""
    rows = [
        ((name, measure.name), contrast_of(pairs.where(mine), measure))
        for name, mine in classes.items()
        for measure in by
        if mine.any()
    ]
    return Table(title, (head, "measure", *COLUMNS), contrast_rows(rows), SAME)


def variants(found: Iterable[tuple[str, Pairs]], by: Sequence[Measure]) -> Table:
    """Return what lifting the pedal changes under other cues and other operators, for sampled
    faults only.
    """
    questions = [(name, part, measure) for name, part in found for measure in by]
    rows = contrast_rows(
        [((name, measure.name), contrast_of(part, measure)) for name, part, measure in questions]
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
    """Return the share of reactions to a fault that has no hazard even if nobody reacts."""
    return _of_reactions(pairs, (pairs.without_facts["hazard"] == "none").to_numpy())


def unmoved_rate(pairs: Pairs) -> Rate:
    """Return the share of reactions to a fault that causes no unintended motion even if nobody
    reacts.
    """
    return _of_reactions(pairs, ~pairs.without_facts["unintended"].to_numpy(bool))


def _of_reactions(pairs: Pairs, holds: np.ndarray) -> Rate:
    acted = (pairs.with_frame["reaction_ms"] >= 0).to_numpy()
    return units.rate_band(holds[acted], kinds_of(pairs).where(acted))


def advance_table(found: Sequence[Advance]) -> Table:
    """Return how much time the cue leaves."""
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
    """Return whether the cue fires at the size of the motion or above. Then, by the definitions
    alone, it is not earlier.
    """
    return one.size_mm is not None and one.threshold_mm >= one.size_mm


def sites(pairs: Pairs, by: Measure, drawn_groups: Collection[str]) -> Table:
    """Return what lifting the pedal avoids, by kind of fault. Kinds without such a motion are left
    out.
    """
    group = pairs.with_facts["group"].to_numpy().astype(str)
    names, sampled = kinds.names(group), np.isin(group, sorted(drawn_groups))
    layers = pairs.with_facts["layer"].to_numpy()
    rows = []
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        one = contrast_of(pairs.where(mine), by)
        if not one.without and not one.caused:
            continue
        is_drawn = bool(sampled[mine].all())
        spared = (
            wilson_interval(one.avoided.k, one.avoided.n)
            if is_drawn and one.avoided.n
            else one.avoided
        )
        cells = f"{one.n} {'faults drawn' if is_drawn else 'cells of the design'}"
        rows.append(
            {
                "kind of fault": name,
                "layer": str(layers[mine][0]),
                "faults": cells,
                "with it, nobody reacts": one.without,
                "avoided, of those with it": rate(spared),
                "made worse": one.caused,
            }
        )
    return table(
        f"Lifting the pedal, by kind of fault: {by.name}",
        rows,
        "Where a kind's faults were drawn: Wilson, 95 %, of faults drawn in the same way. Where"
        " values are fixed: a share of the cells of this design, without an interval. Kinds without"
        " such a motion are left out.",
    )


# --- cells ---


def avoided(found: Contrast) -> str:
    """Write 52 of 230, 22.6 % (7.1–45.7 %); 31 kinds. It is a dash if no fault has it."""
    return of_kinds(found.avoided, found.affected)


def of_kinds(found: Rate, among: Units) -> str:
    """Write a rate as `rate` does, with the number of kinds behind it."""
    return f"{rate(found)}; {kinds.count(among)}" if found.n else wording.DASH


def size(size_mm: float | None) -> str:
    """Write a size of motion."""
    return "jump of the true tip" if size_mm is None else f"unintended motion of {size_mm:g} mm"


def rate(found: Rate) -> str:
    """Write 52 of 230, 22.6 % (7.1–45.7 %). It is a dash without runs."""
    if not found.n:
        return wording.DASH
    share = f"{found.k} of {found.n}, {wording.format_percent(found.value)}"
    return share if math.isnan(found.low) else f"{share} ({wording.format_interval(found)})"


def number(found: Estimate) -> str:
    """Write a number with its interval; ∞ for an unbounded end."""
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
        "∞"
        if math.isinf(value)
        else wording.format_number(value + 0.0, 2 if abs(value) < 10 else 3)
    )  # avoids -0


CAMPAIGN, FREE = "reacting_operator.toml", "reacting_operator_free.toml"
BASELINE = "pairs"
SAMPLED = 1500
"""Number of sampled faults of the campaign. They come first, so that a limit leaves out the
library.
"""
THRESHOLDS_MM = (3.0, 1.0, 2.0, 5.0)
"""Thresholds of the campaigns' haptic sets, in their order."""
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
"""Maps a block to its variants, their words, and what they change. The baseline is listed among the
thresholds.

A parameter that is no longer drawn stays a choice with a single value, because a design with as
many axes draws the same faults.
"""
MOTIONS = ("suture", "peg_transfer")
DRAWN_SIZES = (5.0, 10.0)
SPARED_MM = 10.0
HEADLINE_SCALES = (0.1, 0.2)
HEADLINE_CUES_MM = (1.0, 3.0)
EARLY = {1.0: "threshold 1 mm", 2.0: "threshold 2 mm"}
"""Thresholds below the smallest motion, and the words of their variants."""


def compare(context: Context) -> Findings:
    """Compare pairs, other cues and operators, times, and the cost on fault-free motion."""
    runs = read(context.folders[BASELINE])
    pairs = {action: paired(runs, action) for action in (RELEASE, SLOW, CORRECT)}
    others = [(block, words, part) for block, words, part in _variants(context, pairs[RELEASE])]
    timed = [runs, *(read(context.folders[_timed(size)]) for size in SIZES_MM[1:])]
    advances = _advances(timed)
    drawn_groups = (
        draws.drawn_groups(manifest.read_manifest(context.folders[BASELINE]).config) or ()
    )
    free = [
        one
        for motion in MOTIONS
        for one in free_reactions(read(context.folders[f"free_{motion}"]), THRESHOLDS_MM)
    ]
    released = pairs[RELEASE]
    two = tuple(map(excursion, DRAWN_SIZES))
    early = {
        threshold: part
        for threshold, words in EARLY.items()
        for _, name, part in others
        if name == words
    }
    return Findings(
        lines=tuple(_lines(pairs, early, advances, free)),
        tables=(
            variants([(f"{block}: {words}", part) for block, words, part in others], two),
            advance_table(advances),
            sites(released, excursion(SPARED_MM), drawn_groups),
            split(
                "Lifting the pedal, by layer of the fault",
                "layer",
                released,
                by_layer(released),
                two,
            ),
        ),
        notes=read_notes("reacting_operator"),
    )


def _variants(context: Context, baseline: Pairs) -> Iterator[tuple[str, str, Pairs]]:
    for block, variants in BLOCKS.items():
        for name, (words, _) in variants.items():
            part = baseline
            if name != BASELINE:
                part = paired(read(context.folders[name]), RELEASE)
            yield block, words, part.where(by_design(part)["sampled faults"])


def _timed(size_mm: float) -> str:
    """Return the variant in which nobody reacts and this size is the limit. For the smallest size
    it is the baseline.
    """
    return f"timed_{size_mm:g}"


def _advances(timed: Sequence[ReactionRuns]) -> list[Advance]:
    """Return the advances before motions of each size, and before jumps, at each threshold."""
    alone = [unreacted(runs) for runs in timed]
    return [
        advance(runs, cue, threshold, jump)
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
    """Return the lines. `early`: maps thresholds below the smallest motion to pairs of sampled
    faults with a lifted pedal.
    """
    released = pairs[RELEASE]
    for measure in map(excursion, SIZES_MM[1:]):
        yield _avoided(released, measure, f"lifting the pedal avoids, of {measure.name}")
    for threshold, part in early.items():
        measure = excursion(SIZES_MM[0])
        yield _avoided(
            part,
            measure,
            f"lifting the pedal at a cue of {threshold:g} mm avoids, of {measure.name}",
        )
    for measure in map(excursion, DRAWN_SIZES):
        yield _line(
            f"lifted pedals for each one avoided: {measure.name}",
            "",
            _needed(contrast_of(released, measure)),
        )
    for action, measure in (
        (SLOW, live(SPARED_MM)),
        (CORRECT, excursion(SPARED_MM)),
    ):
        yield _avoided(pairs[action], measure, f"{action_words(action)}, avoids, of {measure.name}")
    for action, measure in (
        (RELEASE, INJURY),
        (CORRECT, INJURY),
        (SLOW, live(SIZES_MM[0])),
    ):
        contrast = contrast_of(pairs[action], measure)
        words = f"{action_words(action)}, only with the reaction: {measure.name}"
        count = StudyEstimate(
            contrast.caused, n=contrast.n - contrast.without, of="faults without it otherwise"
        )
        yield _line(words, "faults", count)
    for one in advances:
        if one.threshold_mm in HEADLINE_CUES_MM and not defined(one):
            words = f"{size(one.size_mm)}: came too soon for any reaction of 250 ms"
            share = _percent(one.late[250], f"faults that make it, {kinds.count(one.kinds)}")
            yield _line(f"{words}, cue at {one.threshold_mm:g} mm", "%", share)
    idle = {"unintended motion": unmoved_rate, "any hazard": idle_rate}
    acted = (released.with_frame["reaction_ms"] >= 0).to_numpy()
    behind = kinds.count(kinds_of(released).where(acted))
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
    return own_line(quantity, unit, value)


def _avoided(pairs: Pairs, measure: Measure, words: str) -> Line:
    contrast = contrast_of(pairs, measure)
    of = f"faults that make it where nobody reacts, {kinds.count(contrast.affected)}"
    return _line(words, "%", _percent(contrast.avoided, of))


def _percent(rate: Rate, of: str) -> StudyEstimate:
    return StudyEstimate(100 * rate.value, 100 * rate.low, 100 * rate.high, rate.n, of)


def _needed(found: Contrast) -> StudyEstimate:
    return StudyEstimate(
        *found.needed, found.acted, f"reactions to faults of {kinds.count(found.reacted)}"
    )


def _alternatives() -> Iterator[Variant]:
    few = ("cross.reaction.action=[0, 1]", f"campaign.limit={2 * SAMPLED}")
    for block, variants in BLOCKS.items():
        for name, (words, overrides) in variants.items():
            if name != BASELINE:
                yield Variant(
                    name, CAMPAIGN, (*few, *overrides), f"Another {block}: {words}; sampled faults"
                )


STUDY = study(
    "reacting_operator",
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
)
