"""Commands of the training session: `ravenjax train`, `robot`, `study`, `log`."""

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter, validators

from ravenjax import interruption
from ravenjax.cli import console
from ravenjax.cli.console import Overrides, Switch, load_module

Crtk = Literal["ros1", "ros2"] | None
ConsoleProfile = Annotated[str, Parameter("--console")]
Seed = Annotated[int | None, Parameter(validator=validators.Number(gte=0, lt=2**31))]
Port = Annotated[int, Parameter(validator=validators.Number(gte=0, lte=65535))]

log = App(name="log", help="Repair and convert recordings of sessions and traces of runs.")
study = App(
    name="study",
    help="Compare groups of sessions (ravenjax study FOLDERS), and assign participants to groups.",
)


def train(
    scenario: str = "first_steps",
    *,
    out: Path | None = None,
    overrides: Overrides = None,
    seed: Seed = None,
    participant: str = "",
    group: str = "",
    cue: bool | None = None,
    blinded: bool | None = None,
    script: str | None = None,
    page: bool = True,
    headless: Switch = False,
    linger: float | None = None,
    host: str = "127.0.0.1",
    port: Port = 8080,
    token: str | None = None,
    instructor_token: str | None = None,
    itp_port: int | None = None,
    console_profile: ConsoleProfile = "raven",
    console_host: str | None = None,
    robot: str | None = None,
    crtk: Crtk = None,
) -> None:
    """Train on one robot in real time, in the browser: move it, respond to a hazard, and read the
    debrief.

    Args:
        scenario: Scenario file, or the name of a bundled scenario (see `ravenjax campaigns`).
        out: session folder, never overwritten; default results/sessions/NAME-PARTICIPANT-TIME-SEED
        seed: seed of the times of hazards; default the scenario's
        participant: code of the participant of a study
        group: group of the study
        cue: whether the operator feels the force of the cue; default the scenario's
        blinded: hide the group from everybody; default the scenario's
        script: name of a scripted operator who moves the robot, or a recorded FILE.jsonl
        page: serve the page in the browser
        headless: simulate as fast as possible, without clock and page
        linger: time in s for which the page stays after the end; default until Ctrl-C
        host: address to listen on; addresses that other machines can reach need a token
        port: TCP port of the page; 0: any free port
        token: token that the page requires; default a new token if one is needed
        instructor_token: token of the instructor; default a new token for each session
        itp_port: also accept an ITP console on this UDP port (36000)
        console_profile: packets of the ITP console: raven, dv_trainer, a .toml file, or auto
        console_host: the only host whose ITP console may move the robot; default any
        robot: use a robot on another machine: HOST[:ITP_PORT[:JOINT_PORT]]; JOINT_PORT may be ros1
            or ros2
        crtk: also use CRTK: ros2 (DDS) or ros1 (rospy)
    """
    from ravenjax.errors import UserError

    say = console.print_text
    if not (page or headless or script or crtk) and itp_port is None:
        raise UserError("nobody moves the robot: add --page, --script, --itp-port or --crtk")
    with _exit_with_message(), interruption.delay_signals(), contextlib.ExitStack() as stack:
        helpers = None
        if not headless:
            from ravenjax.train import page as pages
            from ravenjax.train.processes import SessionHelpers

            # The page answers at once, while this process and the helper processes import modules.
            open_port = None
            if page:
                token, instructor_token = pages.choose_tokens(host, token, instructor_token)
                open_port = pages.open_port(host, port, token, instructor_token, say)
            helpers = SessionHelpers(stack, open_port)
            message = f"{scenario}: preparing the session; the first time takes longest"
            helpers.show_progress(message, say)
        from ravenjax.train import launch
        from ravenjax.train import scenario as scenarios

        interruption.check_interruption()
        chosen = scenarios.load_scenario(scenario, overrides or ())
        chosen_seed = chosen.seed if seed is None else seed
        options = launch.SessionOptions(
            scenario=chosen,
            folder=out or launch.new_folder_path(chosen.name, participant, chosen_seed),
            seed=chosen_seed,
            participant=participant,
            group=group,
            cue=cue,
            blinded=blinded,
            host=host,
            port=port,
            token=token,
            instructor_token=instructor_token,
            script=script,
            itp_port=itp_port,
            console=console_profile,
            console_host=console_host,
            robot=robot,
            crtk=crtk,
        )
        if headless:
            result = launch.run_headless(options, say)
        else:
            result = launch.run_realtime(
                options, with_page=page, linger_s=linger, say=say, helpers=helpers
            )
    # Further sessions use the same address, so that browser windows reconnect.
    while result.next_command is not None:
        say(f"session: {result.folder} ({result.ended})")
        options = launch.next_options(options, result)
        say(f"{options.scenario.name}: preparing the next session")
        with _exit_with_message(), interruption.delay_signals():
            result = launch.run_realtime(options, with_page=page, linger_s=linger, say=say)
    say(f"session: {result.folder} ({result.ended})")


@contextlib.contextmanager
def _exit_with_message() -> Iterator[None]:
    """On Ctrl-C or SIGTERM before a session, or a third Ctrl-C in it, print a message and exit."""
    with interruption.exit_on_signals(signal.SIGTERM):
        try:
            yield
        except (KeyboardInterrupt, SystemExit) as interrupt:
            console.print_text("stopped; if a session began, its recording is kept", console.err)
            code = interrupt.code if isinstance(interrupt, SystemExit) else 128 + signal.SIGINT
            raise SystemExit(code) from None


def robot(
    scenario: str = "first_steps",
    *,
    overrides: Overrides = None,
    seed: Seed = None,
    host: str = "127.0.0.1",
    itp_port: Port = 36000,
    joint_port: Port = 36002,
    token: str | None = None,
    console_host: str | None = None,
    console_profile: ConsoleProfile = "raven",
    crtk: Crtk = None,
) -> None:
    """Run the control software and the virtual robot as a process that any ITP console can move.

    Args:
        scenario: Scenario with the robot and its hazards. `ravenjax train SCENARIO --robot HOST`
            connects a session to it.
        seed: seed with which hazards are drawn; default the scenario's
        host: address to listen on
        itp_port: UDP port of the console; 0: any free port
        joint_port: TCP port of the joint state; 0: any free port
        token: token that commands from other machines must contain
        console_host: the only host that may move the robot; default any
        console_profile: packets of the ITP console: raven, dv_trainer, a .toml file, or auto
        crtk: also use CRTK: ros2 (DDS) or ros1 (rospy)
    """
    from ravenjax.train import scenario as scenarios
    from ravenjax.train.robot_link import process

    options = process.ConsoleOptions(
        host=host,
        token=token,
        itp_port=itp_port,
        console=console_profile,
        console_host=console_host,
        crtk=crtk,
    )
    chosen = scenarios.load_scenario(scenario, overrides or ())
    process.run_robot(chosen, options, seed, joint_port, console.print_text)


def play(
    packets: Path, *, to: str = "127.0.0.1:36000", console_profile: ConsoleProfile = "auto"
) -> None:
    """Send recorded packets of a console to a robot or a session, at the recorded times.

    Before the first packet the pedal is up for 0.4 s, because a robot accepts a pressed pedal only
    after the pedal was up.

    Args:
        packets: A Parquet file with columns packet and arrival_us (or _s, _ms, _ns), or a capture:
            .pcap, .pcapng.
        to: HOST:PORT of the robot, or of the session (its --itp-port)
        console_profile: format of the packets: raven, dv_trainer, a .toml file, or auto
    """
    from ravenjax.store.motion import packet_file
    from ravenjax.train.robot_link import player

    address = player.parse_host_port(to)
    recorded, _ = packet_file.time_packets(packets, console_profile)
    for note in recorded.notes:
        console.print_text(note)
    summary = player.play_packets(recorded.datagrams, recorded.time, address, console.print_text)
    console.print_text(summary)


@study.default
def compare(
    folders: list[Path], *, out: Path = Path("results/study"), unblind: Switch = False
) -> None:
    """Compare groups of training sessions, or sessions with and without the cue.

    The comparison has effect sizes and confidence intervals.

    Args:
        folders: Session folders, or folders of session folders.
        out: folder of the comparison
        unblind: show the groups' names instead of A and B
    """
    studies = load_module("training.study")
    result = studies.write_study(folders, out, unblind)
    console.print_text(result.text.rstrip())
    console.print_text(f"study: {result.page}")


@study.command
def assign(
    participants: list[str],
    *,
    groups: Annotated[list[str], Parameter(consume_multiple=True)] = ["on", "off"],  # noqa: B006
    seed: int = 0,
) -> None:
    """Assign participants to groups at random, balanced in blocks, and print the result as CSV.

    Args:
        participants: Codes of the participants, in the order of their sessions.
        groups: names of the groups
    """
    from ravenjax.train.recording.reader import as_csv

    studies = load_module("training.study")
    assignments = studies.assign_groups(participants, groups, seed)
    rows = (assignment._asdict() for assignment in assignments)
    console.print_text(as_csv(studies.Assignment._fields, rows).rstrip())


@study.command
def plan(
    participants: int,
    *,
    paired: Annotated[bool, Parameter(negative="--parallel")] = True,
    effect: float | None = None,
) -> None:
    """Show what a study can prove: the smallest p-value, and the number of participants needed.

    Args:
        participants: Total number of participants.
        paired: each participant trains under both conditions; --parallel: under one of them
        effect: standardised difference that the study must find with a power of 0.8
    """
    studies = load_module("training.study")
    console.print_text(studies.describe_plan(studies.plan_study(participants, paired, effect)))


@log.command
def recover(file: Path, *, out: Path | None = None) -> None:
    """Repair a recording that is truncated or damaged.

    Args:
        file: session.mcap of a session whose process was killed.
        out: repaired file; default FILE.recovered.mcap
    """
    from ravenjax.errors import UserError
    from ravenjax.store.logs import mcap_records as store

    if out is not None and out.exists() and file.exists() and out.samefile(file):
        raise UserError(
            f"--out {out} is the recording itself; expected another file, because the damaged"
            " recording is kept"
        )
    console.print_text(store.recover_records(file, out))


@log.command
def bag(recording: Path, *, ros: Literal[1, 2] = 1, out: Path | None = None) -> None:
    """Convert the recording of a session, or the trace of a run, to a ROS bag.

    Args:
        recording: session.mcap, the folder of a session, or the .mcap of a traced run.
        ros: 1: a .bag file, 2: a folder of ROS 2 (SQLite)
        out: the bag; default beside the recording, as NAME.bag or NAME_ros2
    """
    from ravenjax.store.logs import bags

    console.print_text(bags.write_bag(recording, ros, out))


@log.command
def debrief(folder: Path) -> None:
    """Write the debrief of a session, even if the session was interrupted.

    Args:
        folder: Folder of the session, such as results/sessions/dac_burst-20260101-120000.
    """
    from ravenjax.train.debrief import page

    console.print_text(f"debrief: {page.write_debrief(folder)}")
