"""The command `counterfactual`: selects additional checks that would detect what the robot's checks
do not.
"""

from pathlib import Path

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Engine, Overrides, Switch, Words


def counterfactual(
    file: Path,
    *,
    out: Path | None = None,
    false_alarms_per_hour: float = 4.0,
    lead_ms: int = 10,
    hours: float = 2.0,
    most: int = 8,
    group: Words = None,
    seed: int = 0,
    confirm: Switch = False,
    engine: Engine = "auto",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Select a few additional checks that would detect the faults that evade the robot's checks,
    and estimate their false alarms.

    Candidates are bounds, rates and residuals of every signal of the robot. All observe the
    same runs. Half of the faults selects the checks, and the other half measures them. Separate
    motion measures the false alarms.

    Parameters
    ----------
    file
        Campaign file, the name of a bundled one, or a result folder.
    out
        folder; default results/NAME_counterfactual
    false_alarms_per_hour
        of all chosen checks together, at most
    lead_ms
        an alarm counts only if it comes at least this many ms before harm begins
    hours
        hours of fault-free motion to compute
    most
        checks to choose, at most
    group
        cover faults of these groups alone
    seed
        of the halves of the faults
    confirm
        also run the chosen checks as detectors, with another seed of the faults
    """
    from ravenjax.analyses.monitors.counterfactual import finding, output
    from ravenjax.analyses.monitors.counterfactual.candidates import Question
    from ravenjax.campaign import loading
    from ravenjax.cli import terminal
    from ravenjax.store import files

    question = Question(false_alarms_per_hour, lead_ms, hours, most, tuple(group or ()), seed)
    config = loading.load_source(file, overrides or ())
    place = out or Path("results") / f"{config.campaign.name}_counterfactual"
    question.require()
    files.require_writable(place)

    def stage(text: str) -> None:
        if not as_json:
            console.print_text(f"- {text}")

    with terminal.Watch(console.err) as watch:
        one = finding.find_checks(config, question, engine, stage, watch)
        paths = output.write_files(one, place)
        sure = (
            finding.confirm_checks(one, paths[-1], config.campaign.seed + 1, engine, watch)
            if confirm
            else None
        )
    sentences = [*output.finding_sentences(one), *([sure.sentence] if sure else [])]
    if as_json:
        plain = {
            "sentences": sentences,
            "checks": [row for row in output.candidate_table(one) if row["chosen"]],
        }
        return console.emit_json(plain | {"files": [str(path) for path in paths]})
    console.print_table("", output.COLUMNS, output.set_rows(one))
    console.print_text("\n".join([*(f"  {line}" for line in output.check_lines(one)), *sentences]))
    return console.print_text("\n".join(f"  wrote    {path}" for path in paths))
