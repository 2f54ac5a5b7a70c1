"""Commands of the training session: `train`, `robot`, `study`, `log`."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter, validators

from ravenjax import interruption
from ravenjax.cli import console
from ravenjax.cli.console import Overrides

Crtk = Annotated[
    Literal["ros1", "ros2"] | None, Parameter(help="also speak CRTK: ros2 (DDS) or ros1 (rospy)")
]

_SEED = validators.Number(gte=0, lt=2**31)
_PORT = validators.Number(gte=0, lte=65535)
_SECONDS = validators.Number(gt=0)

log = App(name="log", help="Recordings of sessions, and traces of runs as bags.")
study = App(
    name="study",
    help="Compare groups of sessions: ravenjax study FOLDERS; and draw who is in which group.",
)


def train(
    scenario: str = "first_steps",
    *,
    out: Annotated[
        Path | None,
        Parameter(
            help=(
                "session folder, never overwritten; default"
                " results/sessions/NAME-PARTICIPANT-TIME-SEED"
            )
        ),
    ] = None,
    overrides: Overrides = None,
    seed: Annotated[
        int | None,
        Parameter(help="of the hazards' timing; default the scenario's", validator=_SEED),
    ] = None,
    participant: Annotated[str, Parameter(help="who drives, for studies")] = "",
    group: Annotated[str, Parameter(help="group of the study")] = "",
    cue: Annotated[
        bool | None, Parameter(help="whether the force is felt; default the scenario's")
    ] = None,
    blinded: Annotated[
        bool | None, Parameter(help="tell nobody which group this is; default the scenario's")
    ] = None,
    script: Annotated[
        str | None, Parameter(help="drive by a scripted operator, or by a recorded FILE.jsonl")
    ] = None,
    page: Annotated[bool, Parameter(help="serve the page in the browser")] = True,
    headless: Annotated[
        bool, Parameter(negative="", help="as fast as it goes, without clock and page")
    ] = False,
    linger: Annotated[
        float | None, Parameter(help="s that the page stays after the end; default until Ctrl-C")
    ] = None,
    host: Annotated[
        str, Parameter(help="address to listen on; others than this machine's need a token")
    ] = "127.0.0.1",
    port: Annotated[int, Parameter(help="of the page; 0: any free one")] = 8080,
    token: Annotated[
        str | None, Parameter(help="that the page asks for; made up where one is needed")
    ] = None,
    instructor_token: Annotated[
        str | None,
        Parameter(
            help="that makes an instructor; made up anew for each session where it is left out"
        ),
    ] = None,
    itp_port: Annotated[
        int | None, Parameter(help="also take an ITP console on this UDP port (36000)")
    ] = None,
    console_profile: Annotated[
        str,
        Parameter(
            "--console", help="what the ITP console sends: raven, dv_trainer, a .toml file, or auto"
        ),
    ] = "raven",
    robot: Annotated[
        str | None,
        Parameter(
            help="drive one elsewhere: HOST[:ITP_PORT[:JOINT_PORT]], or ros1, ros2 for JOINT_PORT"
        ),
    ] = None,
    crtk: Crtk = None,
) -> None:
    """Train on one robot in real time, in the browser: drive, meet a hazard, respond, read the
    debrief.

    Parameters
    ----------
    scenario
        Scenario file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax.errors import UserError

    if not (page or headless or script or crtk) and itp_port is None:
        raise UserError("nobody drives: without the page give --script, --itp-port or --crtk")
    _say(f"{scenario}: the session is being prepared; the first time takes longest")
    with _words_of_a_stop(), interruption.held_back(), contextlib.ExitStack() as stack:
        helpers = None
        if not headless:
            from ravenjax.train.helpers import SessionHelpers

            helpers = SessionHelpers.start(stack, page)  # they import while this process does
        from ravenjax.train import launch
        from ravenjax.train import scenario as scenarios

        interruption.point()
        setting = scenarios.load(scenario, overrides or ())
        drawn_by = setting.seed if seed is None else seed
        options = launch.with_tokens(
            launch.SessionOptions(
                scenario=setting,
                folder=out or launch.fresh_folder(setting.name, participant, drawn_by),
                seed=drawn_by,
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
                robot=robot,
                crtk=crtk,
            )
        )
        if headless:
            result = launch.headless(options, _say)
        else:
            result = launch.realtime(
                options, with_page=page, linger_s=linger, say=_say, helpers=helpers
            )
    while result.wish is not None:  # the same door: windows come back by themselves
        _say(f"session: {result.folder} ({result.ended})")
        options = launch.following(options, result)
        _say(f"{options.scenario.name}: the next session is being prepared")
        with _words_of_a_stop(), interruption.held_back():
            result = launch.realtime(options, with_page=page, linger_s=linger, say=_say)
    _say(f"session: {result.folder} ({result.ended})")


@contextlib.contextmanager
def _words_of_a_stop() -> Iterator[None]:
    """Ctrl-C or SIGTERM before a session begins, or Ctrl-C thrice in it: nothing of it goes on
    later.
    """
    with interruption.exits(signal.SIGTERM):
        try:
            yield
        except (KeyboardInterrupt, SystemExit) as stop:
            console.err.print(
                "stopped; of a session that had begun the recording is kept", highlight=False
            )
            raise SystemExit(
                stop.code if isinstance(stop, SystemExit) else 128 + signal.SIGINT
            ) from None


def robot(
    scenario: str = "first_steps",
    *,
    overrides: Overrides = None,
    seed: Annotated[
        int | None,
        Parameter(help="that draws the hazards; default the scenario's", validator=_SEED),
    ] = None,
    host: Annotated[str, Parameter(help="address to listen on")] = "127.0.0.1",
    itp_port: Annotated[
        int, Parameter(help="UDP port of the console; 0: any free one", validator=_PORT)
    ] = 36000,
    joint_port: Annotated[
        int, Parameter(help="TCP port of the joint state; 0: any free one", validator=_PORT)
    ] = 36002,
    hazard: Annotated[
        list[str] | None, Parameter(negative="", help="NUMBER@MS: arm a hazard then")
    ] = None,
    seconds: Annotated[
        float | None, Parameter(help="end after so long; default at Ctrl-C", validator=_SECONDS)
    ] = None,
    token: Annotated[
        str | None, Parameter(help="that orders from other machines must carry")
    ] = None,
    console_host: Annotated[
        str | None, Parameter(help="the only host that may drive; default any")
    ] = None,
    console_profile: Annotated[
        str,
        Parameter(
            "--console", help="what the ITP console sends: raven, dv_trainer, a .toml file, or auto"
        ),
    ] = "raven",
    crtk: Crtk = None,
) -> None:
    """Run the control software and the virtual robot as a process that any ITP console can drive.

    Parameters
    ----------
    scenario
        Scenario whose robot and hazards it has; `ravenjax train SCENARIO --robot HOST` drives it.
    """
    from ravenjax.store.consoles import loading as profiles
    from ravenjax.train import scenario as scenarios
    from ravenjax.train.robot_link import process

    process.run(
        scenarios.load(scenario, overrides or ()),
        seed,
        host=host,
        itp_port=itp_port,
        joint_port=joint_port,
        hazards=[process.Strike.parse(text) for text in hazard or ()],
        token=token,
        console_host=console_host,
        profiles=profiles.choice(console_profile),
        seconds=seconds,
        crtk=crtk,
        say=_say,
    )


def play(
    packets: Path,
    *,
    to: Annotated[
        str, Parameter(help="HOST:PORT of the robot or the session (its --itp-port)")
    ] = "127.0.0.1:36000",
    console_profile: Annotated[
        str,
        Parameter(
            "--console", help="whose packets they are: raven, dv_trainer, a .toml file, or auto"
        ),
    ] = "auto",
) -> None:
    """Send a console's recorded packets to a robot or a session, as they were and when they came.

    Before the first one the pedal is up for 0.4 s, for a robot counts a pedal only after it was
    seen up.

    Parameters
    ----------
    packets
        A Parquet file with columns packet and arrival_us (or _s, _ms, _ns), or a capture: .pcap, .pcapng.
    """  # noqa: E501
    from ravenjax.store.motion import packet_file
    from ravenjax.train.robot_link import player

    address = player.parse(to)
    raw = packet_file.raw(packets)
    arrival_s, _, notes = packet_file.arrivals(packets, raw, console_profile)
    for note in notes:
        _say(note)
    _say(str(player.play(raw.datagrams, arrival_s, address, _say)))


@study.default
def compare(
    folders: list[Path],
    *,
    out: Annotated[Path, Parameter(help="folder of the comparison")] = Path("results/study"),
    by: Annotated[
        str | None, Parameter(help="what makes the groups: group, cue; default group, else cue")
    ] = None,
    unblind: Annotated[
        bool, Parameter(negative="", help="show the groups' names instead of A and B")
    ] = False,
    mixed: Annotated[
        bool, Parameter(negative="", help="let sessions of several scenarios or versions in")
    ] = False,
) -> None:
    """Collect sessions and compare their groups: effect sizes and intervals.

    Parameters
    ----------
    folders
        Session folders, or folders of session folders.
    """
    from ravenjax.train.study import report

    result = report.run(folders, out, by, unblind=unblind, mixed=mixed)
    _say(result.text.rstrip())
    _say(f"study: {result.page}")


@study.command
def assign(
    participants: list[str],
    *,
    groups: Annotated[list[str], Parameter(consume_multiple=True, help="names of the groups")] = [  # noqa: B006
        "on",
        "off",
    ],
    seed: int = 0,
    block: Annotated[
        int | None, Parameter(help="participants of a block; default twice the groups")
    ] = None,
) -> None:
    """Draw who belongs to which group: balanced in blocks, the same for the same seed; CSV.

    Parameters
    ----------
    participants
        Their codes, in the order in which they come.
    """
    from ravenjax.train.study import assignment

    _say(assignment.as_csv(assignment.assign(participants, groups, seed, block)).rstrip())


@study.command
def plan(
    participants: int,
    *,
    paired: Annotated[
        bool, Parameter(negative="--parallel", help="each does both conditions, or one of them")
    ] = True,
    groups: Annotated[int, Parameter(help="how many; each is compared with the first")] = 2,
    outcomes: Annotated[int, Parameter(help="compared of each; the four of `study`")] = 4,
    effect: Annotated[float | None, Parameter(help="standardised difference to be found")] = None,
    power: Annotated[float, Parameter(help="with which probability it is to be found")] = 0.8,
) -> None:
    """Before data are taken: the smallest p that so many participants can reach, after Holm too,
    and how many it takes.

    Parameters
    ----------
    participants
        How many, all together.
    """
    from ravenjax.train.study import planning

    sizes = planning.plan(
        participants, paired=paired, groups=groups, outcomes=outcomes, effect=effect, power=power
    )
    _say(planning.sentences(sizes))


@log.command
def recover(
    file: Path,
    *,
    out: Annotated[Path | None, Parameter(help="whole file; default FILE.recovered.mcap")] = None,
) -> None:
    """Make a recording that was cut short whole again, as far as it goes.

    Parameters
    ----------
    file
        session.mcap of a session that was killed.
    """
    from ravenjax.errors import UserError
    from ravenjax.store.logs import mcap_records as store

    if out is not None and out.exists() and file.exists() and out.samefile(file):
        raise UserError(
            f"--out {out}: is the recording itself, expected another file: what is damaged may be"
            " needed again"
        )
    _say(str(store.recover(file, out)))


@log.command
def bag(
    recording: Path,
    *,
    ros: Annotated[
        Literal[1, 2], Parameter(help="1: a .bag file, 2: a folder of ROS 2 (SQLite)")
    ] = 1,
    out: Annotated[
        Path | None,
        Parameter(help="the bag; default beside the recording, as NAME.bag or NAME_ros2"),
    ] = None,
) -> None:
    """Write the recording of a session, or the trace of a run, as a bag that rosbag and ros2 bag
    play.

    Parameters
    ----------
    recording
        session.mcap, the folder of a session, or the .mcap of a traced run.
    """
    from ravenjax.store.logs import bags

    _say(str(bags.write_bag(recording, ros, out)))


@log.command
def debrief(folder: Path) -> None:
    """Write the debrief of a session, also of one that was cut short: as far as its recording goes.

    Parameters
    ----------
    folder
        Folder of the session, such as results/sessions/dac_burst-20260101-120000.
    """
    from ravenjax.train.debrief import page

    _say(f"debrief: {page.write(folder)}")


def _say(text: str) -> None:
    console.out.print(text, markup=False, highlight=False, soft_wrap=True)
