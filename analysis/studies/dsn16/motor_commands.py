"""Study of scenario B of the targeted attacks (DSN 2016): a value is added to the shoulder's DAC
command after the checks, for 1 to 128 packets.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ravenjax.report import wording
from ravenjax.stats.intervals import wilson_interval
from studies import study
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantRuns
from studies.dsn16.detector import Scenario
from studies.study import Cell, Line, Published, StudyEstimate, in_percent, own_line, read_table

NAME, SIGNIFICANT = "dsn16_b", 0.05
IMPULSE = 1.15e5
"""DAC counts times packets at which the null model predicts a jump."""
MARGIN = 10.0
"""Percentage points by which a published Wilson interval is widened, as for A1."""
VARIANTS = study.read_variants(NAME)
"""The baseline, the other variants, and the fault-free runs from which the detector learns."""
NULL = f"null model: a jump if DAC counts times packets reach {IMPULSE:g}"


def compare(context: study.Context) -> study.Findings:
    """Compare published and predicted numbers of runs, and show how the variants change them."""
    published = Published("dsn16")
    found = detector.read_scenario(VARIANTS, context.folders)
    n, of = int(published.value("b.runs")), "runs; read off Figure 9 b"
    read: dict[str, list[StudyEstimate]] = {}
    for what in ("jump", "estop"):
        counts = [int(published.value(f"b.{what}.{d}ms")) for d in DURATIONS]
        read[what] = [in_percent(wilson_interval(k, n), n, of) for k in counts]
    jumps, bands = percent_of(read["jump"]), [published.band(f"b.jump.{d}ms") for d in DURATIONS]
    tables = {
        "jump": attacks.sensitivity_rows(found.counted, "jump", jumps, bands, 100.0 / n),
        "durations": _duration_rows(found, read),
        "values": _value_rows(found),
        "rates": detector.rate_rows(found, published, "b"),
    }
    if "every_cycle" not in found.runs:
        del tables["values"]
    return study.Findings(
        tuple(_lines(found, read, bands)),
        tuple(read_table(NAME, key, rows) for key, rows in tables.items()),
        study.read_notes(NAME),
    )


def percent_of(read: Sequence[StudyEstimate]) -> np.ndarray:
    """Return published shares, %, by duration."""
    return np.array([one.value for one in read])


def _predictions(found: Scenario) -> Iterator[tuple[str, str, VariantRuns, str]]:
    """Yield each prediction: outcome, name of the prediction, runs, column with the outcome."""
    base, other = found.base, found.runs.get("every_cycle")
    for what, hit in (("jump", "jump"), ("estop", "stop")):
        yield what, "baseline", base, hit
        if other is not None:
            yield what, "one packet per control cycle", other, hit
    impulse = base.frame["value"].map(attacks.stored).abs() * base.frame["duration"]
    yield "jump", NULL, base.counting((impulse >= IMPULSE).to_numpy(), NULL), "jump"


def _duration_rows(
    found: Scenario, read: Mapping[str, Sequence[StudyEstimate]]
) -> Iterator[tuple[Cell, ...]]:
    for what, words in (("jump", "jumps"), ("estop", "E-stops")):
        low, high = (np.array([getattr(one, end) for one in read[what]]) for end in ("low", "high"))
        published, runs = percent_of(read[what]), read[what][0].n
        counts = [round(value * runs / 100) for value in published.tolist()]
        yield words, "published", *counts, sum(counts), "", ""
        for name, some, hit in (row[1:] for row in _predictions(found) if row[0] == what):
            percent = some.percent(hit)
            inside = int(((low - MARGIN <= percent) & (percent <= high + MARGIN)).sum())
            shown = [round(value * runs / 100) for value in percent.tolist()]
            apart = round(float(np.mean(np.abs(percent - published))), 1)
            yield words, name, *shown, sum(shown), f"{inside} of {len(DURATIONS)}", apart


def _value_rows(found: Scenario) -> Iterator[tuple[Cell, ...]]:
    shares = [some.share(hit).mean(axis=1) for _, _, some, hit in _predictions(found)]
    runs = len(found.base.frame) / len(shares[0])
    for value, *row in zip(shares[0].index, *shares, strict=True):
        yield f"{value:.0f}", *(round(float(share) * runs) for share in row)


def _lines(
    found: Scenario,
    read: Mapping[str, Sequence[StudyEstimate]],
    bands: Sequence[tuple[float, float]],
) -> Iterator[Line]:
    """Yield jumps by duration with their bands, the bias, the paper's statements, and totals."""
    base, shares = found.base, found.base.share("jump")
    jumps, stops = map(percent_of, read.values())
    build = f"{base.name} (tip {base.lever} from the shoulder axis)"
    for duration, one, band in zip(DURATIONS, read["jump"], bands, strict=True):
        quantity = f"runs with a jump, {wording.count_noun(duration, 'packet')}, {build}"
        yield Line(quantity, "%", one, attacks.rate(shares[duration]), band, "A1")
    percent = base.percent("jump")
    above, below, p = attacks.bias(percent, jumps, 100.0 / read["jump"][0].n)
    mean = f"{float(np.mean(percent - jumps)):+.1f} percentage points"
    yield Line(
        f"p-value of the sign test for bias over durations, {build}",
        "",
        None,
        StudyEstimate(p, n=above + below, of="durations that differ beyond the reading error"),
        (SIGNIFICANT, 1.0),
        "A1",
        f"prediction above at {above}, below at {below} durations; mean difference {mean}",
    )
    yield from attacks.scenario_b(base, found.watched.largest_mvel, jumps, stops)
    for words, hit in (
        ("runs with a jump, all values and durations", "jump"),
        ("runs with an E-stop, all values and durations", "stop"),
        ("runs with a jump and no E-stop, all values and durations", "missed"),
    ):
        yield own_line(words, "%", attacks.rate(base.share(hit)))


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
