"""The command `calibrate`: estimates a robot's parameters from its log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ravenjax.cli import console

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ravenjax.analyses.calibration.calibrate import Calibration, LoggedRobot
    from ravenjax.analyses.calibration.position_loop import LoopParams

SET = "power_consistent"
"""Parameter set whose values are the prior, before the log is read."""
EVERYTHING = "friction,offsets,motors,cables,delays"


def calibrate(
    log: Path,
    *,
    out: Path = Path("my_robot.toml"),
    arm: Literal["gold", "green"] = "gold",
    tool: str | None = None,
    software: Literal["raven2", "fork2015"] = "raven2",
    gains: Literal["raven2", "fork2015"] | None = None,
    period_ms: float | None = None,
    columns: str = "",
    topics: str | None = None,
    ask: str = EVERYTHING,
    draws: int = 200,
) -> None:
    """Estimate your robot's parameters from a log of its joints.

    The parameters are friction, offsets, motor constants, cables and delays. The command fits
    them to the first half of the log. It tests the fit on the second half, and compares it with
    a null model. The null model is bare rotors: motors with cut cables and only viscous friction.
    Parameters that the log does not determine keep their prior. A campaign with `[parameters]
    from = "my_robot.toml"` then draws a robot for each run.

    Parameters
    ----------
    log
        Desired and measured joints: a bag of ROS 1 or ROS 2 or an MCAP file with raven2's
        ravenstate or CRTK's measured_js and setpoint_js; or a table, text or .parquet, with
        columns as jpos_d_shoulder and jpos_shoulder (rad, insertion m), or mpos_d_, or mpos_
        with dac_.
    out
        file for campaigns; its pictures beside it
    arm
        whose joints the log has
    tool
        its tool; default the software's own
    software
        decides how the first jaw is strung: raven2 opposes it
    gains
        PID of the log's robot; default that of its software
    period_ms
        time between samples, instead of the log's own
    columns
        names of a table's columns, a comma between: all in order where it has no header line, or
        NAME=THEIRS for each that the log calls differently
    topics
        namespace of the arm's joints in a bag, such as /lab/arm1
    ask
        what the log is asked for, a comma between
    draws
        robots that are written
    """
    from ravenjax.analyses.calibration import joint_log, parameters, position_loop, tables
    from ravenjax.analyses.calibration.calibrate import LoggedRobot
    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
    from ravenjax.robots.raven2.plant import robot
    from ravenjax.robots.raven2.setup import RavenSetup
    from ravenjax.store.files import write_text

    if draws < 1:
        raise UserError(f"--draws {draws}: expected at least 1 robot")
    tool = tool or DEFAULT_TOOLS[software][arm]
    given = [word.strip() for word in columns.split(",")] if columns else []
    named = dict(word.split("=", 1) for word in given if "=" in word)
    setup = RavenSetup(software=software, arms=(arm,), tools=(tool,))
    controller = position_loop.CONTROLLERS[gains or software]
    logged = LoggedRobot(
        joint_log.read_joint_log(
            log, arm, tool, software, controller, period_ms, named or given, topics
        ),
        setup,
        arm,
        controller,
    )
    for note in logged.log.notes:
        console.print_text(note)
    wanted = parameters.select_unknowns(
        logged.log.joints, [word.strip() for word in ask.split(",")]
    )
    calibrated = logged.calibrated(robot.params(setup, arm, SET), wanted)
    _show(logged, calibrated, {"before": calibrated.base, "calibrated": calibrated.robot})
    values = parameters.values_by_path(
        calibrated.base, calibrated.unknowns, calibrated.draws(draws)
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, parameters.format_robot_file(values, arm, SET, log))
    pictures = out.with_suffix(".svg"), out.with_name(f"{out.stem}_parameters.svg")
    whole = logged.log.compared(0, len(logged.log.desired))
    replayed = logged.replayed(whole, [calibrated.robot])[0]
    tables.draw_errors(pictures[0], whole, replayed, len(logged.log.desired) // 2)
    tables.draw_intervals(pictures[1], calibrated)
    console.print_text(f'robots: {out}; in a campaign: [parameters] from = "{out.name}"')
    console.print_text(f"pictures: {pictures[0]}, {pictures[1]}")


def _show(logged: LoggedRobot, calibrated: Calibration, robots: Mapping[str, LoopParams]) -> None:
    from ravenjax.analyses.calibration import tables

    joints = logged.log.joints
    where = ("where the robot was fitted", "on the rest, to which nothing was fitted")
    titles = (f"Following error {place}: rms (times the log's), off by" for place in where)
    judged = [
        tables.by_joint(title, logged.judged(part, robots), joints)
        for title, part in zip(titles, logged.halves, strict=True)
    ]
    for rows in (*judged, tables.tabulate_parameters("What the log determines", calibrated)):
        console.print_table(rows.title, rows.columns, rows.cells)
    integrated = [
        unknown.path
        for unknown in calibrated.unknowns
        if unknown.name == "offset" and logged.controller.ki[unknown.joint or 0] > 0.0
    ]
    if integrated:
        console.print_text(
            f"{', '.join(integrated)}: includes what the controller's integral held at the start of"
            " the log"
        )
    for one, other, correlation in calibrated.confounded:
        console.print_text(
            f"not separable by this log: {one} and {other}, correlation {correlation:.2f}"
        )
    for one, steps in calibrated.unlikely:
        console.print_text(
            f"unlikely: {one} is {abs(steps):.1f} standard deviations from its value before the"
            " log; check whether something else differs between robot and model"
        )
