"""Study of scenario A of the targeted attacks (DSN 2016): a displacement is added to the positions
in 1 to 128 packets of the operator. The rates were predicted before the comparison.
"""

from studies import study
from studies.dsn16 import attacks, detector
from studies.study import Published, read_table

NAME, IDEAL_TOOLS = "dsn16_a", "ideal_tools"
VARIANTS = study.read_variants(NAME)
"""The baseline, the other variants, and the fault-free runs from which the detector learns."""


def compare(context: study.Context) -> study.Findings:
    """Compare the statements and rates of the paper, and show how the variants change the rates."""
    found = detector.read_scenario(VARIANTS, context.folders)
    base, runs = found.base, found.runs
    notes = [detector.jump_note(base, found.watched)]
    if IDEAL_TOOLS in runs:
        folder = context.folders[IDEAL_TOOLS]
        watched = detector.watch(folder, runs[IDEAL_TOOLS], found.levels)
        notes.append(detector.jump_note(runs[IDEAL_TOOLS], watched))
    stated = (*attacks.of_attack(base), detector.visible_line(found.watched))
    rows = {"jump": attacks.sensitivity_rows(found.counted)}
    for hit in ("stop", "ik"):
        rows[hit] = attacks.sensitivity_rows([*runs.values()], hit)
    rows["rates"] = detector.rate_rows(found, Published("dsn16"), "a")
    return study.Findings(
        stated,
        tuple(read_table(NAME, key, table) for key, table in rows.items()),
        (" ".join(notes), *study.read_notes(NAME)),
    )


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
