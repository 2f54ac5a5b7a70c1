"""Commands `ravenjax motion`, for recordings of operators, and `calibrate`, for logs of robots.

The module also prints what `ravenjax run` says about a recorded operator.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ravenjax.cli import console
from ravenjax.cli.console import Overrides, Words

if TYPE_CHECKING:
    from rich.console import Console

    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.robots.raven2.campaign.config import RavenConfig
    from ravenjax.store.motion.summary import MotionSummary

PRIOR_SET = "power_consistent"
"""Parameter set whose values are the means of the prior distributions."""
ALL_PARAMETER_GROUPS = "friction,offsets,motors,cables,delays"


def motion(
    file: Path,
    *,
    campaign: str | None = None,
    arms: Words = None,
    overrides: Overrides = None,
    out: Path = Path("results/motions"),
) -> None:
    """Show the content of a recording of hands and the motion that a campaign makes from it.

    Options are those of a campaign, such as --set operator.rate_hz=1000 operator.cutoff_hz=5.
    Without a campaign the whole recording or window is replayed. If a recording cannot be
    replayed, the exit code is 2 and the message states what to change. The command draws the
    recording even then.

    Args:
        file: Recorded tip positions: .parquet, .csv, .txt, .tsv, .mcap, .bag or .db3, or the folder
            of a bag of ROS 2; or a console's packets: .parquet, .pcap or .pcapng.
        campaign: campaign file whose robot, limits and duration are used
        arms: arms to replay; default all arms of the recording
        out: folder for the picture, SVG and PNG
    """
    import numpy as np

    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.campaign import hands
    from ravenjax.store.motion import reach, recording, replay

    config, replay_all = _configure_replay(file, campaign, arms, overrides or [])
    ticks = None if replay_all else config.campaign.ticks
    bounds = hands.operator_bounds(config)
    options = config.operator.options
    try:
        made = replay.replay_motion(
            file, config.campaign.arms, options, ticks, config.operator.scale, bounds=bounds
        )
    except UserError:
        # If the file cannot be read at all, the next line raises that error again.
        raw = recording.load_recording(file, config.campaign.arms, options)
        inside = reach.reach_poses(raw.poses, bounds).inside
        # No row of the recording is replayed.
        courses = replay.tip_courses(raw, inside, np.zeros(0))
        _draw_motion(file, out, courses, "cannot be replayed as it is")
        raise
    _print_summary(made.summary, console.out)
    begin, end = made.summary.window_s
    courses = replay.tip_courses(made.recording, made.reach.inside, made.rows)
    _draw_motion(file, out, courses, f"{begin:.3f} to {end:.3f} s are replayed")


def show_operator(config: CampaignConfig, to: Console) -> None:
    """Print a summary of the motion made from a campaign's recording of hands, if it uses one.

    Raise UserError if the recording cannot be used.
    """
    from ravenjax.robots.raven2.campaign import hands
    from ravenjax.robots.raven2.campaign.config import RavenConfig

    if not isinstance(config, RavenConfig) or config.operator.file is None:
        return
    if (made := hands.operator_replay(config)) is not None:
        _print_summary(made.summary, to)


def _configure_replay(
    file: Path, campaign: str | None, arms: list[str] | None, overrides: list[str]
) -> tuple[RavenConfig, bool]:
    # Returns a campaign whose operator is the recording `file`, and whether to replay all of it
    # instead of the campaign's duration. campaign: path or bundled name; None: default settings.
    from ravenjax.campaign import loading
    from ravenjax.robots.raven2.campaign.config import require_raven
    from ravenjax.store.motion import recording

    if campaign is None:
        raw: dict[str, Any] = {
            "campaign": {"name": "motion", "arms": arms or list(recording.arms_in(file))},
            "operator": {"file": str(file)},
            "group": [{"name": "fault_free"}],
        }
        replay_all = not any(text.startswith("campaign.duration_s") for text in overrides)
        return require_raven(loading.from_dict(raw, overrides=overrides)), replay_all
    base = require_raven(loading.load_campaign(campaign))
    changes = [f"operator.file={file.absolute()}"]
    # A recording replaces a generated motion, so the options of the generated motion are removed.
    if base.operator.file is None:
        changes = ["operator={}", f"operator.scale={base.operator.scale}", *changes]
    if arms:
        changes.append(f"campaign.arms={arms}")
    return require_raven(loading.load_campaign(campaign, [*changes, *overrides])), False


def _print_summary(summary: MotionSummary, to: Console):
    from ravenjax.store.motion.summary import table_rows

    console.print_table("Recorded operator", ("property", "value"), table_rows(summary), to)


def _draw_motion(file: Path, out: Path, courses, title: str):
    # Draws the tip positions of a recording into the folder `out`, and prints the files' paths.
    from ravenjax.report.run.motion_plot import motion_plot

    for path in motion_plot(courses, out, file.stem, f"{file.name}: {title}"):
        console.print_text(f"wrote {path}")


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
    ask: str = ALL_PARAMETER_GROUPS,
    draws: int = 200,
) -> None:
    """Estimate your robot's parameters from a log of its joint positions.

    The parameters are friction, offsets, motor constants, cables and delays. The command fits
    them to the first half of the log. It tests the fit on the second half, and compares the fit
    with a null model: motors with cut cables and only viscous friction. Parameters that the log
    does not determine keep their prior distribution. A campaign with `[parameters] from =
    "my_robot.toml"` then draws a robot for each run.

    Args:
        log: Desired and measured joint positions: a bag of ROS 1 or ROS 2 or an MCAP file with
            raven2's ravenstate or CRTK's measured_js and setpoint_js. Or a table, text or .parquet,
            with columns such as jpos_d_shoulder and jpos_shoulder (rad, insertion m), or mpos_d_
            and mpos_, or mpos_ and dac_.
        out: file to write, for campaigns; pictures are written beside it
        arm: arm whose joints are in the log
        tool: tool of the arm; default the tool of the software
        software: software of the robot; it determines the direction of the first jaw's cable
        gains: PID gains of the robot; default those of its software
        period_ms: time between samples, instead of the times in the log
        columns: names of the columns of a table without a header line, in order and separated by
            commas; or NAME=THEIRS for each column with another name than expected
        topics: namespace of the arm's joints in a bag, such as /lab/arm1
        ask: groups of parameters to estimate, separated by commas
        draws: number of robots to draw from the fit and write
    """
    from ravenjax.analyses.calibration import joint_log, parameters, position_loop, tables
    from ravenjax.analyses.calibration.calibrate import LoggedRobot
    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
    from ravenjax.robots.raven2.plant import robot
    from ravenjax.robots.raven2.setup import RavenSetup
    from ravenjax.store.files import write_text

    if draws < 1:
        raise UserError(f"--draws is {draws}, expected at least 1 robot")
    tool = tool or DEFAULT_TOOLS[software][arm]
    column_names = [word.strip() for word in columns.split(",")] if columns else []
    renamed = dict(word.split("=", 1) for word in column_names if "=" in word)
    setup = RavenSetup(software=software, arms=(arm,), tools=(tool,))
    controller = position_loop.CONTROLLERS[gains or software]
    logged = LoggedRobot(
        joint_log.read_joint_log(
            log, arm, tool, software, controller, period_ms, renamed or column_names, topics
        ),
        setup,
        arm,
        controller,
    )
    for note in logged.log.notes:
        console.print_text(note)
    asked = parameters.select_unknowns(logged.log.joints, [word.strip() for word in ask.split(",")])
    calibrated = logged.calibrated(robot.params(setup, arm, PRIOR_SET), asked)
    models = {"before": calibrated.base, "calibrated": calibrated.robot}
    halves = ("in the first half, which was fitted", "in the second half, which was not fitted")
    for half, samples in zip(halves, logged.halves, strict=True):
        title = f"Rms following error {half} (ratio to the log); off: rms distance to the log"
        errors = logged.following_errors(samples, models)
        console.print_table(title, *tables.by_joint(errors, logged.log.joints))
    fitted = tables.tabulate_parameters(calibrated)
    console.print_table("Estimated parameters", tables.PARAMETER_COLUMNS, fitted)
    # The controller's integral of such a joint acts as an offset of the joint does.
    integrated = [
        unknown.path
        for unknown in calibrated.unknowns
        if unknown.name == "offset" and controller.ki[unknown.joint or 0] > 0.0
    ]
    doubts = {"integrated": integrated, "fit": calibrated, "at_rest": logged.at_rest}
    if text := console.render_template("doubts.j2", **doubts):
        console.print_text(text)
    drawn = parameters.values_by_path(calibrated.base, calibrated.unknowns, calibrated.draws(draws))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, parameters.format_robot_file(drawn, arm, PRIOR_SET, log))
    pictures = out.with_suffix(".svg"), out.with_name(f"{out.stem}_parameters.svg")
    whole = logged.log.compared(0, len(logged.log.desired))
    replayed = logged.replay(whole, [calibrated.robot])[0]
    tables.draw_errors(pictures[0], whole, replayed, len(logged.log.desired) // 2)
    tables.draw_intervals(pictures[1], calibrated)
    console.print_text(f'robots: {out}; a campaign uses them with [parameters] from = "{out.name}"')
    console.print_text(f"pictures: {pictures[0]}, {pictures[1]}")
