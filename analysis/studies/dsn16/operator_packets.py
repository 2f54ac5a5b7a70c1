"""Scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for 1 to 128
packets.

The counts are predicted blind: the published ones were withheld on purpose. What the text states in
words is judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ravenjax.robots.raven2.campaign.config import of_raven
from studies.dsn16 import cells as dsn16_cells
from studies.dsn16 import (
    detection,
    drawings,
    jump_joints,
    sensitivity,
    statements,
    timing,
    trajectory,
)
from studies.dsn16 import runs as dsn16_runs
from studies.dsn16.cells import DURATIONS
from studies.dsn16.runs import VariantRuns
from studies.dsn16.sensitivity import VariantCase
from studies.framework.study import Context, Drawing, Findings, Line, Study, Table, Variant

CAMPAIGN = "dsn16_a.toml"
BASELINE = "baseline"
DRIFT = "drift"
IDEAL_TOOLS = "ideal_tools"
WITHHELD = (
    "Its counts are not in this repository, so that they can be predicted blind: no count is met or"
    " missed here."
)
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}

SHORTEST = (IDEAL_TOOLS, "every_cycle", timing.DECLARED, "build_robot")
"""Variants that tell where a jump in one packet comes from."""

ABLATIONS = (
    Variant(
        DRIFT,
        CAMPAIGN,
        ("campaign.console=increments",),
        "packets carry increments: the displacement grows",
    ),
    *timing.variants(CAMPAIGN),
    Variant(
        "drift_slow_replay",
        CAMPAIGN,
        ("campaign.console=increments", *timing.SLOW_REPLAY),
        "the displacement grows, the motion is replayed at half the speed",
    ),
    Variant(
        IDEAL_TOOLS,
        CAMPAIGN,
        ("campaign.build=dyn_sim",),
        "the published build, which believes its tool joints to be where they should",
    ),
    Variant(
        timing.DECLARED,
        CAMPAIGN,
        (*timing.EVERY_CYCLE, "campaign.build=dyn_sim", "campaign.parameter_set=traj3"),
        "the baseline declared first: ideal tool joints, a packet each cycle, the authors' law",
    ),
    Variant(
        "build_robot",
        CAMPAIGN,
        ("campaign.build=robot",),
        "encoders, velocity filter; packets go on after a stop",
    ),
    Variant(
        "software_raven2",
        CAMPAIGN,
        ("campaign.build=robot", "campaign.software=raven2", "campaign.level=fork2015"),
        "present raven2 software: stops at 20000 counts, gravity torque, PLC and brakes at an"
        " E-stop",
    ),
    Variant("jump_0.3mm", CAMPAIGN, ("outcomes.jump_step_mm=0.3",), "jump: two steps above 0.3 mm"),
    Variant("jump_0.5mm", CAMPAIGN, ("outcomes.jump_step_mm=0.5",), "jump: two steps above 0.5 mm"),
    Variant(
        "plant_traj3",
        CAMPAIGN,
        ("campaign.parameter_set=traj3",),
        "the authors' law of motor and cable",
    ),
    *(
        Variant(
            f"plant_{name}",
            CAMPAIGN,
            (f"campaign.parameter_set={name}",),
            f"parameter set {name} of that law",
        )
        for name in ("B", "C", "matlab_main", "matlab_global")
    ),
    Variant("noise", CAMPAIGN, ("campaign.noise=true",), "torque noise of one DAC count"),
    *(Variant(n, CAMPAIGN, o, "another motion from home") for n, o in trajectory.MOTIONS.items()),
    *(
        Variant(n, CAMPAIGN, o, "the same stitches, a longer lever")
        for n, o in trajectory.LEVERS.items()
    ),
)


def variants() -> tuple[Variant, ...]:
    """The baseline, every ablation, the motions, and recorded ones where the recording is at
    hand.
    """
    recorded = trajectory.recorded()
    real = tuple(Variant(name, CAMPAIGN, over, "recorded hands") for name, over in recorded.items())
    return (Variant(BASELINE, CAMPAIGN), *ABLATIONS, *real, *detection.TRAINING)


def compare(context: Context) -> Findings:
    """What is predicted by displacement and duration, and what each open question is worth."""
    computed = {v.name: v for v in variants() if v.name in context.folders}
    trained = [v.name for v in detection.TRAINING]
    runs, windows = trajectory.apart(
        {
            name: dsn16_runs.read(name, context.folders[name])
            for name in computed
            if name not in trained
        }
    )
    base = runs[BASELINE]
    cases = [
        VariantCase(one, computed[name].question) for name, one in runs.items() if name != BASELINE
    ]
    real = [VariantCase(one, computed[name].question) for name, one in windows.items()]
    levels = detection.thresholds(detection.learn(context.folders))
    watched = {
        name: detection.watch(context.folders[name], runs[name], levels)
        for name in (BASELINE, IDEAL_TOOLS)
        if name in runs
    }
    jumps = {
        name: jump_joints.case(runs[name], one, of_raven(runs[name].config).outcomes.jump_step_mm)
        for name, one in watched.items()
    }
    main = [base, *(runs[name] for name in (DRIFT,) if name in runs)]
    lines = [line for one in main for hit in OUTCOMES for line in _rates(one, hit)]
    lines += [_overall(one, hit) for one in main for hit in OUTCOMES]
    stated = (*statements.of_attack(base), jump_joints.visible(jumps[BASELINE]))
    lines += stated
    rules = sensitivity.rules(base, watched[BASELINE].leaps)
    own = VariantCase(base, "", label=BASELINE)
    tables = (
        *(_by_displacement(one, hit) for one in main for hit in OUTCOMES),
        sensitivity.table(
            "P(jump), %, by duration: what each open question is worth",
            [own, *rules, *cases],
            base,
            note=sensitivity.NOTE,
        ),
        *(
            sensitivity.table(
                f"{OUTCOMES[hit]}, %, by duration",
                [c._replace(hit=hit) for c in (own, *cases)],
                base,
                hit=hit,
            )
            for hit in ("stop", "ik")
        ),
        jump_joints.by_kind(jumps),
        jump_joints.by_joint(jumps[BASELINE]),
        detection.table(base, watched[BASELINE], "Detectors, predicted blind"),
        *_hands(own, real),
    )
    notes = (
        statements.verdict("Scenario A", stated) + " " + WITHHELD,
        jump_joints.note(jumps.values()),
        *_notes(base, runs, cases),
        trajectory.hands_note(len(real)),
    )
    return Findings(tuple(lines), tables, _drawings(runs, main), notes)


def _hands(own: VariantCase, real: Sequence[VariantCase]) -> Iterator[Table]:
    """The windows of the recording beside the baseline, none where it is not at hand."""
    for hit, words in OUTCOMES.items() if real else ():
        cases = [case._replace(hit=hit) for case in (own, *real)]
        yield sensitivity.table(
            f"{trajectory.HANDS}: {words}, %, by duration", cases, own.runs, hit=hit
        )


def _rates(runs: VariantRuns, hit: str) -> Iterator[Line]:
    cells = runs.share(hit)
    for duration in DURATIONS:
        predicted = dsn16_cells.rate(cells.of(duration))
        yield Line(
            f"{OUTCOMES[hit]}, {duration} packets; {runs.name}, lever {runs.lever.words}",
            "%",
            None,
            predicted,
        )


def _overall(runs: VariantRuns, hit: str) -> Line:
    predicted = dsn16_cells.rate(runs.share(hit).shares.ravel())
    return Line(f"{OUTCOMES[hit]}, all cells; {runs.name}", "%", None, predicted)


def _by_displacement(runs: VariantRuns, hit: str) -> Table:
    cells = runs.share(hit)
    rows = [
        (int(value), *(round(100.0 * float(x), 1) for x in (*row, row.mean())))
        for value, row in zip(cells.values, cells.shares, strict=True)
    ]
    heads = ("D, um", *(f"{d} packets" for d in DURATIONS), "all durations")
    return Table(
        f"{OUTCOMES[hit]}, %, by displacement and duration; {runs.name}", heads, tuple(rows)
    )


def _drawings(runs: Mapping[str, VariantRuns], shown: Sequence[VariantRuns]) -> tuple[Drawing, ...]:
    base, packets = runs[BASELINE], runs.values()
    others = [n for n in (DRIFT, *trajectory.LEVERS) if n in runs]

    def panel(hit: str) -> drawings.Panel:
        return drawings.Panel(
            title=OUTCOMES[hit],
            predicted=base.percent(hit),
            packets=timing.spread(packets, hit),
            others={f"{n}, lever {runs[n].lever.words}": runs[n].percent(hit) for n in others},
        )

    maps = {f"jump, {one.name}": one.share("jump") for one in shown} | {
        "E-stop": base.share("stop")
    }
    labels = [f"{value:.0f}" for value in base.share("jump").values]
    return (
        Drawing(
            "dsn16_a_duration",
            "Scenario A, 240 runs a duration, all predicted: the shade spans other lengths of"
            " packets.",
            drawings.rates(
                [panel(hit) for hit in OUTCOMES], f"predicted, lever {base.lever.words}"
            ),
        ),
        Drawing(
            "dsn16_a_map",
            "Scenario A, predicted: share of twenty onsets in each cell.",
            drawings.maps(maps, labels, "displacement D, um"),
        ),
    )


def _notes(
    base: VariantRuns, runs: Mapping[str, VariantRuns], cases: Sequence[VariantCase]
) -> tuple[str, ...]:
    ranked = sensitivity.ranked(cases, base)
    most = ", ".join(
        f"{name} {points:+.1f} ({changed} cells)" for name, points, changed in ranked[:8]
    )
    rejects = [
        f"{one.name} {float(one.percent('ik').mean()):.1f} %"
        for one in runs.values()
        if one.hits["ik"].any()
    ]
    notes = [
        (
            "Baseline: replayed packets carry absolute positions, so the displacement is constant"
            " while it lasts; the fork's dynamics-simulator build, but that its tool joints have"
            " inertia, friction and cables and are measured; packets that last as those of a"
            " recorded robot while the hand keeps its speed; jumps by the code's rule; a lever of"
            f" {base.lever.words}."
        ),
        "Displacements, durations and onsets are a fixed grid and no noise is added, so a share has"
        " no interval." + timing.draws_note(base, runs.values()),
        (
            "What the answers are worth, mean points of P(jump) over all cells against the"
            f" baseline: {most}."
        ),
        timing.lengths_note(base, runs.values()),
        _short(base, runs),
        _stops(base, runs),
        (
            "Beyond the fault-free run, the inverse kinematics found no solution in "
            f"{', '.join(rejects) or 'no variant'} of the runs."
        ),
    ]
    return tuple(filter(None, notes))


def _short(base: VariantRuns, runs: Mapping[str, VariantRuns]) -> str:
    """Jumps of the shortest fault, and what they hang on."""
    named = [
        f"{name} {float(runs[name].percent('jump')[0]):.1f} %" for name in SHORTEST if name in runs
    ]
    beside = f" ({', '.join(named)})" if named else ""
    return (
        f"A displacement in one packet makes {float(base.percent('jump')[0]):.1f} % of its runs"
        f" jump{beside}. A build that believes its tool joints to be where they should lets the"
        " wrist turn at once, so that the reported tip steps out in one packet and back in the"
        " next: two long steps in a row."
    )


def _stops(base: VariantRuns, runs: Mapping[str, VariantRuns]) -> str:
    """What the robot's own check does, and whether what it stops has jumped."""
    cells, stopped = base.share("stop"), base.hits["stop"]
    always = [
        f"{value:,.0f}"
        for value, row in zip(cells.values, cells.shares, strict=True)
        if (row >= 0.5).all()
    ]
    levers = [
        f"{name} {float(runs[name].percent('stop').mean()):.1f} %"
        for name in trajectory.LEVERS
        if name in runs
    ]
    longer = f"; with longer levers {', '.join(levers)}" if levers else ""
    return (
        f"The robot stops {float(base.percent('stop').mean()):.1f} % of the runs{longer}."
        " Displacements that it stops in at least half of the runs at every duration:"
        f" {', '.join(always) or 'none'} um. Of {int(stopped.sum())} runs that it stops"
        f" {int((stopped & base.hits['jump']).sum())} jump: with a software E-stop packets end, and"
        " with them the rule that counts jumps."
    )


STUDY = Study(
    name="dsn16_a",
    title="Targeted attacks, scenario A: the operator's packets displaced",
    source='Alemzadeh et al., "Targeted Attacks on Teleoperated Surgical Robots", DSN 2016',
    question=(
        "Which displacements of the desired position make the tip jump, stop the robot, have no"
        " solution?"
    ),
    variants=variants(),
    compare=compare,
    minutes=2.0,
)
