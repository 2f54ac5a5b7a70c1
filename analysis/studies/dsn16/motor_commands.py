"""Scenario B of the targeted attacks (DSN 2016): a value on the shoulder's DAC behind the
checks, 1 to 128 packets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ravenjax.robots.raven2.plant import parameter_sets
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    Study,
    StudyEstimate,
    Variant,
)

SIGNIFICANT = 0.05
STRICTER = ("jump_0.3mm", "jump_0.5mm", "jump_text")


def motor_notes(
    base: VariantRuns,
    runs: Mapping[str, VariantRuns],
    cases: Sequence[VariantCase],
    jumps: np.ndarray,
    stops: np.ndarray,
    bands: Sequence[tuple[float, float]],
    error: float,
) -> tuple[str, ...]:
    ranked = attacks.ranked(cases, base)
    worth = {name: points for name, points, _ in ranked}
    changed = {name: cells for name, _, cells in ranked}
    plant = [value for name, value in worth.items() if name.startswith("plant_")]
    most = ", ".join(
        f"{name} {worth[name]:+.1f} ({changed[name]} cells)" for name in list(worth)[:10]
    )
    sign = attacks.bias(base.percent("jump"), jumps, error)
    cells = base.share("jump")
    fitting = [c.name for c in cases if fits(c.runs.percent(c.hit), jumps, bands, error)]
    result = [
        (
            "Baseline: the fork's dynamics-simulator build, 16-bit words that wrap, packets that"
            " last as those of a recorded robot while the hand keeps its speed, jumps by the"
            " code's rule (two packet steps of the reported tip above 0.1 mm, the golden run's"
            f" not), stitches with a lever of {base.lever.words} at the onsets, near that of the"
            " recording of one published trajectory (77-85 mm). Values, durations and onsets are a"
            " fixed grid and no noise is added, so a predicted share has no"
            f" interval.{attacks.draws_note(base, runs.values())} {cells.alike} of"
            f" {cells.shares.size} cells come out alike in all ten onsets. The published counts"
            " have Wilson intervals, which take the original's 170 runs a duration as independent."
        ),
        f"The baseline is {float(np.mean(base.percent('jump') - jumps)):+.1f} points from the"
        f" publication in the mean, {sign.words} of {sign.above + sign.below} durations that differ"
        f" (p = {sign.p:.3f}). What each open question is worth, mean points of P(jump) over all"
        f" cells, the largest first: {most}."
        + (f" The plant's parameter sets: {min(plant):+.1f} to {max(plant):+.1f}." if plant else "")
        + _listed_changes(changed),
        (
            "Single answers with which every duration is inside its band and the sign test sees no"
            " bias: "
            f"{', '.join(fitting) or 'none'}. None is chosen: the baseline stays as its sources"
            " have it. "
            "Stricter rules of a jump, at their highest: "
            f"{', '.join(f'{name} {_largest(cases, name):.0f} %' for name in STRICTER if _has(cases, name))}."  # noqa: E501
        ),
    ]
    result += _packets(base, runs, jumps, stops, bands, error)
    if "build_robot" in runs:
        ends, goes_on = (one.percent("jump") for one in (base, runs["build_robot"]))
        result.append(
            f"With packets that end at an E-stop P(jump) at {DURATIONS[-1]} packets is"
            f" {ends[-1]:.0f} %, with packets that go on, encoders and filter (build_robot)"
            f" {goes_on[-1]:.0f} %; at shorter faults the two differ by"
            f" {np.abs(goes_on - ends)[:-1].max():.0f} points at the most. The published rate is"
            f" {jumps[-2]:.0f} % at {DURATIONS[-2]} and {jumps[-1]:.0f} % at {DURATIONS[-1]}."
        )
    result.append(
        "Not reproduced: the reference of the publication is the recorded robot run, ours the"
        " golden run; the latch is assigned once, in the original in each cycle of packet t1, with"
        " the command of the last of them; the desired motor velocity is 0, in the original that of"
        " the first packet; process jitter, which made the original's repeats differ, is replaced"
        " by ten onsets."
    )
    return tuple(result)


def _packets(
    base: VariantRuns,
    runs: Mapping[str, VariantRuns],
    jumps: np.ndarray,
    stops: np.ndarray,
    bands: Sequence[tuple[float, float]],
    error: float,
) -> Iterator[str]:
    """What hangs on how long packets last."""
    lengths = {name: runs[name] for name in (attacks.DECLARED, *attacks.LENGTHS) if name in runs}
    if not lengths:
        return
    inside = {name: _inside(one, bands) for name, one in {"baseline": base, **lengths}.items()}
    shorts = ", ".join(
        f"{name} {float(one.percent('jump')[1]):.1f} %" for name, one in lengths.items()
    )
    spread = attacks.spread([base, *lengths.values()], "stop")
    between = (
        0
        if spread is None
        else int(((spread[0] - error <= stops) & (stops <= spread[1] + error)).sum())
    )
    levers = [runs[name].percent("stop") for name in attacks.LEVERS if name in runs]
    moved = max((float(np.abs(one - base.percent("stop")).max()) for one in levers), default=0.0)
    yield (
        f"Durations whose share of jumps is inside its band, of {len(DURATIONS)}:"
        f" {', '.join(f'{name} {count}' for name, count in inside.items())}. {attacks.DECLARED} is"
        " the baseline that was declared before it was known how long packets of a recorded robot"
        f" last. P(jump) at 2 packets, of which {float(jumps[1]):.0f} % jumped: baseline"
        f" {float(base.percent('jump')[1]):.1f} %, {shorts}. The published E-stops lie inside what"
        f" other lengths of packets span at {between} of {len(DURATIONS)} durations; a longer lever"
        f" moves them by {moved:.1f} points at the most."
    )


def _inside(runs: VariantRuns, bands: Sequence[tuple[float, float]]) -> int:
    """Durations whose share of jumps is in its band."""
    return sum(
        attacks.in_band(p, band) for p, band in zip(runs.percent("jump"), bands, strict=True)
    )


def fits(
    percent: np.ndarray, jumps: np.ndarray, bands: Sequence[tuple[float, float]], error: float
) -> bool:
    """Whether every duration is in its band and no bias is seen."""
    inside = all(attacks.in_band(p, band) for p, band in zip(percent, bands, strict=True))
    return inside and attacks.bias(percent, jumps, error).p > SIGNIFICANT


def _has(cases: Sequence[VariantCase], name: str) -> bool:
    return any(case.name == name for case in cases)


def _largest(cases: Sequence[VariantCase], name: str) -> float:
    """Largest percent over durations of the case of that name."""
    return float(next(case.runs.percent(case.hit).max() for case in cases if case.name == name))


def _listed_changes(changed: Mapping[str, int]) -> str:
    still = [f"{name} {changed[name]}" for name in ("noise", "substeps_10") if name in changed]
    return f" Cells changed by noise and plant steps: {', '.join(still)}." if still else ""


CAMPAIGN = "dsn16_b.toml"
BASELINE = "baseline"
FAULT = "group.scenario_b.fault.0"
NEGATIVE = ",".join(
    f"-{v}"
    for v in (
        100,
        200,
        400,
        800,
        1000,
        2000,
        4000,
        5000,
        8000,
        10000,
        20000,
        40000,
        80000,
        100000,
        200000,
        400000,
        800000,
    )
)

SEMANTICS = (
    Variant(
        attacks.DECLARED,
        CAMPAIGN,
        (*attacks.EVERY_CYCLE, "campaign.parameter_set=traj3"),
        "the baseline declared first: a packet each cycle, the authors' law",
    ),
    *attacks.length_variants(CAMPAIGN),
    Variant(
        "dac_saturate",
        CAMPAIGN,
        ("campaign.dac_words=saturate",),
        "large values saturate at 16 bits, not wrap",
    ),
    Variant(
        "dac_unwrapped",
        CAMPAIGN,
        ("campaign.dac_words=unwrapped",),
        "large values are applied as they are",
    ),
    Variant(
        "before_check",
        CAMPAIGN,
        (f"{FAULT}.site=current_cmd",),
        "the fault strikes before the overdrive check",
    ),
    Variant(
        "overwrite",
        CAMPAIGN,
        (f"{FAULT}.effect=overwrite",),
        "the value replaces the command, nothing is added",
    ),
    Variant(
        "offset",
        CAMPAIGN,
        (f"{FAULT}.effect=offset",),
        "the value is added anew in each cycle, nothing is latched",
    ),
    Variant("negative", CAMPAIGN, (f"{FAULT}.value=[{NEGATIVE}]",), "the other sign of the DAC"),
    Variant(
        "build_robot",
        CAMPAIGN,
        ("campaign.build=robot",),
        "encoders, velocity filter; packets go on after a stop",
    ),
    Variant(
        "tool_joints",
        CAMPAIGN,
        ("campaign.build=dyn_sim_tools",),
        "tool joints are measured, not believed to be where they should",
    ),
    Variant(
        "software_raven2",
        CAMPAIGN,
        ("campaign.build=robot", "campaign.software=raven2", "campaign.level=fork2015"),
        "present raven2 software: stops at 20000 counts, gravity torque, PLC and brakes at an"
        " E-stop",
    ),
)
RULES = (
    Variant("jump_0.3mm", CAMPAIGN, ("outcomes.jump_step_mm=0.3",), "jump: two steps above 0.3 mm"),
    Variant("jump_0.5mm", CAMPAIGN, ("outcomes.jump_step_mm=0.5",), "jump: two steps above 0.5 mm"),
)
PLANT = (
    *(
        Variant(
            f"plant_{name}",
            CAMPAIGN,
            (f"campaign.parameter_set={name}",),
            f"the authors' law and their set {name}",
        )
        for name in parameter_sets.SETS
    ),
    Variant("noise", CAMPAIGN, ("campaign.noise=true",), "torque noise of one DAC count"),
    Variant("substeps_10", CAMPAIGN, ("campaign.substeps=10",), "ten plant steps a millisecond"),
)
HANDS = (
    *(Variant(n, CAMPAIGN, o, "another motion from home") for n, o in attacks.MOTIONS.items()),
    *(
        Variant(n, CAMPAIGN, o, "the same stitches, a longer lever")
        for n, o in attacks.LEVERS.items()
    ),
    *(
        Variant(
            f"{n}_every_cycle",
            CAMPAIGN,
            (*o, *attacks.EVERY_CYCLE),
            "a longer lever, a packet each cycle",
        )
        for n, o in attacks.LEVERS.items()
    ),
)


def variants() -> tuple[Variant, ...]:
    """The baseline, every ablation, and the motions that the detector learns from."""
    return (
        Variant(BASELINE, CAMPAIGN),
        *SEMANTICS,
        *RULES,
        *PLANT,
        *HANDS,
        *detector.TRAINING,
    )


def compare(context: Context) -> Findings:
    """Published counts beside the predicted ones, and what each open question is worth."""
    published = Published("dsn16")
    computed = {v.name: v for v in variants() if v.name in context.folders}
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
        *motor_notes(base, runs, [*cases, *rules], jumps, stops, bands, error),
    )
    return Findings(tuple(lines), tables, notes)


def _counts(published: Published, what: str) -> np.ndarray:
    """Published counts in %, by duration."""
    return np.array(
        [100.0 * published.value(f"b.{what}.{d}ms") / published.value("b.runs") for d in DURATIONS]
    )


def _percent(published: Published, what: str, duration: int) -> StudyEstimate:
    """A published count in % with its Wilson interval."""
    from ravenjax.stats.intervals import wilson

    k, n = published.value(f"b.{what}.{duration}ms"), published.value("b.runs")
    rate = wilson(int(k), int(n))
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
    """P(jump) by duration of one trajectory, beside its band; reason: of the place of a duration
    that is outside.
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
    """Which answers to an open question would put this duration into its band."""
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
    """What another trajectory's rate would be if jumps counted inside the published window only."""
    inside = runs.percent("inside")
    return lambda place: f"inside t1 .. t1 + d + 1 alone it is {inside[place]:.1f} %"


def _bias(runs: VariantRuns, jumps: np.ndarray, published: Published, target: str = "") -> Line:
    """Sign test of prediction against publication over the durations."""
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
    """Rates whose published values were withheld."""
    return tuple(
        Line(quantity, "%", None, attacks.rate(base.share(hit).shares.ravel()))
        for quantity, hit in (
            ("prevalence of jumps, all cells", "jump"),
            ("prevalence of E-stops, all cells", "stop"),
            ("jumps without an E-stop, all cells", "missed"),
        )
    )


STUDY = Study(
    name="dsn16_b",
    title="Targeted attacks, scenario B: the shoulder's DAC behind the checks",
    source=(
        'Alemzadeh et al., "Targeted Attacks on Teleoperated Surgical Robots", DSN 2016, Figure 9 b'
    ),
    question="Which values and durations make the tip jump, and which does the robot stop itself?",
    variants=variants(),
    compare=compare,
    targets=("A1",),
    minutes=2.0,
)
