"""Study of scenario A of the targeted attacks (DSN 2016): the operator's packets displaced by D for
1 to 128 packets.

The rates were predicted before the published ones were seen. The statements of the publication's
text are tested.
"""

from collections.abc import Iterator

from studies import study
from studies.dsn16 import attacks, detector
from studies.dsn16.attacks import VariantRuns
from studies.study import Line, Published, own_line, read_table

NAME, DRIFT, IDEAL_TOOLS = "dsn16_a", "drift", "ideal_tools"
OUTCOMES = {"jump": "P(jump)", "stop": "P(E-stop)", "ik": "P(IK reject)"}
"""Counted columns of the runs, and their names in tables."""
VARIANTS = study.read_variants(NAME)
"""The baseline, every ablation, and the motions from which the detector learns."""


def compare(context: study.Context) -> study.Findings:
    """Return predictions by displacement and duration, and how much each open question matters."""
    found = detector.read_scenario(VARIANTS, context.folders)
    base, runs, (own, *cases) = found.base, found.runs, found.cases
    watched = {base.name: found.watched}
    if IDEAL_TOOLS in runs:
        folder = context.folders[IDEAL_TOOLS]
        watched[IDEAL_TOOLS] = detector.watch(folder, runs[IDEAL_TOOLS], found.levels)
    main = [base, *(runs[name] for name in (DRIFT,) if name in runs)]
    stated = (*attacks.of_attack(base), detector.visible_line(base, found.watched))
    rows = {"jump": attacks.sensitivity_rows([own, *found.rules, *cases])}
    for hit in ("stop", "ik"):
        rows[hit] = attacks.sensitivity_rows([one._replace(hit=hit) for one in found.cases], hit)
    rows["rates"] = detector.rate_rows(found, Published("dsn16"), "a")
    notes = (
        attacks.verdict("Scenario A", stated),
        " ".join(detector.jump_note(runs[name], one) for name, one in watched.items()),
        *study.read_notes(NAME),
    )
    return study.Findings(
        (*_rates(main), *stated),
        tuple(read_table(NAME, key, table) for key, table in rows.items()),
        notes,
    )


def _rates(main: list[VariantRuns]) -> Iterator[Line]:
    for one in main:
        for hit, words in OUTCOMES.items():
            for duration, cells in one.share(hit).items():
                quantity = f"{words}, {duration} packets; {one.name}, lever {one.lever}"
                yield own_line(quantity, "%", attacks.rate(cells))
    for one in main:
        for hit, words in OUTCOMES.items():
            yield own_line(f"{words}, all cells; {one.name}", "%", attacks.rate(one.share(hit)))


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
