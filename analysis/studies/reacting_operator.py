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

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.report.sections import reaction as reactions
from ravenjax.report.sections.reaction import EXCURSION, Pairs
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.stats import latency, units
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval
from ravenjax.stats.multiplicity import holm_test
from ravenjax.stats.paired import exchange_p
from ravenjax.stats.units import Units
from ravenjax.vocabulary.reactions import RELEASE
from studies import kinds, study
from studies.kinds import difference
from studies.runs import Runs, read, warning_times
from studies.study import Cell, Line, StudyEstimate, own_line, percent_line, read_table

NAME = "reacting_operator"
SIZES_MM = (LIMIT_MM, 5.0, 10.0, 20.0)
"""Sizes of motion. The first is also the published threshold of the cue."""
DRAWN_SIZES, SPARED_MM = (5.0, 10.0), 10.0
THRESHOLDS_MM, HEADLINE_CUES_MM = (3.0, 1.0, 2.0, 5.0), (1.0, 3.0)
"""Thresholds of the campaign's haptic sets, in their order, and those of lines."""
DELAYS_MS = (150, 250, 400)
BASELINE, PUBLISHED = "pairs", "threshold 3 mm, published"
EARLY = {1.0: "threshold 1 mm", 2.0: "threshold 2 mm"}
"""Thresholds below the smallest motion, and the words of their variants."""
VARIANTS = study.read_variants(NAME)
"""The baseline, other cues and operators, and the baseline with other limits. A parameter that is
no longer drawn stays a choice with a single value, because a design with as many axes draws the
same faults.
"""
Row = tuple[Cell, ...]


def excursion(size_mm: float) -> str:
    """Return the words for unintended motions of more than a size, live or not."""
    return f"unintended motions over {size_mm:g} mm (live or not)"


class Contrast(NamedTuple):
    """Excursions over pairs. Intervals are over kinds of faults."""

    n: int  # distinct faults, each one pair
    kinds: Units  # of these faults
    without: int  # faults with an excursion if nobody reacts
    with_: int  # faults with an excursion if the operator reacts
    avoided: Rate  # of the faults with an excursion if nobody reacts: those without if reacting
    affected: Units  # kinds of the faults with an excursion if nobody reacts
    caused: int  # faults with an excursion only if the operator reacts
    p: float  # exact, labels exchanged kind by kind; NaN if no pair differs
    acted: int  # pairs in which the operator acted
    reacted: Units  # kinds of faults of these pairs
    needed: Estimate  # number of reactions per avoided excursion; infinite if none is avoided


def paired(runs: Runs, action: int) -> Pairs:
    """Return every fault that changed a bit if nobody reacts, with this action and without one."""
    every = reactions.paired_runs(runs.frame, action)
    return every.where(every.without["activated"].to_numpy())


def contrast_of(pairs: Pairs, size_mm: float) -> Contrast:
    """Return the excursions of more than a size over these pairs."""
    with_, without = (part[EXCURSION].to_numpy() > size_mm for part in pairs)
    acted = (pairs.with_["reaction_ms"] >= 0).to_numpy()
    among = kinds.of(pairs.with_["group"])
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


def needed(difference: Estimate) -> Estimate:
    """Return the number needed to treat from a difference of rates (negative: fewer), with the
    reciprocal of its interval (Altman, BMJ 317, 1998). An end that includes no effect is infinite.
    """

    def end(rate: float) -> float:
        return math.nan if math.isnan(rate) else -1.0 / rate if rate < 0 else math.inf

    return Estimate(*map(end, difference))


class Advance(NamedTuple):
    """How long the cue came before unintended motion of one size, with intervals over kinds."""

    threshold_mm: float
    size_mm: float
    kinds: Units  # kinds of the faults that cause the motion
    n: int  # number of these faults
    before: Rate  # motions with the cue before them
    half_ms: Estimate  # lead that half of the motions have or exceed
    quarter_ms: Estimate
    # Maps a reaction time in ms to the share of motions that come too soon for it, or without a
    # cue.
    late: dict[int, Rate]

    @property
    def words(self) -> str:
        """Return the motion in words."""
        return f"unintended motion of {self.size_mm:g} mm"


def leads_ms(runs: Runs, cue: int) -> np.ndarray:
    """Return the time from cue to the unintended motion, negative if late; NaN: no motion; -inf: no
    cue. The motion begins at the limit of its campaign.
    """
    cued, began = warning_times(runs, cue), runs["unintended_ms"]
    return np.where(began < 0, np.nan, np.where(cued >= 0, began - cued, -np.inf))


def advance(runs: Runs, cue: int, threshold_mm: float) -> Advance:
    """Return the advance over runs in which nobody reacts, of the haptic set number `cue`."""
    lead = leads_ms(runs, cue)
    moved = ~np.isnan(lead)
    came, among = lead[moved], kinds.of(runs["group"][moved])
    cued = np.isfinite(came)
    lag = np.where(cued, -came, runs.made.duration_ms - runs["unintended_ms"][moved])
    half, quarter = (latency.delay_quantile(lag, cued, part, among) for part in (0.5, 0.25))
    late = {delay: units.rate_band(came < delay, among) for delay in DELAYS_MS}
    leads = (Estimate(-value, -high, -low) for value, low, high in (half, quarter))
    before = units.rate_band(came > 0, among)
    return Advance(threshold_mm, runs.made.limit_mm, among, len(came), before, *leads, late)


def contrast_rows(parts: Mapping[str, Pairs]) -> Iterator[Row]:
    """Yield what lifting the pedal changes in each part of the pairs."""
    cases = [(words, size) for words in parts for size in DRAWN_SIZES]
    contrasts = [contrast_of(parts[words], size) for words, size in cases]
    holm = holm_test({str(k): found.p for k, found in enumerate(contrasts)})
    for (words, size), found, tested in zip(cases, contrasts, holm.values(), strict=True):
        p = wording.format_number(tested.adjusted, 2)
        yield (
            *(words, excursion(size), found.n, kinds.count(found.kinds), found.without),
            *(found.with_, avoided(found), found.caused, p, found.acted, number(found.needed)),
        )


def advance_rows(found: Sequence[Advance]) -> Iterator[Row]:
    """Yield how much time the cue leaves."""
    for at in found:
        yield (
            *(at.threshold_mm, at.words, at.n, kinds.count(at.kinds), rate(at.before)),
            *(number(at.half_ms), number(at.quarter_ms), *map(rate, at.late.values())),
        )


def kind_rows(pairs: Pairs, size_mm: float, drawn_groups: Iterable[str]) -> Iterator[Row]:
    """Yield what lifting the pedal avoids, by kind of fault, for kinds with such a motion."""
    group = pairs.with_["group"].to_numpy().astype(str)
    names, drawn = kinds.names(group), np.isin(group, sorted(drawn_groups))
    layers = pairs.with_["layer"].to_numpy()
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        found = contrast_of(pairs.where(mine), size_mm)
        if not found.without and not found.caused:
            continue
        is_drawn, spared = bool(drawn[mine].all()), found.avoided
        if is_drawn and spared.n:
            spared = wilson_interval(spared.k, spared.n)
        cells = f"{found.n} {'drawn faults' if is_drawn else 'enumerated faults'}"
        yield name, str(layers[mine][0]), cells, found.without, rate(spared), found.caused


def avoided(found: Contrast) -> str:
    """Write 52 of 230, 22.6 % (7.1–45.7 %); 31 kinds. It is a dash without excursions."""
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
    """Compare pairs, other cues and operators, and times."""
    runs = {name: read(folder) for name, folder in context.folders.items()}
    base = runs[BASELINE]
    released, cycle = paired(base, RELEASE), paired(runs["every_cycle"], RELEASE)
    others = {}
    for variant in VARIANTS:
        block, _, sampled_only = variant.question.partition("; ")
        if sampled_only:
            others[block] = _sampled(paired(runs[variant.name], RELEASE))
        if block == EARLY[2.0]:
            others[PUBLISHED] = _sampled(released)
    timed = [base, *(runs[f"timed_{size:g}"] for size in SIZES_MM[1:])]
    alone = [some.where(some["activated"] & (some["action"] == 0)) for some in timed]
    # Cue and motion measure distances from the nominal model. Only a lower threshold warns early.
    advances = [
        advance(some, cue, threshold)
        for cue, threshold in sorted(enumerate(THRESHOLDS_MM), key=lambda item: item[1])
        for some in alone
        if threshold < some.made.limit_mm
    ]
    drawn = draws.drawn_groups(base.made.config) or ()
    layers = released.with_["layer"].to_numpy()
    by_layer = {
        name: released.where(layers == name) for name in LAYERS.values() if (layers == name).any()
    }
    tables = {
        "variants": contrast_rows(others),
        "advance": advance_rows(advances),
        "kinds": kind_rows(released, SPARED_MM, drawn),
        "layers": contrast_rows(by_layer),
    }
    measure = excursion(SPARED_MM)
    return study.Findings(
        tuple(_lines(released, others, cycle, advances)),
        tuple(read_table(NAME, key, rows, measure=measure) for key, rows in tables.items()),
        study.read_notes(NAME),
    )


def _sampled(pairs: Pairs) -> Pairs:
    """Return the pairs of sampled faults, without those of the library."""
    return pairs.where(pairs.with_["group"].astype(str).str.startswith("sampled/").to_numpy())


def _lines(
    released: Pairs, others: Mapping[str, Pairs], cycle: Pairs, advances: Iterable[Advance]
) -> Iterator[Line]:
    """Yield what a lifted pedal changes, and which motions come too soon. `others`: pairs with
    other cues, by their words. `cycle`: pairs with a packet in each control cycle.
    """
    yield from _avoided(released, "{} that a lifted pedal avoids")
    for threshold, words in EARLY.items():
        quantity = f"{{}} that a pedal lifted at a cue of {threshold:g} mm avoids"
        yield from _avoided(others[words], quantity, SIZES_MM[:1])
    for size in DRAWN_SIZES:
        found = contrast_of(released, size)
        of = f"reactions to faults of {kinds.count(found.reacted)}"
        value = StudyEstimate(*found.needed, found.acted, of)
        yield own_line(f"lifted pedals per avoided motion: {excursion(size)}", "", value)
    for at in advances:
        if at.threshold_mm in HEADLINE_CUES_MM:
            words = f"{at.words} too soon for a reaction of 250 ms"
            of = f"faults with the motion, {kinds.count(at.kinds)}"
            yield percent_line(f"{words} to a cue of {at.threshold_mm:g} mm", at.late[250], of)
    yield from _avoided(cycle, "{} that a lifted pedal avoids, one packet per cycle")


def _avoided(pairs: Pairs, words: str, sizes: Sequence[float] = SIZES_MM[1:]) -> Iterator[Line]:
    """Yield the share of motions of each size that a lifted pedal avoids. `words`: {} for these."""
    for size in sizes:
        found = contrast_of(pairs, size)
        of = f"faults with such a motion if nobody reacts, {kinds.count(found.affected)}"
        yield percent_line(words.format(excursion(size)), found.avoided, of)


STUDY = study.study(NAME, VARIANTS, compare)
