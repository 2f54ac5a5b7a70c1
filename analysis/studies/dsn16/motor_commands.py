"""Study of scenario B of the targeted attacks (DSN 2016): a value on the shoulder's DAC after the
checks, for 1 to 128 packets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    own_line,
    read_notes,
    read_variants,
    study,
)

SIGNIFICANT = 0.05


BASELINE = "baseline"


VARIANTS = (*read_variants("dsn16_b"), *detector.TRAINING)
"""The baseline, every ablation, and the motions from which the detector learns."""


def compare(context: Context) -> Findings:
    """Compare published and predicted counts, and show how much each open question matters."""
    published = Published("dsn16")
    computed = {v.name: v for v in VARIANTS if v.name in context.folders}
    trained = [v.name for v in detector.TRAINING]
    runs = {
        name: attacks.read_runs(name, context.folders[name])
        for name in computed
        if name not in trained
    }
    base = runs[BASELINE]
    jumps, stops = (_counts(published, what) for what in ("jump", "estop"))
    bands = [published.band(f"b.jump.{d}ms") for d in DURATIONS]
    cases = [
        VariantCase(one, computed[name].question) for name, one in runs.items() if name != BASELINE
    ]
    levels = detector.thresholds(detector.learn_from_folders(context.folders))
    watched = detector.watch(context.folders[BASELINE], base, levels)
    rules = attacks.other_jump_rules(base, watched.leaps)
    error = 100.0 / published.value("b.runs")
    levers = [runs[name] for name in attacks.LEVERS if name in runs]
    lines = [
        *_jumps(
            base,
            published,
            bands,
            lambda place: _would_fit([*cases, *rules], place, bands[place]),
            "A1",
        )
    ]
    lines.append(_bias(base, jumps, published, "A1"))
    beside = [*(runs[name] for name in (attacks.DECLARED,) if name in runs), *levers]
    lines += [
        line for one in beside for line in _jumps(one, published, bands, _counted_inside(one))
    ]
    lines += [_bias(one, jumps, published) for one in beside]
    lines += _stops(base, published)
    stated = attacks.scenario_b(base, watched.largest_mvel, jumps, stops)
    lines += stated
    lines += _blind(base)
    own = VariantCase(base, "", label=BASELINE)
    tables = (
        attacks.sensitivity_table(
            "P(jump), %, by duration: what each open question is worth",
            [own, *rules, *cases],
            base,
            jumps,
            bands,
            error,
            note=attacks.SENSITIVITY_NOTE,
        ),
        attacks.sensitivity_table(
            "P(E-stop), %, by duration",
            [own._replace(hit="stop"), *(c._replace(hit="stop") for c in cases)],
            base,
            stops,
            reading_error=error,
            hit="stop",
        ),
    )
    notes = (
        attacks.verdict("Scenario B", stated),
        *read_notes("dsn16_b"),
    )
    return Findings(tuple(lines), tables, notes)


def _counts(published: Published, what: str) -> np.ndarray:
    """Return published counts in %, by duration."""
    return np.array(
        [100.0 * published.value(f"b.{what}.{d}ms") / published.value("b.runs") for d in DURATIONS]
    )


def _percent(published: Published, what: str, duration: int) -> StudyEstimate:
    """Return a published count in % with its Wilson interval."""
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
        predicted = attacks.rate(cells.of(duration))
        inside = attacks.in_band(predicted.value, bands[place])
        yield Line(
            f"P(jump), {duration} packets; {runs.name}, lever {runs.lever.words}",
            "%",
            _percent(published, "jump", duration),
            predicted,
            bands[place],
            target,
            "" if inside else reason(place),
        )


def _would_fit(cases: Sequence[VariantCase], place: int, band: tuple[float, float]) -> str:
    """Return the answers to an open question that would put this duration into its band."""
    fitting = [(case.name, case.runs.percent(case.hit)[place]) for case in cases]
    inside = [
        f"{name} {percent:.0f}" for name, percent in fitting if attacks.in_band(percent, band)
    ]
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
    """Apply the sign test of prediction against publication over the durations."""
    sign = attacks.bias(runs.percent("jump"), jumps, 100.0 / published.value("b.runs"))
    return Line(
        f"bias: p of the sign test over durations; {runs.name}, lever {runs.lever.words}",
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
            attacks.rate(cells.of(duration)),
            reason="" if cells.of(duration).any() else "single stops are noise of the real process",
        )


def _blind(base: VariantRuns) -> tuple[Line, ...]:
    """Return the rates whose published values were withheld."""
    return tuple(
        own_line(quantity, "%", attacks.rate(base.share(hit).shares.ravel()))
        for quantity, hit in (
            ("prevalence of jumps, all cells", "jump"),
            ("prevalence of E-stops, all cells", "stop"),
            ("jumps without an E-stop, all cells", "missed"),
        )
    )


STUDY = study("dsn16_b", variants=VARIANTS, compare=compare)
