"""Study of scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for
1 to 128 packets.

The rates were predicted before the published ones were seen. The statements of the publication's
text are tested.
"""

from collections.abc import Iterator

from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import DURATIONS, VariantCase, VariantRuns
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    own_line,
    read_notes,
    read_table,
    read_variants,
    study,
)

NAME, DRIFT, IDEAL_TOOLS = "dsn16_a", "drift", "ideal_tools"
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}
"""Counted columns of the runs, and their names in tables."""
VARIANTS = (*read_variants(NAME), *detector.TRAINING)
"""The baseline, every ablation, and the motions from which the detector learns."""


def compare(context: Context) -> Findings:
    """Return predictions by displacement and duration, and how much each open question matters."""
    found = detector.read_scenario(VARIANTS, context.folders)
    base, runs = found.base, found.runs
    watched = {base.name: found.watched}
    if IDEAL_TOOLS in runs:
        folder = context.folders[IDEAL_TOOLS]
        watched[IDEAL_TOOLS] = detector.watch(folder, runs[IDEAL_TOOLS], found.levels)
    main = [base, *(runs[name] for name in (DRIFT,) if name in runs)]
    lines = [line for one in main for hit in OUTCOMES for line in _rates(one, hit)]
    for one in main:
        for hit, words in OUTCOMES.items():
            overall = attacks.rate(one.share(hit).to_numpy().ravel())
            lines.append(own_line(f"{words}, all cells; {one.name}", "%", overall))
    stated = (*attacks.of_attack(base), detector.visible_line(base, found.watched))
    own = VariantCase(base, "", label=base.name)
    tables = [
        attacks.sensitivity_table(
            "P(jump), %, by duration: what each open question is worth",
            [own, *found.rules, *found.cases],
            base,
            note=attacks.SENSITIVITY_NOTE,
        )
    ]
    for hit in ("stop", "ik"):
        cases = [case._replace(hit=hit) for case in (own, *found.cases)]
        title = f"{OUTCOMES[hit]}, %, by duration"
        tables.append(attacks.sensitivity_table(title, cases, base, hit=hit))
    rates = detector.rate_rows(found, Published("dsn16"), "a")
    tables.append(read_table(NAME, "rates", rates))
    notes = (
        attacks.verdict("Scenario A", stated),
        " ".join(detector.jump_note(runs[name], one) for name, one in watched.items()),
        *read_notes(NAME),
    )
    return Findings((*lines, *stated), tuple(tables), notes)


def _rates(runs: VariantRuns, hit: str) -> Iterator[Line]:
    cells = runs.share(hit)
    for duration in DURATIONS:
        words = f"{OUTCOMES[hit]}, {duration} packets; {runs.name}, lever {runs.lever}"
        yield own_line(words, "%", attacks.rate(cells[duration].to_numpy()))


STUDY = study(NAME, variants=VARIANTS, compare=compare)
