"""Scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for 1 to 128
packets.

The counts are predicted blind: the published ones were withheld on purpose. What the text states in
words is judged.
"""

from __future__ import annotations

from collections.abc import Iterator

from ravenjax.robots.raven2.campaign.config import of_raven
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.study import Context, Findings, Line, Study, Variant, read_notes

CAMPAIGN = "dsn16_a.toml"
BASELINE = "baseline"
DRIFT = "drift"
IDEAL_TOOLS = "ideal_tools"
WITHHELD = (
    "Its counts are not in this repository, so that they can be predicted blind: no count is met or"
    " missed here."
)
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}

"""Variants that tell where a jump in one packet comes from."""

ABLATIONS = (
    Variant(
        DRIFT,
        CAMPAIGN,
        ("campaign.console=increments",),
        "packets carry increments: the displacement grows",
    ),
    *attacks.length_variants(CAMPAIGN),
    Variant(
        "drift_slow_replay",
        CAMPAIGN,
        ("campaign.console=increments", *attacks.SLOW_REPLAY),
        "the displacement grows, the motion is replayed at half the speed",
    ),
    Variant(
        IDEAL_TOOLS,
        CAMPAIGN,
        ("campaign.build=dyn_sim",),
        "the published build, which believes its tool joints to be where they should",
    ),
    Variant(
        attacks.DECLARED,
        CAMPAIGN,
        (*attacks.EVERY_CYCLE, "campaign.build=dyn_sim", "campaign.parameter_set=traj3"),
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
    *(Variant(n, CAMPAIGN, o, "another motion from home") for n, o in attacks.MOTIONS.items()),
    *(
        Variant(n, CAMPAIGN, o, "the same stitches, a longer lever")
        for n, o in attacks.LEVERS.items()
    ),
)


def variants() -> tuple[Variant, ...]:
    """The baseline, every ablation, and the motions that the detector learns from."""
    return (Variant(BASELINE, CAMPAIGN), *ABLATIONS, *detector.TRAINING)


def compare(context: Context) -> Findings:
    """What is predicted by displacement and duration, and what each open question is worth."""
    computed = {v.name: v for v in variants() if v.name in context.folders}
    trained = [v.name for v in detector.TRAINING]
    runs = {
        name: attacks.read_runs(name, context.folders[name])
        for name in computed
        if name not in trained
    }
    base = runs[BASELINE]
    cases = [
        VariantCase(one, computed[name].question) for name, one in runs.items() if name != BASELINE
    ]
    levels = detector.thresholds(detector.learn_from_folders(context.folders))
    watched = {
        name: detector.watch(context.folders[name], runs[name], levels)
        for name in (BASELINE, IDEAL_TOOLS)
        if name in runs
    }
    jumps = {
        name: detector.jump_case(runs[name], one, of_raven(runs[name].config).outcomes.jump_step_mm)
        for name, one in watched.items()
    }
    main = [base, *(runs[name] for name in (DRIFT,) if name in runs)]
    lines = [line for one in main for hit in OUTCOMES for line in _rates(one, hit)]
    lines += [_overall(one, hit) for one in main for hit in OUTCOMES]
    stated = (*attacks.of_attack(base), detector.visible_line(jumps[BASELINE]))
    lines += stated
    rules = attacks.other_jump_rules(base, watched[BASELINE].leaps)
    own = VariantCase(base, "", label=BASELINE)
    tables = (
        attacks.sensitivity_table(
            "P(jump), %, by duration: what each open question is worth",
            [own, *rules, *cases],
            base,
            note=attacks.SENSITIVITY_NOTE,
        ),
        *(
            attacks.sensitivity_table(
                f"{OUTCOMES[hit]}, %, by duration",
                [c._replace(hit=hit) for c in (own, *cases)],
                base,
                hit=hit,
            )
            for hit in ("stop", "ik")
        ),
    )
    notes = (
        attacks.verdict("Scenario A", stated) + " " + WITHHELD,
        detector.jump_note(jumps.values()),
        *read_notes("dsn16_a"),
    )
    return Findings(tuple(lines), tables, notes)


def _rates(runs: VariantRuns, hit: str) -> Iterator[Line]:
    cells = runs.share(hit)
    for duration in DURATIONS:
        predicted = attacks.rate(cells.of(duration))
        yield Line(
            f"{OUTCOMES[hit]}, {duration} packets; {runs.name}, lever {runs.lever.words}",
            "%",
            None,
            predicted,
        )


def _overall(runs: VariantRuns, hit: str) -> Line:
    predicted = attacks.rate(runs.share(hit).shares.ravel())
    return Line(f"{OUTCOMES[hit]}, all cells; {runs.name}", "%", None, predicted)


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
