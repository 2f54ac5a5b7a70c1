"""Study of scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for
1 to 128 packets.

The counts are predicted blind, because the published ones were withheld on purpose. The statements
of the publication's text are tested.
"""

from __future__ import annotations

from collections.abc import Iterator

from ravenjax.robots.raven2.campaign.config import of_raven
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.study import Context, Findings, Line, own_line, read_notes, read_variants, study

BASELINE = "baseline"
DRIFT = "drift"
IDEAL_TOOLS = "ideal_tools"
WITHHELD = (
    "Its counts are not in this repository, so that they can be predicted blind: no count is met or"
    " missed here."
)
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}
"""Counted columns of the runs, and their names in tables."""


VARIANTS = (*read_variants("dsn16_a"), *detector.TRAINING)
"""The baseline, every ablation, and the motions from which the detector learns."""


def compare(context: Context) -> Findings:
    """Return predictions by displacement and duration, and how much each open question matters."""
    computed = {v.name: v for v in VARIANTS if v.name in context.folders}
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
        yield own_line(
            f"{OUTCOMES[hit]}, {duration} packets; {runs.name}, lever {runs.lever.words}",
            "%",
            predicted,
        )


def _overall(runs: VariantRuns, hit: str) -> Line:
    predicted = attacks.rate(runs.share(hit).shares.ravel())
    return own_line(f"{OUTCOMES[hit]}, all cells; {runs.name}", "%", predicted)


STUDY = study("dsn16_a", variants=VARIANTS, compare=compare)
