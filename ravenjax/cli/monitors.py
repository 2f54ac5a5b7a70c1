"""The commands `ravenjax monitor` and `ravenjax counterfactual`.

`monitor` calibrates checks on fault-free motion to a stated false-alarm rate, and tests whether the
calibration is still valid. `counterfactual` finds checks for faults that evade the robot's checks.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from cyclopts import App

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Engine, Listing, Overrides, Switch, Words

monitor = App(
    name="monitor",
    help="Calibrate checks to a stated false-alarm rate, and test whether the rate is still valid.",
)


@monitor.command
def calibrate(
    file: Path,
    *,
    out: Path | None = None,
    signals: Words = None,
    segments: str = "",
    false_alarms_per_hour: float = 1.0,
    confidence: float = 0.95,
    hours: float | None = None,
    length_s: float = 300.0,
    robots: int = 16,
    motions: Words = None,
    seed: int = 0,
    engine: Engine = "auto",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate a monitor: find thresholds with at most a given rate of false alarms.

    The thresholds come from simulated fault-free operations. Each operator has a different motion,
    and each operation a different robot, drawn from the campaign's [parameters], noise and
    packets. An interrupted command continues. The command writes monitor.toml, monitor.py,
    detector.toml (a [[detector]] with its threshold), monitor.c, monitor.h and test_vector.csv.

    Args:
        file: Campaign file, or the name of a bundled campaign. Only its robot is used, not its
            faults.
        out: folder to write; default results/monitors/NAME of the campaign
        signals: signals to monitor, as `ravenjax monitor signals` lists them; * stands for any
            letters; default tip_error_bound boards_cmd_rate*
        segments: a signal and its limits between segments with different thresholds, such as
            tick=1000,5000 or surgeon_mode=1
        false_alarms_per_hour: largest rate of false alarms
        confidence: probability that the rate is not exceeded
        hours: simulated hours in total; default enough for the rate and the confidence
        length_s: duration of an operation, s
        robots: number of operations of each operator, each with a different robot
        motions: generated motions of operators; default all motions that depend on the seed
        seed: seed of operators and robots
    """
    from ravenjax.analyses.monitors import calibrate as calibration
    from ravenjax.analyses.monitors import writing
    from ravenjax.campaign import loading

    config = loading.load_campaign(file, overrides or ())
    rate = false_alarms_per_hour
    request = calibration.Request(
        config, signals or (), segments, rate, confidence, length_s, robots, motions or (), seed
    )
    folder = out or Path("results/monitors") / config.campaign.name
    with _show_progress(as_json) as update_progress:
        result = calibration.calibrate_monitor(request, folder, hours, engine, update_progress)
    _, record = writing.read_monitor(folder)
    if as_json:
        return console.emit_json({"folder": folder, **record})
    terms = zip(result.monitor.terms, result.monitor.limits.tolist(), strict=True)
    console.print_tables(console.fill_listings("terms.j2", terms=terms), as_json)
    # The sentence that states the false-alarm rate and its confidence.
    words = record["promise"]["words"]
    text = console.render_template("monitor.j2", words=words, result=result, folder=folder)
    return console.print_text(text)


@monitor.command
def operate(
    folder: Path,
    *,
    out: Path,
    hours: float,
    robots: int | None = None,
    engine: Engine = "auto",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Simulate new fault-free operations for `ravenjax monitor check`.

    The operators differ from those of the calibration. With --set the robot differs as well.

    Args:
        folder: Folder that `ravenjax monitor calibrate` wrote.
        out: folder for the operations
        hours: simulated hours in total
        robots: number of operations of each operator; default as in the calibration
    """
    from ravenjax.analyses.monitors.calibrate import simulate_new_operators

    with _show_progress(as_json) as update_progress:
        peaks = simulate_new_operators(
            folder, out, hours, overrides or (), robots, engine, update_progress
        )
    if as_json:
        return console.emit_json(
            {"folder": out, "operations": len(peaks.unit), "hours": float(peaks.hours.sum())}
        )
    return console.print_text(f"{len(peaks.unit)} operations: {out}")


@monitor.command
def check(
    folder: Path, *sources: Path, level: float = 0.05, seed: int = 0, as_json: AsJson = False
) -> int:
    """Test whether the calibration of a monitor is valid for new fault-free operations.

    The exit code is 1 if the distribution of scores has shifted. Only the first operation of each
    operator, result folder or log counts.

    Args:
        folder: Folder that `ravenjax monitor calibrate` wrote.
        sources: Folders of `ravenjax monitor operate`, or of `ravenjax run` with monitor.py as a
            detector, or logs: CSV files with the columns of test_vector.csv.
        level: probability of reporting a shift although nothing changed
        seed: seed with which ties between scores are broken
    """
    from ravenjax.analyses.monitors import checking

    result = checking.check_exchangeability(folder, sources, level, seed)
    shifted = bool(result["shifted"].any())
    counts, rows = result.attrs, result.to_dict("records")
    if as_json:
        console.emit_json({"signals": rows, **counts, "shifted": shifted})
        return int(shifted)
    console.print_tables(console.fill_listings("shift.j2", rows=rows), as_json)
    console.print_text(console.render_template("shifted.j2", counts=counts, shifted=shifted))
    return int(shifted)


@monitor.command
def signals(file: Path | None = None, *, as_json: AsJson = False) -> None:
    """List the signals that a monitor can use.

    Args:
        file: campaign file that selects the robot; default the Raven-II
    """
    from ravenjax import robots
    from ravenjax.analyses.monitors.scores import list_candidates
    from ravenjax.campaign import loading

    robot = loading.load_campaign(file, runs=False).robot if file is not None else robots.USUAL
    rows = [
        (signal.name, signal.words, ", ".join(dict.fromkeys(signal.units)), signal.layer)
        for signal in list_candidates(robot)
    ]
    listing = Listing("signals", robot.title, ("name", "meaning", "unit", "layer"), rows)
    console.print_tables([listing], as_json)


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

    Candidates are bounds, rates and residuals of every signal of the robot. All of them observe
    the same runs. The command selects checks with half of the faults and measures their coverage
    with the other half. It measures false alarms on other motions.

    Args:
        file: Campaign file, the name of a bundled campaign, or a result folder.
        out: folder to write; default results/NAME_counterfactual
        false_alarms_per_hour: largest false-alarm rate of all selected checks together
        lead_ms: smallest time between an alarm and the harm for the alarm to count, ms
        hours: hours of fault-free motion to compute
        most: largest number of checks to select
        group: use only the faults of these groups
        seed: seed with which the faults are divided into halves
        confirm: also run the selected checks as detectors, with another seed of the faults
    """
    from ravenjax.analyses.monitors.counterfactual import finding, output
    from ravenjax.analyses.monitors.counterfactual.candidates import SMALLEST_SCALE, Question
    from ravenjax.campaign import loading
    from ravenjax.cli import terminal
    from ravenjax.store import files

    question = Question(false_alarms_per_hour, lead_ms, hours, most, tuple(group or ()), seed)
    config = loading.load_source(file, overrides or ())
    folder = out or Path("results") / f"{config.campaign.name}_counterfactual"
    question.require()
    files.require_writable(folder)

    def print_stage(text: str):
        if not as_json:
            console.print_text(f"- {text}")

    with terminal.Watch(console.err) as watch:
        found = finding.find_checks(config, question, engine, print_stage, watch)
        paths = output.write_files(found, folder)
        sentences = [*output.finding_sentences(found)]
        if confirm:
            # With another seed, the faults are not those with which the checks were selected. The
            # last file is the campaign with the selected checks as detectors.
            new_seed = config.campaign.seed + 1
            confirmation = finding.confirm_checks(found, paths[-1], new_seed, engine, watch)
            sentences.append(confirmation.sentence)
    checks = [row for row in output.candidate_table(found) if row["chosen"]]
    if not as_json:
        console.print_tables(console.fill_listings("counterfactual.j2", found=found), as_json)
        text = console.render_template("checks.j2", found=found, smallest=SMALLEST_SCALE)
        console.print_text(text)
    console.print_findings(sentences, as_json, files=paths, checks=checks)


@contextlib.contextmanager
def _show_progress(as_json: bool) -> Iterator[Callable[[int, int], None]]:
    # Shows a progress bar on standard error, but none with JSON. Yields the function that updates
    # the bar; its arguments are the numbers of finished and of all operators.
    from rich.progress import MofNCompleteColumn, Progress

    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=console.err, disable=as_json) as bar:
        task = bar.add_task("operators", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
