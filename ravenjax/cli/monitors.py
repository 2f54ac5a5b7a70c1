"""The commands `ravenjax monitor` and `ravenjax counterfactual`.

`monitor` calibrates checks on fault-free motion to a stated false-alarm rate, and tests whether the
calibration is still valid. `counterfactual` finds additional checks that detect faults which evade
the robot's checks.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Engine, Listing, Overrides, Switch, Words

if TYPE_CHECKING:
    from ravenjax.analyses.monitors.calibration import Calibrated

monitor = App(
    name="monitor", help="Monitors with a stated false-alarm rate: calibrate, check for a shift."
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
    """Calibrate a monitor: thresholds that keep a false-alarm rate with the given confidence.

    The thresholds come from fault-free operations. Each operator has another motion, and each
    of its operations another robot, drawn as the campaign's [parameters], noise and packets
    say. An interrupted command continues. Writes monitor.toml, monitor.py, detector.toml (a
    [[detector]] with its threshold), monitor.c, monitor.h and test_vector.csv.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one: its robot; groups and faults are left out.
    out
        folder; default results/monitors/NAME of the campaign
    signals
        names that `ravenjax monitor signals` lists, * for any letters; default tip_error_bound
        boards_cmd_rate*
    segments
        bands in stretches by a number of the view: tick=1000,5000 or surgeon_mode=1
    false_alarms_per_hour
        that are not exceeded
    confidence
        with which they are not
    hours
        of operation in all; default what rate and confidence need, with room to spare
    length_s
        of an operation, s
    robots
        operations of each operator, each with a robot that is drawn
    motions
        generated motions of operators; default all that vary
    seed
        of operators and robots
    """
    from ravenjax.analyses.monitors import calibrate as calibration
    from ravenjax.campaign import loading

    config = loading.load_campaign(file, overrides or ())
    request = calibration.Request(
        config,
        signals or (),
        segments,
        false_alarms_per_hour,
        confidence,
        length_s,
        robots,
        motions or (),
        seed,
    )
    place = out or Path("results/monitors") / config.campaign.name
    with _progress(as_json) as progress:
        result = calibration.calibrate_monitor(request, place, hours, engine, progress)
    _tell(place, result, as_json)


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
    """Simulate fresh fault-free operations for `ravenjax monitor check`: other operators, or with
    --set another robot.

    Parameters
    ----------
    folder
        What `ravenjax monitor calibrate` wrote.
    out
        folder for the operations
    hours
        of operation in all
    robots
        operations of each operator; default the calibration's
    """
    from ravenjax.analyses.monitors.calibrate import operate_afresh

    with _progress(as_json) as progress:
        peaks = operate_afresh(folder, out, hours, overrides or (), robots, engine, progress)
    if as_json:
        return console.emit_json(
            {"folder": out, "operations": len(peaks.unit), "hours": float(peaks.hours.sum())}
        )
    return console.print_text(f"{len(peaks.unit)} operations: {out}")


@monitor.command
def check(
    folder: Path, *sources: Path, level: float = 0.05, seed: int = 0, as_json: AsJson = False
) -> int:
    """Test whether new fault-free operations have the calibration's distribution of scores.

    The exit code is 1 for a shift. The first operation of each operator, result folder or log
    counts.

    Parameters
    ----------
    folder
        What `ravenjax monitor calibrate` wrote.
    sources
        Folders of `ravenjax monitor operate`, or of `ravenjax run` with monitor.py as a
        detector, or logs: CSV with the columns of test_vector.csv.
    level
        probability of reporting a shift although nothing changed
    seed
        that breaks ties between scores
    """
    from ravenjax.analyses.monitors import checking

    result = checking.check_exchangeability(folder, sources, level, seed)
    shifted, about = bool(result["shifted"].any()), result.attrs
    if as_json:
        console.emit_json({"signals": result.to_dict("records"), **about, "shifted": shifted})
        return int(shifted)
    rows = result.to_dict("records")
    console.print_tables(console.fill_listings("shift.j2", rows=rows), as_json)
    console.print_text(
        f"{about['units']} units, {about['operations']} operations, {about['hours']:.3g} h,"
        f" {about['alarms']} with an alarm"
    )
    console.print_text(
        f"SHIFT at level {level:g}: fresh operations are not drawn as the calibration's were, and"
        " its promise does not hold for them. Calibrate on what they are like"
        if shifted
        else f"no shift found at level {level:g}; with so few units a small one stays unseen"
    )
    return int(shifted)


@monitor.command
def signals(file: Path | None = None, *, as_json: AsJson = False) -> None:
    """List the signals that a monitor can use.

    Parameters
    ----------
    file
        campaign whose robot it is; default the Raven-II's
    """
    from ravenjax import robots
    from ravenjax.analyses.monitors.scores import list_candidates
    from ravenjax.campaign import loading

    robot = loading.load_campaign(file, runs=False).robot if file is not None else robots.USUAL
    rows = [
        (signal.name, signal.words, ", ".join(dict.fromkeys(signal.units)), signal.layer)
        for signal in list_candidates(robot)
    ]
    console.print_tables(
        [Listing("signals", robot.title, ("name", "what", "unit", "layer"), rows)], as_json
    )


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
    from ravenjax.analyses.monitors.counterfactual.candidates import SMALLEST_SCALE, Question
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
        found = finding.find_checks(config, question, engine, stage, watch)
        paths = output.write_files(found, place)
        sure = (
            finding.confirm_checks(found, paths[-1], config.campaign.seed + 1, engine, watch)
            if confirm
            else None
        )
    sentences = [*output.finding_sentences(found), *([sure.sentence] if sure else [])]
    if as_json:
        plain = {
            "sentences": sentences,
            "checks": [row for row in output.candidate_table(found) if row["chosen"]],
        }
        return console.emit_json(plain | {"files": [str(path) for path in paths]})
    console.print_tables(console.fill_listings("counterfactual.j2", found=found), as_json)
    text = console.render_template("checks.j2", found=found, smallest=SMALLEST_SCALE)
    console.print_text("\n".join([text, *sentences]))
    return console.print_written(paths)


def _tell(place: Path, result: Calibrated, as_json: bool) -> None:
    from ravenjax.analyses.monitors import writing

    _, record = writing.read_monitor(place)
    if as_json:
        return console.emit_json({"folder": place, **record})
    rows = [
        (term.name, ", ".join(f"{limit:.4g}" for limit in limits), term.units[0])
        for term, limits in zip(result.monitor.terms, result.monitor.limits.tolist(), strict=True)
    ]
    console.print_tables([Listing("terms", "Alarm above", ("term", "limit", "unit"), rows)], False)
    words = record["promise"]["words"]
    return console.print_text(
        console.render_template(
            "monitor.j2", words=words, own=result.threshold, tested=result.test, place=place
        )
    )


@contextlib.contextmanager
def _progress(as_json: bool) -> Iterator[Callable[[int, int], None]]:
    from rich.progress import MofNCompleteColumn, Progress

    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=console.err, disable=as_json) as bar:
        task = bar.add_task("operators", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
