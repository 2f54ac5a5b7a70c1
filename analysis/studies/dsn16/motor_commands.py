"""Study of scenario B of the targeted attacks (DSN 2016): a value on the shoulder's DAC after the
checks, for 1 to 128 packets.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ravenjax.stats.intervals import wilson_interval
from studies import study
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.dsn16.detector import Scenario
from studies.study import Line, Published, StudyEstimate, in_percent, own_line, read_table

NAME, SIGNIFICANT = "dsn16_b", 0.05
EVERY_CYCLE = "every_cycle"
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
    base, runs, (own, *cases) = found.base, found.runs, found.cases
    estimates = {what: _published(published, what) for what in ("jump", "estop")}
    jumps, stops = (_percent(published, what) for what in ("jump", "estop"))
    bands = [published.band(f"b.jump.{d}ms") for d in DURATIONS]
    error = 100.0 / published.value("b.runs")

    def fitting(place: int) -> str:
        return _would_fit([*cases, *found.rules], place, bands[place])

    def bias(of: VariantRuns, target: str = "") -> Line:
        return _bias(of, jumps, error, target)

    beside = [runs[name] for name in (attacks.DECLARED, *attacks.LEVERS) if name in runs]
    lines = [*_jumps(base, estimates["jump"], bands, fitting, "A1"), bias(base, "A1")]
    for one in beside:
        lines += _jumps(one, estimates["jump"], bands, _counted_inside(one))
    lines += [bias(one) for one in beside]
    lines += _stops(base, estimates["estop"])
    stated = attacks.scenario_b(base, found.watched.largest_mvel, jumps, stops)
    lines += stated
    for quantity, hit in (
        ("prevalence of jumps, all cells", "jump"),
        ("prevalence of E-stops, all cells", "stop"),
        ("jumps without an E-stop, all cells", "missed"),
    ):
        lines.append(own_line(quantity, "%", attacks.rate(base.share(hit))))
    jump_rows = attacks.sensitivity_rows([own, *found.rules, *cases], "jump", jumps, bands, error)
    stop_cases = [case._replace(hit="stop") for case in found.cases]
    stop_rows = attacks.sensitivity_rows(stop_cases, "stop", stops, (), error)
    tables = (
        read_table(NAME, "jump", jump_rows),
        read_table(NAME, "stop", stop_rows),
        read_table(NAME, "durations", _duration_rows(found, estimates)),
        *([read_table(NAME, "values", _value_rows(found))] if EVERY_CYCLE in runs else []),
        read_table(NAME, "rates", detector.rate_rows(found, published, "b")),
    )
    notes = (attacks.verdict("Scenario B", stated), *study.read_notes(NAME))
    return study.Findings(tuple(lines), tables, notes)


def _published(published: Published, what: str) -> list[StudyEstimate]:
    """Return the published percent by duration."""
    n, of = int(published.value("b.runs")), "runs, read off Figure 9 b"
    counts = (int(published.value(f"b.{what}.{d}ms")) for d in DURATIONS)
    return [in_percent(wilson_interval(k, n), n, of) for k in counts]


def _percent(published: Published, what: str) -> np.ndarray:
    counts = np.array([published.value(f"b.{what}.{d}ms") for d in DURATIONS])
    return 100.0 * counts / published.value("b.runs")


def _predictions(found: Scenario) -> Iterator[tuple[str, str, VariantRuns, str]]:
    """Yield each prediction of a published count: what, by what, runs and the column of hits."""
    base, other = found.base, found.runs.get(EVERY_CYCLE)
    for what, hit in (("jump", "jump"), ("estop", "stop")):
        yield what, "baseline", base, hit
        if other is not None:
            yield what, "a packet in every control cycle", other, hit
    impulse = base.frame["value"].map(attacks.stored).abs() * base.frame["duration"]
    yield "jump", NULL, base.counting(null=impulse >= IMPULSE), "null"


def _duration_rows(
    found: Scenario, estimates: dict[str, list[StudyEstimate]]
) -> Iterator[tuple[str | int, ...]]:
    for what, words in (("jump", "jumps"), ("estop", "E-stops")):
        published = estimates[what]
        runs = published[0].n
        counts = [round(one.value * runs / 100) for one in published]
        yield words, "published", *counts, sum(counts), "", ""
        for kind, name, some, hit in _predictions(found):
            if kind != what:
                continue
            percent = some.percent(hit)
            inside = sum(
                one.low - MARGIN <= value <= one.high + MARGIN
                for one, value in zip(published, percent, strict=True)
            )
            shown = [round(float(value) * runs / 100) for value in percent]
            apart = float(np.mean(np.abs(percent - [one.value for one in published])))
            yield words, name, *shown, sum(shown), f"{inside} of {len(DURATIONS)}", round(apart, 1)


def _value_rows(found: Scenario) -> Iterator[tuple[str | int, ...]]:
    shares = [some.share(hit).mean(axis=1) for _, _, some, hit in _predictions(found)]
    runs = len(found.base.frame) / len(shares[0])
    for value, *row in zip(shares[0].index, *shares, strict=True):
        yield f"{value:.0f}", *(round(float(share) * runs) for share in row)


def _jumps(
    runs: VariantRuns,
    published: Sequence[StudyEstimate],
    bands: Sequence[tuple[float, float]],
    reason: Callable[[int], str],
    target: str = "",
) -> Iterator[Line]:
    """Yield P(jump) by duration for one trajectory, with its band. `reason`: maps the index of a
    duration outside its band to the reason.
    """
    cells = runs.share("jump")
    for place, duration in enumerate(DURATIONS):
        predicted, (low, high) = attacks.rate(cells[duration]), bands[place]
        yield Line(
            f"P(jump), {duration} packets; {runs.name}, lever {runs.lever}",
            "%",
            published[place],
            predicted,
            (low, high),
            target,
            "" if low <= predicted.value <= high else reason(place),
        )


def _would_fit(cases: Sequence[VariantCase], place: int, band: tuple[float, float]) -> str:
    """Return the answers to an open question that would put this duration into its band."""
    fitting = [(case.name, case.runs.percent(case.hit)[place]) for case in cases]
    inside = [f"{name} {percent:.0f}" for name, percent in fitting if band[0] <= percent <= band[1]]
    if not inside:
        return "outside with every single variant"
    answers = f"{len(inside)} of {len(fitting)} other answers"
    return f"inside with {answers}, each alone: {', '.join(inside)}"


def _counted_inside(runs: VariantRuns) -> Callable[[int], str]:
    """Return another trajectory's rate if jumps counted only inside the published window."""
    inside = runs.percent("inside")
    return lambda place: f"inside t1 .. t1 + d + 1 alone it is {inside[place]:.1f} %"


def _bias(runs: VariantRuns, jumps: np.ndarray, error: float, target: str) -> Line:
    percent = runs.percent("jump")
    above, below, p = attacks.bias(percent, jumps, error)
    of = "durations that differ by more than the reading error"
    mean = float(np.mean(percent - jumps))
    return Line(
        f"bias: p of the sign test over durations; {runs.name}, lever {runs.lever}",
        "",
        None,
        StudyEstimate(p, n=above + below, of=of),
        (SIGNIFICANT, 1.0),
        target,
        f"prediction {above} above, {below} below; mean difference {mean:+.1f} points",
    )


def _stops(base: VariantRuns, published: Sequence[StudyEstimate]) -> Iterator[Line]:
    cells = base.share("stop")
    for duration, read in zip(DURATIONS, published, strict=True):
        quantity = f"P(E-stop), {duration} packets; {base.name}"
        reason = "" if cells[duration].any() else "single stops are noise of the real process"
        yield Line(quantity, "%", read, attacks.rate(cells[duration]), reason=reason)


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
