"""Study: how many unintended motions does an operator avoid who reacts to the haptic cue?

The same faults are run with an operator who reacts and with an operator who does not. A measure
compares the robot with a reference, and some reactions also change this reference: an operator who
slows down also slows the nominal model, and an operator who corrects moves it. A measure is
therefore applied only to reactions that do not change its meaning.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.report.sections import reaction as reactions
from ravenjax.report.sections.reaction import EXCURSION, Pairs
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.paired import exchange_p
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval
from ravenjax.stats.multiplicity import holm_test
from ravenjax.vocabulary.reactions import ACTIONS, CORRECT, MEANINGS, RELEASE, SLOW
from studies import kinds, study
from studies.kinds import difference
from studies.runs import SCALE, Runs, read, warning_times
from studies.study import Cell, Line, StudyEstimate, own_line, percent_line, read_table

NAME = "reacting_operator"
SIZES_MM = (LIMIT_MM, 5.0, 10.0, 20.0)
"""Sizes of motion. At the first one the published cue fires too, so that motion is reached when the
operator feels the cue, not before.
"""
DRAWN_SIZES = (5.0, 10.0)
SPARED_MM = 10.0
THRESHOLDS_MM = (3.0, 1.0, 2.0, 5.0)
"""Thresholds of the campaigns' haptic sets, in their order."""
DELAYS_MS = (150, 250, 400)
HANDS = "free_recorded"
"""Prefix of the variants of recorded hands."""
MOTIONS = ("suture", "peg_transfer")
HEADLINE_SCALES = (0.1, 0.2)
HEADLINE_CUES_MM = (1.0, 3.0)
BASELINE, PUBLISHED = "pairs", "threshold: threshold 3 mm, published"
EVERY_CYCLE = "every_cycle"
EARLY = {1.0: "threshold: threshold 1 mm", 2.0: "threshold: threshold 2 mm"}
"""Thresholds below the smallest motion, and the words of their variants."""
VARIANTS = study.read_variants(NAME)
"""The baseline, other cues and operators, the baseline with other limits, and motion without a
fault. A parameter that is no longer drawn stays a choice with a single value, because a design with
as many axes draws the same faults.
"""


class Measure(NamedTuple):
    """One quantity that is counted."""

    name: str
    condition: str  # on the columns of runs with their facts

    def hits(self, runs: pd.DataFrame) -> np.ndarray:
        """Return which runs have it, bool [runs]."""
        return np.asarray(runs.eval(self.condition), bool)


def excursion(size_mm: float) -> Measure:
    """Return the measure of unintended motion of more than a size, live or not."""
    words = f"unintended motion of more than {size_mm:g} mm, live or not"
    return Measure(words, f"{EXCURSION} > {size_mm}")


def live(size_mm: float) -> Measure:
    """Return the measure of a distance from the nominal model, while the robot is live."""
    here, golden = (f"{part}peak_live_deviation_mm > {size_mm}" for part in ("", "golden_"))
    return Measure(f"off the model by more than {size_mm:g} mm, live", f"{here} and not ({golden})")


INJURY = Measure(
    f"injury-capable motion (jump, unintended motion of {LIMIT_MM:g} mm live or not, or deeper)",
    "injury",
)


class Contrast(NamedTuple):
    """One measure over pairs. Intervals are over kinds of faults."""

    n: int  # distinct faults, each one pair
    kinds: Units  # of these faults
    without: int  # faults that have it if nobody reacts
    with_: int  # faults that have it with the reaction
    avoided: Rate  # of the faults that have it if nobody reacts: those without it with the reaction
    affected: Units  # kinds of the faults that have it if nobody reacts
    caused: int  # faults that have it only with the reaction
    p: float  # exact, labels exchanged kind by kind; NaN if no pair differs
    acted: int  # pairs in which the operator acted
    reacted: Units  # kinds of faults of these pairs
    needed: Estimate  # number of reactions for each one avoided; infinite if none is avoided


def paired(runs: Runs, action: int) -> Pairs:
    """Return every fault that changed a bit if nobody reacts, with this action and without one."""
    every = reactions.paired_runs(runs.frame, action)
    return every.where(every.without["activated"].to_numpy())


def contrast_of(pairs: Pairs, measure: Measure) -> Contrast:
    """Return the measure over these pairs."""
    with_, without = map(measure.hits, pairs)
    acted, among = reacted(pairs), kinds.of(pairs.with_["group"])
    affected, acting = among.where(without), among.where(acted)
    return Contrast(
        len(with_),
        among,
        int(without.sum()),
        int(with_.sum()),
        units.rate_band(~with_[without], affected),
        affected,
        int((with_ & ~without).sum()),
        exchange_p(with_, without, among.unit),
        int(acted.sum()),
        acting,
        needed(difference(with_[acted], without[acted], acting)),
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


class Advance(NamedTuple):
    """How long before unintended motion of one size the cue came, over runs in which nobody
    reacted. Intervals are over kinds of faults.
    """

    threshold_mm: float
    size_mm: float | None  # None: a jump of the true tip
    kinds: Units  # kinds of the faults that cause the motion
    n: int  # number of these faults
    before: Rate  # motions with the cue before them
    half_ms: Estimate  # lead that half of the motions have or exceed
    quarter_ms: Estimate
    # Maps a reaction time in ms to the share of motions that come too soon for it, or without a
    # cue.
    late: dict[int, Rate]

    @property
    def defined(self) -> bool:
        """Return whether the cue fires at the size of the motion or above. Then, by the definitions
        alone, it is not earlier.
        """
        return self.size_mm is not None and self.threshold_mm >= self.size_mm

    @property
    def words(self) -> str:
        """Return the motion in words."""
        if self.size_mm is None:
            return "jump of the true tip"
        return f"unintended motion of {self.size_mm:g} mm"


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
    came, among = lead[moved], kinds.of(runs["group"][moved])
    cued = np.isfinite(came)
    lag = np.where(cued, -came, runs.made.duration_ms - began[moved])

    def exceeded(fraction: float) -> Estimate:
        value, low, high = latency.delay_quantile(lag, cued, fraction, among)
        return Estimate(-value, -high, -low)

    return Advance(
        threshold_mm,
        None if jump else runs.made.limit_mm,
        among,
        len(came),
        units.rate_band(came > 0, among),
        exceeded(0.5),
        exceeded(0.25),
        {delay: units.rate_band(came < delay, among) for delay in DELAYS_MS},
    )


Heads = tuple[Cell, ...]


def contrast_rows(contrasts: Mapping[Heads, Contrast]) -> Iterator[Heads]:
    """Yield rows of contrasts, each after its own head columns."""
    holm = holm_test({str(heads): found.p for heads, found in contrasts.items()})
    for heads, found in contrasts.items():
        p = wording.format_number(holm[str(heads)].adjusted, 2)
        counts = found.without, found.with_, avoided(found), found.caused
        needed = number(found.needed)
        yield *heads, found.n, kinds.count(found.kinds), *counts, p, found.acted, needed


def layer_rows(pairs: Pairs, by: Sequence[Measure]) -> Iterator[Heads]:
    """Yield what lifting the pedal changes, by layer of the fault."""
    layers = pairs.with_["layer"].to_numpy()
    return contrast_rows(
        {
            (name, measure.name): contrast_of(pairs.where(layers == name), measure)
            for name in LAYERS.values()
            if (layers == name).any()
            for measure in by
        }
    )


def variant_rows(found: Mapping[str, Pairs], by: Sequence[Measure]) -> Iterator[Heads]:
    """Yield what lifting the pedal changes with other cues and operators."""
    contrasts: dict[Heads, Contrast] = {
        (name, measure.name): contrast_of(pairs, measure)
        for name, pairs in found.items()
        for measure in by
    }
    for row in contrast_rows(contrasts):
        yield *row, rate(idle_rate(found[str(row[0])]))


def idle_rate(pairs: Pairs) -> Rate:
    """Return the share of reactions to a fault that has no hazard anyway."""
    return _of_reactions(pairs, (pairs.without["hazard"] == "none").to_numpy())


def unmoved_rate(pairs: Pairs) -> Rate:
    """Return the share of reactions to a fault that causes no unintended motion anyway."""
    return _of_reactions(pairs, ~pairs.without["unintended"].to_numpy(bool))


def _of_reactions(pairs: Pairs, holds: np.ndarray) -> Rate:
    acted = reacted(pairs)
    return units.rate_band(holds[acted], kinds.of(pairs.with_["group"]).where(acted))


def advance_rows(found: Sequence[Advance]) -> Iterator[Heads]:
    """Yield how much time the cue leaves."""
    for at in found:
        if not at.defined:
            yield (
                *(at.threshold_mm, at.words, at.n, kinds.count(at.kinds), rate(at.before)),
                *(number(at.half_ms), number(at.quarter_ms), *map(rate, at.late.values())),
            )


def kind_rows(pairs: Pairs, by: Measure, drawn_groups: Iterable[str]) -> Iterator[Heads]:
    """Yield what lifting the pedal avoids, by kind of fault, for kinds with such a motion."""
    group = pairs.with_["group"].to_numpy().astype(str)
    names, drawn = kinds.names(group), np.isin(group, sorted(drawn_groups))
    layers = pairs.with_["layer"].to_numpy()
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        contrast = contrast_of(pairs.where(mine), by)
        if not contrast.without and not contrast.caused:
            continue
        is_drawn, spared = bool(drawn[mine].all()), contrast.avoided
        if is_drawn and spared.n:
            spared = wilson_interval(spared.k, spared.n)
        cells = f"{contrast.n} {'faults drawn' if is_drawn else 'cells of the design'}"
        yield name, str(layers[mine][0]), cells, contrast.without, rate(spared), contrast.caused


# --- cells ---


def avoided(found: Contrast) -> str:
    """Write 52 of 230, 22.6 % (7.1–45.7 %); 31 kinds. It is a dash if no fault has it."""
    words = f"{rate(found.avoided)}; {kinds.count(found.affected)}"
    return words if found.avoided.n else wording.DASH


def rate(found: Rate) -> str:
    """Write 52 of 230, 22.6 % (7.1–45.7 %). It is a dash without runs."""
    return f"{found.k} of {found.n}, {wording.format_rate(found)}" if found.n else wording.DASH


def number(found: Estimate) -> str:
    """Write a number with its interval; ∞ for an unbounded end."""
    value, low, high = map(_number, found)
    unknown = math.isnan(found.value) or low == high == wording.DASH
    return value if unknown else f"{value} ({low} to {high})"


def _number(value: float) -> str:
    if math.isinf(value):
        return "∞"
    return wording.format_number(value + 0.0, 2 if abs(value) < 10 else 3)


def compare(context: study.Context) -> study.Findings:
    """Compare pairs, other cues and operators, times, and the cost on fault-free motion."""
    runs = {name: read(folder) for name, folder in context.folders.items()}
    pairs = {action: paired(runs[BASELINE], action) for action in (RELEASE, SLOW, CORRECT)}
    released, two = pairs[RELEASE], tuple(map(excursion, DRAWN_SIZES))
    others = {}
    for variant in VARIANTS:
        block, _, sampled_only = variant.question.removeprefix("Another ").partition("; ")
        if sampled_only:
            others[block] = _sampled(paired(runs[variant.name], RELEASE))
        if block == EARLY[2.0]:
            others[PUBLISHED] = _sampled(released)
    timed = [runs[BASELINE], *(runs[f"timed_{size:g}"] for size in SIZES_MM[1:])]
    alone = [some.where(some["activated"] & (some["action"] == 0)) for some in timed]
    advances = [
        advance(some, cue, threshold, jump)
        for cue, threshold in sorted(enumerate(THRESHOLDS_MM), key=lambda item: item[1])
        for some, jump in [*((some, False) for some in alone), (alone[0], True)]
    ]
    drawn = draws.drawn_groups(runs[BASELINE].made.config) or ()
    spared = excursion(SPARED_MM)
    return study.Findings(
        lines=(
            *_pair_lines(pairs, {mm: others[words] for mm, words in EARLY.items()}),
            *_advance_lines(advances),
            *_idle_lines(released),
            *_free_lines([found for name, found in runs.items() if name.startswith(HANDS)]),
            *(line for motion in MOTIONS for line in _free_lines([runs[f"free_{motion}"]])),
            *_large(paired(runs[EVERY_CYCLE], RELEASE), ", a packet each cycle"),
        ),
        tables=(
            read_table(NAME, "variants", variant_rows(others, two)),
            read_table(NAME, "advance", advance_rows(advances)),
            read_table(NAME, "kinds", kind_rows(released, spared, drawn), measure=spared.name),
            read_table(NAME, "layers", layer_rows(released, two)),
        ),
        notes=study.read_notes(NAME),
    )


def _sampled(pairs: Pairs) -> Pairs:
    """Return the pairs of sampled faults, without those of the library."""
    return pairs.where(pairs.with_["group"].astype(str).str.startswith("sampled/").to_numpy())


def _pair_lines(pairs: Mapping[int, Pairs], early: Mapping[float, Pairs]) -> Iterator[Line]:
    """Yield what reactions change. `early`: pairs by cues below the smallest motion."""
    released = pairs[RELEASE]
    yield from _large(released)
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


def _large(released: Pairs, words: str = "") -> Iterator[Line]:
    for measure in map(excursion, SIZES_MM[1:]):
        yield _avoided(released, measure, f"lifting the pedal avoids, of {measure.name}{words}")


def _avoided(pairs: Pairs, measure: Measure, words: str) -> Line:
    found = contrast_of(pairs, measure)
    of = f"faults that make it where nobody reacts, {kinds.count(found.affected)}"
    return percent_line(words, found.avoided, of)


def _advance_lines(advances: Iterable[Advance]) -> Iterator[Line]:
    for at in advances:
        if at.threshold_mm in HEADLINE_CUES_MM and not at.defined:
            words = f"{at.words}: came too soon for any reaction of 250 ms"
            of = f"faults that make it, {kinds.count(at.kinds)}"
            yield percent_line(f"{words}, cue at {at.threshold_mm:g} mm", at.late[250], of)


def _idle_lines(released: Pairs) -> Iterator[Line]:
    behind = kinds.count(kinds.of(released.with_["group"]).where(reacted(released)))
    for words, of_pairs in {"unintended motion": unmoved_rate, "any hazard": idle_rate}.items():
        words = f"reactions to faults without {words}"
        yield percent_line(words, of_pairs(released), f"reactions, {behind}")


def _free_lines(parts: Sequence[Runs]) -> Iterator[Line]:
    """Yield how often the published cue first comes in fault-free motion. parts: of one motion, or
    of recorded hands, of which motions with a clipped command are left out.
    """
    for scale in HEADLINE_SCALES if parts else ():
        count, hours = 0, 0.0
        for runs in parts:
            mine = runs.where(~runs["failed"] & np.isclose(runs[SCALE], scale))
            if len(parts) > 1:
                mine = mine.where(mine["check_overdrive_clip_count"] == 0)
            cued, live = mine["cue0_first_ms"], mine["pedal_down_ms"]
            # Once the motion is live, it stays live to its end.
            began = runs.made.duration_ms - live
            count += int((cued >= 0).sum())
            hours += np.where(cued >= 0, np.maximum(cued - began, 0), live).sum() / 3.6e6
        first = alarm_rate(count, float(hours))
        value = StudyEstimate(
            first.per_hour, first.low, first.high, count, f"first cues in {hours:.2f} h"
        )
        motion = "recorded hands" if len(parts) > 1 else parts[0]["operator"][0]
        yield own_line(
            f"interruptions of fault-free motion, {motion}, scale {scale:g}", "per hour", value
        )


STUDY = study.study(NAME, VARIANTS, compare)
