"""Scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for 1 to 128 packets.

Everything here is a prediction: the published counts were withheld on purpose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ravenjax.studies.dsn16 import cells as dsn16_cells
from ravenjax.studies.dsn16 import detection, drawings, sensitivity, statements, trajectory
from ravenjax.studies.dsn16 import runs as dsn16_runs
from ravenjax.studies.dsn16.cells import DURATIONS
from ravenjax.studies.dsn16.runs import VariantRuns
from ravenjax.studies.dsn16.sensitivity import VariantCase
from ravenjax.studies.framework.study import Context, Drawing, Findings, Line, Study, Table, Variant

CAMPAIGN = "dsn16_a.toml"
BASELINE = "baseline"
DRIFT = "drift"
TWO_CYCLES = ("parameters.network.cycles_per_packet=2", "campaign.duration_s=5")
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}

ABLATIONS = (
    Variant(DRIFT, CAMPAIGN, ("campaign.console=increments",), "packets carry increments: the displacement grows"),
    Variant("cycles_2", CAMPAIGN, TWO_CYCLES, "a packet lasts two control cycles instead of one"),
    Variant(
        "drift_cycles_2",
        CAMPAIGN,
        ("campaign.console=increments", *TWO_CYCLES),
        "the displacement grows, two control cycles a packet",
    ),
    Variant(
        "build_robot", CAMPAIGN, ("campaign.build=robot",), "encoders, velocity filter; packets go on after a stop"
    ),
    Variant(
        "software_raven2",
        CAMPAIGN,
        ("campaign.build=robot", "campaign.software=raven2", "campaign.level=fork2015"),
        "present raven2 software: stops at 20000 counts, gravity torque, PLC and brakes at an E-stop",
    ),
    Variant("jump_0.3mm", CAMPAIGN, ("outcomes.jump_step_mm=0.3",), "jump: two steps above 0.3 mm"),
    Variant("jump_0.5mm", CAMPAIGN, ("outcomes.jump_step_mm=0.5",), "jump: two steps above 0.5 mm"),
    *(
        Variant(
            f"plant_{name}", CAMPAIGN, (f"campaign.parameter_set={name}",), f"the authors' law and their set {name}"
        )
        for name in ("traj3", "B", "C", "matlab_main", "matlab_global")
    ),
    Variant("noise", CAMPAIGN, ("campaign.noise=true",), "torque noise of one DAC count"),
    *(Variant(n, CAMPAIGN, o, "another motion from home") for n, o in trajectory.MOTIONS.items()),
    *(Variant(n, CAMPAIGN, o, "the same stitches, a longer lever") for n, o in trajectory.LEVERS.items()),
)


def variants() -> tuple[Variant, ...]:
    """The baseline, every ablation, the motions, and recorded ones where the recording is at hand."""
    recorded = trajectory.recorded()
    real = tuple(Variant(name, CAMPAIGN, over, "recorded hands") for name, over in recorded.items())
    return (Variant(BASELINE, CAMPAIGN), *ABLATIONS, *real, *detection.TRAINING)


def compare(context: Context) -> Findings:
    """What is predicted by displacement and duration, and what each open question is worth."""
    computed = {v.name: v for v in variants() if v.name in context.folders}
    trained = [v.name for v in detection.TRAINING]
    runs, windows = trajectory.apart(
        {name: dsn16_runs.read(name, context.folders[name]) for name in computed if name not in trained}
    )
    base = runs[BASELINE]
    cases = [VariantCase(one, computed[name].question) for name, one in runs.items() if name != BASELINE]
    real = [VariantCase(one, computed[name].question) for name, one in windows.items()]
    levels = detection.thresholds(detection.learn(context.folders))
    watched = detection.watch(context.folders[BASELINE], base, levels)
    main = [base, *(runs[name] for name in (DRIFT,) if name in runs)]
    lines = [line for one in main for hit in OUTCOMES for line in _rates(one, hit)]
    lines += [_overall(one, hit) for one in main for hit in OUTCOMES]
    lines += statements.of_attack(base)
    rules = sensitivity.rules(base, watched.leaps)
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
                f"{OUTCOMES[hit]}, %, by duration", [c._replace(hit=hit) for c in (own, *cases)], base, hit=hit
            )
            for hit in ("stop", "ik")
        ),
        detection.table(base, watched, "Detectors, predicted blind"),
        *_hands(own, real),
    )
    notes = (*_notes(base, runs, cases), trajectory.hands_note(len(real)))
    return Findings(tuple(lines), tables, _drawings(runs, main), notes)


def _hands(own: VariantCase, real: Sequence[VariantCase]) -> Iterator[Table]:
    """The windows of the recording beside the baseline, none where it is not at hand."""
    for hit, words in OUTCOMES.items() if real else ():
        cases = [case._replace(hit=hit) for case in (own, *real)]
        yield sensitivity.table(f"{trajectory.HANDS}: {words}, %, by duration", cases, own.runs, hit=hit)


def _rates(runs: VariantRuns, hit: str) -> Iterator[Line]:
    cells = runs.share(hit)
    for duration in DURATIONS:
        predicted = dsn16_cells.rate(cells.of(duration))
        yield Line(f"{OUTCOMES[hit]}, {duration} packets; {runs.name}, lever {runs.lever.words}", "%", None, predicted)


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
    return Table(f"{OUTCOMES[hit]}, %, by displacement and duration; {runs.name}", heads, tuple(rows))


def _drawings(runs: Mapping[str, VariantRuns], shown: Sequence[VariantRuns]) -> tuple[Drawing, ...]:
    base, two = runs[BASELINE], runs.get("cycles_2")
    others = [n for n in (DRIFT, *trajectory.LEVERS) if n in runs]

    def panel(hit: str) -> drawings.Panel:
        return drawings.Panel(
            title=OUTCOMES[hit],
            predicted=base.percent(hit),
            two_cycles=two.percent(hit) if two is not None else None,
            others={f"{n}, lever {runs[n].lever.words}": runs[n].percent(hit) for n in others},
        )

    maps = {f"jump, {one.name}": one.share("jump") for one in shown} | {"E-stop": base.share("stop")}
    labels = [f"{value:.0f}" for value in base.share("jump").values]
    return (
        Drawing(
            "dsn16_a_duration",
            "Scenario A, 240 runs a duration, all predicted: the shade spans one to two control cycles a packet.",
            drawings.rates([panel(hit) for hit in OUTCOMES], f"predicted, lever {base.lever.words}"),
        ),
        Drawing(
            "dsn16_a_map",
            "Scenario A, predicted: share of twenty onsets in each cell.",
            drawings.maps(maps, labels, "displacement D, um"),
        ),
    )


def _notes(base: VariantRuns, runs: Mapping[str, VariantRuns], cases: Sequence[VariantCase]) -> tuple[str, ...]:
    ranked = sensitivity.ranked(cases, base)
    most = ", ".join(f"{name} {points:+.1f} ({changed} cells)" for name, points, changed in ranked[:8])
    rejects = [f"{one.name} {float(one.percent('ik').mean()):.1f} %" for one in runs.values() if one.hits["ik"].any()]
    notes = [
        "Nothing is published beside these numbers: they are blind predictions. Baseline: replayed packets carry "
        "absolute positions, so the displacement is constant while it lasts; the fork's dynamics-simulator build, one "
        f"control cycle a packet, jumps by the code's rule, a lever of {base.lever.words}.",
        "Displacements, durations and onsets are a fixed grid and no noise is added, so nothing is sampled and a share "
        "has no interval.",
        f"What the answers are worth, mean points of P(jump) over all cells against the baseline: {most}.",
    ]
    if "build_robot" in runs:
        first = [float(one.percent("jump")[0]) for one in (base, runs["build_robot"])]
        notes.append(
            f"Jumps at one packet ({first[0]:.0f} %) are the build's, not the arm's. It believes its tool joints to be "
            "where they should: the wrist that a displaced target asks for turns at once, the reported tip steps out "
            "in one packet and back in the next, and two long steps in a row are a jump; with two packets and more the "
            f"steps are apart. With measured tool joints (build_robot) it is {first[1]:.0f} %."
        )
    notes += [
        "An E-stop at once, whatever the duration, is the position error alone times its gain, beyond 12000 counts; a "
        "shoulder with a longer lever has less to turn for the same displacement, and stops less. After a software "
        "E-stop packets end, and with them jumps: a large displacement that is stopped at once does not jump.",
        "Beyond the fault-free run, the inverse kinematics found no solution in "
        f"{', '.join(rejects) or 'no variant'} of the runs.",
    ]
    return tuple(notes)


STUDY = Study(
    name="dsn16_a",
    title="Targeted attacks, scenario A: the operator's packets displaced",
    source='Alemzadeh et al., "Targeted Attacks on Teleoperated Surgical Robots", DSN 2016',
    question="Which displacements of the desired position make the tip jump, stop the robot, have no solution?",
    variants=variants(),
    compare=compare,
    minutes=2.0,
)
