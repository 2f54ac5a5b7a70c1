"""Study of scenario B of the targeted attacks (DSN 2016): a value on the shoulder's DAC after the
checks, for 1 to 128 packets.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ravenjax.stats.intervals import wilson_interval
from studies import study
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantRuns
from studies.dsn16.detector import Scenario
from studies.study import Cell, Line, Published, StudyEstimate, in_percent, own_line, read_table

NAME, SIGNIFICANT = "dsn16_b", 0.05
IMPULSE = 1.15e5
"""Counts times packets from which the null model says that the tip jumps."""
MARGIN = 10.0
"""Points by which a published Wilson interval is widened, as for A1."""
VARIANTS = study.read_variants(NAME)
"""The baseline, every ablation, and the motions from which the detector learns."""
NULL = f"null: {IMPULSE:g} counts times packets or more"


def compare(context: study.Context) -> study.Findings:
    """Compare published and predicted counts, and show how much each open question matters."""
    published = Published("dsn16")
    found = detector.read_scenario(VARIANTS, context.folders)
    base, n = found.base, int(published.value("b.runs"))
    estimates: dict[str, list[StudyEstimate]] = {}
    for what in ("jump", "estop"):
        counts = [int(published.value(f"b.{what}.{d}ms")) for d in DURATIONS]
        read = [in_percent(wilson_interval(k, n), n, "runs, read off Figure 9 b") for k in counts]
        estimates[what] = read
    jumps, stops = (np.array([one.value for one in read]) for read in estimates.values())
    bands, error = [published.band(f"b.jump.{d}ms") for d in DURATIONS], 100.0 / n
    stated = attacks.scenario_b(base, found.watched.largest_mvel, jumps, stops)
    totals = {
        "prevalence of jumps, all cells": "jump",
        "prevalence of E-stops, all cells": "stop",
        "jumps without an E-stop, all cells": "missed",
    }
    lines = (
        *_jumps(base, estimates["jump"], bands),
        _bias(base, jumps, error),
        *stated,
        *(own_line(words, "%", attacks.rate(base.share(hit))) for words, hit in totals.items()),
    )
    rows = attacks.sensitivity_rows(found.counted, "jump", jumps, bands, error)
    other = found.runs.get("every_cycle")
    tables = (
        read_table(NAME, "jump", rows),
        read_table(NAME, "durations", _duration_rows(found, estimates)),
        *([read_table(NAME, "values", _value_rows(found))] if other else []),
        read_table(NAME, "rates", detector.rate_rows(found, published, "b")),
    )
    return study.Findings(lines, tables, study.read_notes(NAME))


def _predictions(found: Scenario) -> Iterator[tuple[str, str, VariantRuns, str]]:
    """Yield each prediction of a published count: what, by what, runs and the column of hits."""
    base, other = found.base, found.runs.get("every_cycle")
    for what, hit in (("jump", "jump"), ("estop", "stop")):
        yield what, "baseline", base, hit
        if other is not None:
            yield what, "a packet in every control cycle", other, hit
    impulse = base.frame["value"].map(attacks.stored).abs() * base.frame["duration"]
    yield "jump", NULL, base.counting((impulse >= IMPULSE).to_numpy(), NULL), "jump"


def _duration_rows(
    found: Scenario, estimates: Mapping[str, Sequence[StudyEstimate]]
) -> Iterator[tuple[Cell, ...]]:
    for what, words in (("jump", "jumps"), ("estop", "E-stops")):
        published = estimates[what]
        runs = published[0].n
        counts = [round(one.value * runs / 100) for one in published]
        yield words, "published", *counts, sum(counts), "", ""
        mine = [row[1:] for row in _predictions(found) if row[0] == what]
        for name, some, hit in mine:
            percent = some.percent(hit)
            inside = sum(
                one.low - MARGIN <= value <= one.high + MARGIN
                for one, value in zip(published, percent, strict=True)
            )
            shown = [round(float(value) * runs / 100) for value in percent]
            apart = float(np.mean(np.abs(percent - [one.value for one in published])))
            yield words, name, *shown, sum(shown), f"{inside} of {len(DURATIONS)}", round(apart, 1)


def _value_rows(found: Scenario) -> Iterator[tuple[Cell, ...]]:
    shares = [some.share(hit).mean(axis=1) for _, _, some, hit in _predictions(found)]
    runs = len(found.base.frame) / len(shares[0])
    for value, *row in zip(shares[0].index, *shares, strict=True):
        yield f"{value:.0f}", *(round(float(share) * runs) for share in row)


def _jumps(
    base: VariantRuns, published: Sequence[StudyEstimate], bands: Sequence[tuple[float, float]]
) -> Iterator[Line]:
    """Yield P(jump) by duration, with its band."""
    for (duration, cells), read, band in zip(
        base.share("jump").items(), published, bands, strict=True
    ):
        quantity = f"P(jump), {duration} packets; {base.name}, lever {base.lever}"
        yield Line(quantity, "%", read, attacks.rate(cells), band, "A1")


def _bias(base: VariantRuns, jumps: np.ndarray, error: float) -> Line:
    percent = base.percent("jump")
    above, below, p = attacks.bias(percent, jumps, error)
    of = "durations that differ by more than the reading error"
    mean = float(np.mean(percent - jumps))
    return Line(
        f"bias: p of the sign test over durations; {base.name}, lever {base.lever}",
        "",
        None,
        StudyEstimate(p, n=above + below, of=of),
        (SIGNIFICANT, 1.0),
        "A1",
        f"prediction {above} above, {below} below; mean difference {mean:+.1f} points",
    )


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
