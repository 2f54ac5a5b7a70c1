"""Study: would the haptic cue have helped?

The same faults are run with an operator who reacts and with one who feels nothing. A measure
compares the robot with a reference, and a reaction may change that reference too. An operator who
slows down slows the nominal model as well, and one who corrects pushes it away. So a measure is
applied only to reactions for which it means the same as without a reaction.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.report.sections import reaction as reactions
from ravenjax.report.sections.reaction import EXCURSION, Pairs
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.comparison.paired import mcnemar_test
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval
from ravenjax.stats.latency import Delays, Lead
from ravenjax.stats.multiplicity import holm_test
from ravenjax.vocabulary.reactions import ACTIONS, CORRECT, MEANINGS, RELEASE, SLOW
from studies import kinds
from studies.kinds import difference
from studies.runs import SCALE, Runs, read, warning_times
from studies.study import (
    Cell,
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    in_percent,
    own_line,
    read_notes,
    read_table,
    read_variants,
    study,
)

NAME = "reacting_operator"
SIZES_MM = (LIMIT_MM, 5.0, 10.0, 20.0)
"""Sizes of motion. At the first one the published cue fires too, so that motion is reached when the
operator feels the cue, not before.
"""


class Measure(NamedTuple):
    """One quantity that is counted."""

    name: str
    hits: Callable[[pd.DataFrame], np.ndarray]  # maps runs with their facts to bool [runs]


def excursion(size_mm: float) -> Measure:
    """Return the measure of unintended motion of more than a size, live or not."""
    return Measure(
        f"unintended motion of more than {size_mm:g} mm, live or not",
        lambda runs: (runs[EXCURSION] > size_mm).to_numpy(),
    )


def live(size_mm: float) -> Measure:
    """Return the measure of a distance from the nominal model above a size, while the robot is
    live.
    """

    def hits(runs: pd.DataFrame) -> np.ndarray:
        here, golden = runs["peak_live_deviation_mm"], runs["golden_peak_live_deviation_mm"]
        return ((here > size_mm) & ~(golden > size_mm)).to_numpy()

    return Measure(f"off the model by more than {size_mm:g} mm, live", hits)


INJURY = Measure(
    f"injury-capable motion (jump, unintended motion of {LIMIT_MM:g} mm live or not, or deeper)",
    lambda runs: runs["injury"].to_numpy(),
)


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


def paired(runs: Runs, action: int) -> Pairs:
    """Return every fault that changed a bit if nobody reacts, with this action and without one."""
    every = reactions.paired_runs(runs.frame, action)
    return every.where(every.without["activated"].to_numpy())


def contrast_of(pairs: Pairs, measure: Measure) -> Contrast:
    """Return the measure over these pairs."""
    with_, without = map(measure.hits, pairs)
    acted, among = reacted(pairs), kinds.of(pairs.with_["group"])
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


def reacted(pairs: Pairs) -> np.ndarray:
    """Return in which pairs the operator acted, bool [pairs]."""
    return (pairs.with_["reaction_ms"] >= 0).to_numpy()


def needed(difference: Estimate) -> Estimate:
    """Return the number needed to treat from a difference of rates (negative: fewer); infinite if
    nothing is avoided.

    Its interval is the reciprocal of the difference's (Altman, BMJ 317, 1998). An end that includes
    no effect is infinite.
    """

    def end(rate: float) -> float:
        return math.nan if math.isnan(rate) else -1.0 / rate if rate < 0 else math.inf

    return Estimate(*map(end, difference))


# --- classes of faults: name -> which pairs ---


def sampled(pairs: Pairs) -> Pairs:
    """Return the pairs of sampled faults, without those of the library."""
    return pairs.where(pairs.with_["group"].astype(str).str.startswith("sampled/").to_numpy())


def by_layer(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Return pairs by layer of the first fault, in the robot's order."""
    from ravenjax.robots.raven2.declaration import LAYERS

    layer = pairs.with_["layer"].to_numpy()
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


def unreacted(runs: Runs) -> Runs:
    """Return runs with a fault that changed a bit, in which nobody reacts."""
    return runs.where(runs["activated"] & (runs["action"] == 0))


def began_ms(runs: Runs, jump: bool = False) -> np.ndarray:
    """Return when the unintended motion of each run exceeded the limit of its campaign. `jump`:
    when its true tip jumped. NaN: never.
    """
    jumped = np.where(runs["jump_tip"], runs["jump_tip_first_ms"], -1)
    came = jumped if jump else runs["unintended_ms"]
    return np.where(came >= 0, came, np.nan)


def leads_ms(runs: Runs, cue: int, jump: bool = False) -> np.ndarray:
    """Return the time from cue to motion of every run. Negative: the cue came after; NaN: no
    motion; -inf: no cue.
    """
    cued, began = warning_times(runs, cue), began_ms(runs, jump)
    return np.where(np.isnan(began), np.nan, np.where(cued >= 0, began - cued, -np.inf))


def advance(runs: Runs, cue: int, threshold_mm: float, jump: bool = False) -> Advance:
    """Return the advance over runs in which nobody reacts.

    `cue`: number of the haptic set with that threshold. `jump`: as in `began_ms`.
    """
    lead, began = leads_ms(runs, cue, jump), began_ms(runs, jump)
    moved = ~np.isnan(lead)
    came, among = lead[moved], kinds.of(runs.frame["group"].to_numpy()[moved])
    cue_came = np.isfinite(came)
    lag = np.where(cue_came, -came, runs.made.duration_ms - began[moved])
    lead_curve = latency.lead_time(Delays(lag, cue_came, np.ones(len(lag), int)))

    def exceeded(fraction: float) -> Estimate:
        value, low, high = latency.delay_quantile(lag, cue_came, fraction, among)
        return Estimate(-value, -high, -low)

    return Advance(
        threshold_mm,
        None if jump else runs.made.limit_mm,
        among,
        lead_curve,
        units.rate_band(came > 0, among),
        exceeded(0.5),
        exceeded(0.25),
        {delay: units.rate_band(came < delay, among) for delay in DELAYS_MS},
    )


MS_PER_HOUR = 3.6e6


class FreeReactions(NamedTuple):
    """Cues of one threshold in fault-free motion at one scale."""

    motion: str
    scale: float
    threshold_mm: float
    first: AlarmRate  # rate of first cues over the time up to them


def free_reactions(runs: Runs, thresholds_mm: tuple[float, ...]) -> list[FreeReactions]:
    """Return reactions by scale and threshold, with the haptic sets in their order. Failed runs are
    left out.
    """
    valid = runs.where(~runs["failed"]).frame
    results = []
    for scale, mine in valid.groupby(SCALE):
        for cue, threshold in sorted(enumerate(thresholds_mm), key=lambda item: item[1]):
            first = mine[f"cue{cue}_first_ms"].to_numpy()
            cued = first >= 0
            live = mine["pedal_down_ms"].to_numpy()
            began = (
                runs.made.duration_ms - live
            )  # once the motion is live, it stays live to its end
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


def contrast_rows(
    found: Sequence[tuple[tuple[Cell, ...], Contrast]],
) -> tuple[tuple[Cell, ...], ...]:
    """Return rows of contrasts, each after its own head columns."""
    p = [
        one.adjusted
        for one in holm_test({str(k): one.p for k, (_, one) in enumerate(found)}).values()
    ]
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


def layer_table(pairs: Pairs, by: Sequence[Measure]) -> Table:
    """Return what lifting the pedal changes, by layer of the fault."""
    rows = [
        ((name, measure.name), contrast_of(pairs.where(mine), measure))
        for name, mine in by_layer(pairs).items()
        for measure in by
    ]
    return read_table(NAME, "layers", contrast_rows(rows))


def variant_table(found: Iterable[tuple[str, Pairs]], by: Sequence[Measure]) -> Table:
    """Return what lifting the pedal changes under other cues and other operators, for sampled
    faults only.
    """
    questions = [(name, part, measure) for name, part in found for measure in by]
    rows = contrast_rows(
        [((name, measure.name), contrast_of(part, measure)) for name, part, measure in questions]
    )
    idle = [rate(idle_rate(part)) for _, part, _ in questions]
    return read_table(
        NAME, "variants", [(*row, extra) for row, extra in zip(rows, idle, strict=True)]
    )


def idle_rate(pairs: Pairs) -> Rate:
    """Return the share of reactions to a fault that has no hazard even if nobody reacts."""
    return _of_reactions(pairs, (pairs.without["hazard"] == "none").to_numpy())


def unmoved_rate(pairs: Pairs) -> Rate:
    """Return the share of reactions to a fault that causes no unintended motion even if nobody
    reacts.
    """
    return _of_reactions(pairs, ~pairs.without["unintended"].to_numpy(bool))


def _of_reactions(pairs: Pairs, holds: np.ndarray) -> Rate:
    acted = reacted(pairs)
    return units.rate_band(holds[acted], kinds.of(pairs.with_["group"]).where(acted))


def advance_table(found: Sequence[Advance]) -> Table:
    """Return how much time the cue leaves."""
    rows = [
        (
            *(one.threshold_mm, size(one.size_mm), one.lead.n, kinds.count(one.kinds)),
            *(rate(one.before), number(one.half_ms), number(one.quarter_ms)),
            *(rate(late) for late in one.late.values()),
        )
        for one in found
        if not defined(one)
    ]
    return read_table(NAME, "advance", rows)


def defined(one: Advance) -> bool:
    """Return whether the cue fires at the size of the motion or above. Then, by the definitions
    alone, it is not earlier.
    """
    return one.size_mm is not None and one.threshold_mm >= one.size_mm


def kind_table(pairs: Pairs, by: Measure, drawn_groups: Collection[str]) -> Table:
    """Return what lifting the pedal avoids, by kind of fault. Kinds without such a motion are left
    out.
    """
    group = pairs.with_["group"].to_numpy().astype(str)
    names, drawn = kinds.names(group), np.isin(group, sorted(drawn_groups))
    layers, rows = pairs.with_["layer"].to_numpy(), []
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        one = contrast_of(pairs.where(mine), by)
        if not one.without and not one.caused:
            continue
        is_drawn, spared = bool(drawn[mine].all()), one.avoided
        if is_drawn and spared.n:
            spared = wilson_interval(spared.k, spared.n)
        cells = f"{one.n} {'faults drawn' if is_drawn else 'cells of the design'}"
        rows.append((name, str(layers[mine][0]), cells, one.without, rate(spared), one.caused))
    return read_table(NAME, "kinds", rows, measure=by.name)


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


BASELINE, PUBLISHED = "pairs", "threshold: threshold 3 mm, published"
THRESHOLDS_MM = (3.0, 1.0, 2.0, 5.0)
"""Thresholds of the campaigns' haptic sets, in their order."""
MOTIONS = ("suture", "peg_transfer")
DRAWN_SIZES = (5.0, 10.0)
SPARED_MM = 10.0
HEADLINE_SCALES = (0.1, 0.2)
HEADLINE_CUES_MM = (1.0, 3.0)
EARLY = {1.0: "threshold: threshold 1 mm", 2.0: "threshold: threshold 2 mm"}
"""Thresholds below the smallest motion, and the words of their variants."""
VARIANTS = read_variants(NAME)
"""The baseline, other cues and operators, the baseline with other limits, and motion without a
fault. A parameter that is no longer drawn stays a choice with a single value, because a design with
as many axes draws the same faults.
"""


def compare(context: Context) -> Findings:
    """Compare pairs, other cues and operators, times, and the cost on fault-free motion."""
    runs = read(context.folders[BASELINE])
    pairs = {action: paired(runs, action) for action in (RELEASE, SLOW, CORRECT)}
    released, two = pairs[RELEASE], tuple(map(excursion, DRAWN_SIZES))
    others = {}
    for variant in VARIANTS:
        block, _, sampled_only = variant.question.removeprefix("Another ").partition("; ")
        if sampled_only:
            others[block] = sampled(paired(read(context.folders[variant.name]), RELEASE))
        if block == EARLY[2.0]:
            others[PUBLISHED] = sampled(released)
    timed = [runs, *(read(context.folders[f"timed_{size:g}"]) for size in SIZES_MM[1:])]
    alone = [unreacted(some) for some in timed]
    advances = [
        advance(some, cue, threshold, jump)
        for cue, threshold in sorted(enumerate(THRESHOLDS_MM), key=lambda item: item[1])
        for some, jump in [*((some, False) for some in alone), (alone[0], True)]
    ]
    free = [
        one
        for motion in MOTIONS
        for one in free_reactions(read(context.folders[f"free_{motion}"]), THRESHOLDS_MM)
    ]
    early = {threshold: others[words] for threshold, words in EARLY.items()}
    drawn_groups = draws.drawn_groups(runs.made.config) or ()
    return Findings(
        lines=tuple(_lines(pairs, early, advances, free)),
        tables=(
            variant_table(others.items(), two),
            advance_table(advances),
            kind_table(released, excursion(SPARED_MM), drawn_groups),
            layer_table(released, two),
        ),
        notes=read_notes(NAME),
    )


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
        words = f"lifting the pedal at a cue of {threshold:g} mm avoids, of {measure.name}"
        yield _avoided(part, measure, words)
    for measure in map(excursion, DRAWN_SIZES):
        found = contrast_of(released, measure)
        of = f"reactions to faults of {kinds.count(found.reacted)}"
        value = StudyEstimate(*found.needed, found.acted, of)
        yield own_line(f"lifted pedals for each one avoided: {measure.name}", "", value)
    for action, measure in ((SLOW, live(SPARED_MM)), (CORRECT, excursion(SPARED_MM))):
        words = f"{MEANINGS[ACTIONS[action]]}, avoids, of {measure.name}"
        yield _avoided(pairs[action], measure, words)
    for action, measure in ((RELEASE, INJURY), (CORRECT, INJURY), (SLOW, live(SIZES_MM[0]))):
        found = contrast_of(pairs[action], measure)
        words = f"{MEANINGS[ACTIONS[action]]}, only with the reaction: {measure.name}"
        without = found.n - found.without
        count = StudyEstimate(found.caused, n=without, of="faults without it otherwise")
        yield own_line(words, "faults", count)
    for one in advances:
        if one.threshold_mm in HEADLINE_CUES_MM and not defined(one):
            words = f"{size(one.size_mm)}: came too soon for any reaction of 250 ms"
            late, of = one.late[250], f"faults that make it, {kinds.count(one.kinds)}"
            share = in_percent(late, late.n, of)
            yield own_line(f"{words}, cue at {one.threshold_mm:g} mm", "%", share)
    behind = kinds.count(kinds.of(released.with_["group"]).where(reacted(released)))
    for words, of_pairs in {"unintended motion": unmoved_rate, "any hazard": idle_rate}.items():
        idle = of_pairs(released)
        value = in_percent(idle, idle.n, f"reactions, {behind}")
        yield own_line(f"reactions to faults without {words}", "%", value)
    for one in free:
        if one.threshold_mm == THRESHOLDS_MM[0] and one.scale in HEADLINE_SCALES:
            first, of = one.first, f"first cues in {one.first.hours:.2f} h"
            value = StudyEstimate(first.per_hour, first.low, first.high, first.count, of)
            words = f"interruptions of fault-free motion, {one.motion}, scale {one.scale:g}"
            yield own_line(words, "per hour", value)


def _avoided(pairs: Pairs, measure: Measure, words: str) -> Line:
    found = contrast_of(pairs, measure)
    of = f"faults that make it where nobody reacts, {kinds.count(found.affected)}"
    return own_line(words, "%", in_percent(found.avoided, found.avoided.n, of))


STUDY = study(NAME, variants=VARIANTS, compare=compare)
