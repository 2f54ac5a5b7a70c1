"""Study of scenario B of the targeted attacks (DSN 2016): a value on the shoulder's DAC after the
checks, for 1 to 128 packets.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.dsn16.detector import Scenario
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    own_line,
    read_notes,
    read_table,
    read_variants,
    study,
)

NAME, SIGNIFICANT = "dsn16_b", 0.05
EVERY_CYCLE = "every_cycle"
IMPULSE = 1.15e5
"""Counts times packets from which the null model says that the tip jumps."""
MARGIN = 10.0
"""Points by which a published Wilson interval is widened, as for A1."""
VARIANTS = (*read_variants(NAME), *detector.TRAINING)
"""The baseline, every ablation, and the motions from which the detector learns."""


def compare(context: Context) -> Findings:
    """Compare published and predicted counts, and show how much each open question matters."""
    published = Published("dsn16")
    found = detector.read_scenario(VARIANTS, context.folders)
    base, runs, cases = found.base, found.runs, found.cases
    jumps, stops = (_counts(published, what) for what in ("jump", "estop"))
    bands = [published.band(f"b.jump.{d}ms") for d in DURATIONS]
    error = 100.0 / published.value("b.runs")

    def fitting(place: int) -> str:
        return _would_fit([*cases, *found.rules], place, bands[place])

    lines = [*_jumps(base, published, bands, fitting, "A1"), _bias(base, jumps, published, "A1")]
    beside = [runs[name] for name in (attacks.DECLARED, *attacks.LEVERS) if name in runs]
    for one in beside:
        lines += _jumps(one, published, bands, _counted_inside(one))
    lines += [_bias(one, jumps, published) for one in beside]
    lines += _stops(base, published)
    stated = attacks.scenario_b(base, found.watched.largest_mvel, jumps, stops)
    lines += stated
    for quantity, hit in (
        ("prevalence of jumps, all cells", "jump"),
        ("prevalence of E-stops, all cells", "stop"),
        ("jumps without an E-stop, all cells", "missed"),
    ):
        lines.append(own_line(quantity, "%", attacks.rate(base.share(hit).to_numpy().ravel())))
    own = VariantCase(base, "", label=base.name)
    tables = (
        attacks.sensitivity_table(
            "P(jump), %, by duration: what each open question is worth",
            [own, *found.rules, *cases],
            base,
            jumps,
            bands,
            error,
            note=attacks.SENSITIVITY_NOTE,
        ),
        attacks.sensitivity_table(
            "P(E-stop), %, by duration",
            [case._replace(hit="stop") for case in (own, *cases)],
            base,
            stops,
            reading_error=error,
            hit="stop",
        ),
        read_table(NAME, "durations", _duration_rows(found, published)),
        *([read_table(NAME, "values", _value_rows(found))] if EVERY_CYCLE in runs else []),
        read_table(NAME, "rates", detector.rate_rows(found, published, "b")),
    )
    notes = (attacks.verdict("Scenario B", stated), *read_notes(NAME))
    return Findings(tuple(lines), tables, notes)


def null(runs: VariantRuns) -> np.ndarray:
    """Return which runs jump by their impulse alone, bool [runs]."""
    size = np.abs([attacks.stored(value) for value in runs.value])
    return size * runs.duration >= IMPULSE


def _predictions(found: Scenario) -> Iterator[tuple[str, str, VariantRuns, np.ndarray]]:
    """Yield each prediction of a published count: what, by what, runs and their hits."""
    base, other = found.base, found.runs.get(EVERY_CYCLE)
    for what, hit in (("jump", "jump"), ("estop", "stop")):
        yield what, "baseline", base, base.hits[hit]
        if other is not None:
            yield what, "a packet in every control cycle", other, other.hits[hit]
    yield "jump", f"null: {IMPULSE:g} counts times packets or more", base, null(base)


def _duration_rows(found: Scenario, published: Published) -> Iterator[tuple[str | int, ...]]:
    runs = published.value("b.runs")
    for what in ("jump", "estop"):
        counts = [int(published.value(f"b.{what}.{d}ms")) for d in DURATIONS]
        words = "E-stops" if what == "estop" else "jumps"
        yield words, "published", *counts, sum(counts), "", ""
        intervals = [_percent(published, what, d) for d in DURATIONS]
        for kind, name, some, hits in _predictions(found):
            if kind != what:
                continue
            percent = 100 * attacks.means(some.value, some.duration, hits).to_numpy().mean(axis=0)
            inside = sum(
                one.low - MARGIN <= value <= one.high + MARGIN
                for one, value in zip(intervals, percent, strict=True)
            )
            shown = [round(float(value) * runs / 100) for value in percent]
            apart = float(np.mean(np.abs(percent - [one.value for one in intervals])))
            yield words, name, *shown, sum(shown), f"{inside} of {len(DURATIONS)}", round(apart, 1)


def _value_rows(found: Scenario) -> Iterator[tuple[str | int, ...]]:
    columns = [
        attacks.means(some.value, some.duration, hits).to_numpy().mean(axis=1)
        for _, _, some, hits in _predictions(found)
    ]
    values = np.unique(found.base.value)
    runs = len(found.base.index) / len(values)
    for k, value in enumerate(values):
        yield f"{value:.0f}", *(round(float(column[k]) * runs) for column in columns)


def _counts(published: Published, what: str) -> np.ndarray:
    return np.array(
        [100.0 * published.value(f"b.{what}.{d}ms") / published.value("b.runs") for d in DURATIONS]
    )


def _percent(published: Published, what: str, duration: int) -> StudyEstimate:
    from ravenjax.stats.intervals import wilson_interval

    k, n = published.value(f"b.{what}.{duration}ms"), published.value("b.runs")
    rate = wilson_interval(int(k), int(n))
    return StudyEstimate(
        100 * rate.value, 100 * rate.low, 100 * rate.high, int(n), "runs, read off Figure 9 b"
    )


def _jumps(
    runs: VariantRuns,
    published: Published,
    bands: Sequence[tuple[float, float]],
    reason: Callable[[int], str],
    target: str = "",
) -> Iterator[Line]:
    """Return P(jump) by duration for one trajectory, with its band. `reason`: maps the index of a
    duration outside its band to the reason.
    """
    cells = runs.share("jump")
    for place, duration in enumerate(DURATIONS):
        predicted = attacks.rate(cells[duration].to_numpy())
        low, high = bands[place]
        yield Line(
            f"P(jump), {duration} packets; {runs.name}, lever {runs.lever}",
            "%",
            _percent(published, "jump", duration),
            predicted,
            bands[place],
            target,
            "" if low <= predicted.value <= high else reason(place),
        )


def _would_fit(cases: Sequence[VariantCase], place: int, band: tuple[float, float]) -> str:
    """Return the answers to an open question that would put this duration into its band."""
    fitting = [(case.name, case.runs.percent(case.hit)[place]) for case in cases]
    inside = [f"{name} {percent:.0f}" for name, percent in fitting if band[0] <= percent <= band[1]]
    if not inside:
        return "outside with every single variant"
    return (
        f"inside with {len(inside)} of {len(fitting)} other answers, each alone:"
        f" {', '.join(inside)}"
    )


def _counted_inside(runs: VariantRuns) -> Callable[[int], str]:
    """Return another trajectory's rate if jumps counted only inside the published window."""
    inside = runs.percent("inside")
    return lambda place: f"inside t1 .. t1 + d + 1 alone it is {inside[place]:.1f} %"


def _bias(runs: VariantRuns, jumps: np.ndarray, published: Published, target: str = "") -> Line:
    sign = attacks.bias(runs.percent("jump"), jumps, 100.0 / published.value("b.runs"))
    return Line(
        f"bias: p of the sign test over durations; {runs.name}, lever {runs.lever}",
        "",
        None,
        StudyEstimate(
            sign.p,
            n=sign.above + sign.below,
            of="durations that differ by more than the reading error",
        ),
        (SIGNIFICANT, 1.0),
        target,
        f"prediction {sign.words}; mean difference"
        f" {float(np.mean(runs.percent('jump') - jumps)):+.1f} points",
    )


def _stops(base: VariantRuns, published: Published) -> Iterator[Line]:
    cells = base.share("stop")
    for duration in DURATIONS:
        yield Line(
            f"P(E-stop), {duration} packets; {base.name}",
            "%",
            _percent(published, "estop", duration),
            attacks.rate(cells[duration].to_numpy()),
            reason="" if cells[duration].any() else "single stops are noise of the real process",
        )


STUDY = study(NAME, variants=VARIANTS, compare=compare)
