"""Runs a whole training session in three processes, from the scenario to the debrief.

- realtime: this process. It reads the consoles, computes the ticks, and writes frames and events.
- page (optional): reads frames and events, serves browsers, and sends their commands.
- recorder: reads frames and events, and writes the session's folder.

The realtime process never waits for the page and the recorder. Both end with it.
"""

import contextlib
import dataclasses
import functools
import itertools
import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import numpy as np

from ravenjax import interruption
from ravenjax.errors import UserError
from ravenjax.store import manifest
from ravenjax.store.consoles import profile_choices
from ravenjax.store.files import hash_file
from ravenjax.store.logs.session import description
from ravenjax.store.ring import COMMAND_BYTES, EVENT_BYTES, Ring
from ravenjax.train import page, processes, scenario
from ravenjax.train.judge import COLUMNS
from ravenjax.train.protocol import Command, Json, Say
from ravenjax.train.realtime import clock, loop
from ravenjax.train.robot import UDP_PORT, scene
from ravenjax.train.robot_link import process as robot_process
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.robot_link.distant import DistantRobot
from ravenjax.train.robot_link.joint_stream import JOINT_PORT, RemoteRobot
from ravenjax.train.scenario import Scenario
from ravenjax.train.session import scripts
from ravenjax.train.session.advance import Session
from ravenjax.train.session.simulation import Blueprint, SimulatedRobot

FRAMES_CAPACITY, EVENTS_CAPACITY, COMMANDS_CAPACITY = 4096, 1024, 256
"""Capacities of the rings in rows: four seconds of frames, and the events of a longer time."""
COMMANDS = "commands.jsonl"
"""File with the commands of the session. Used as a script, it repeats the session."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SessionOptions(robot_process.ConsoleOptions):
    """The options with which a session starts."""

    scenario: Scenario
    folder: Path
    seed: int
    participant: str = ""
    group: str = ""
    cue: bool | None = None  # None: as the scenario sets it
    blinded: bool | None = None
    port: int = 0
    # The token of the instructor's address. None: a random token is generated.
    instructor_token: str | None = None
    # A simulated operator that drives: a reaction of `scripts`, or a file of commands.
    script: str | None = None
    # Address of a robot in another process: see `parse_address`. None: a simulated robot.
    robot: str | None = None


@dataclasses.dataclass(frozen=True)
class FinishedSession:
    """The results of a session that has ended."""

    folder: Path
    hazards: list[Json]
    timing: clock.LoopTiming | None
    ended: str
    # The instructor's command "next", which requests the next session; None: no request.
    next_command: Command | None = None
    port: int = 0  # port of the page


def run_realtime(
    options: SessionOptions,
    *,
    with_page: bool = True,
    linger_s: float | None = None,
    say: Say = print,
    helpers: processes.SessionHelpers | None = None,
) -> FinishedSession:
    """Run a session in real time, and return its results when all of its files are written.
    with_page: whether browsers can follow it. linger_s: how long the page stays open after the
    session; None: until Ctrl-C. One Ctrl-C ends both the session and the page. helpers: page and
    recorder that were started before, with the tokens of `options`; None: they are started now.
    """
    start_s = time.monotonic()
    profile_choices(options.console)  # refuses an unknown name before anything starts
    with contextlib.ExitStack() as stack:
        if helpers is None:
            listening = None
            if with_page:
                host = options.host
                token, key = page.choose_tokens(host, options.token, options.instructor_token)
                options = dataclasses.replace(options, token=token, instructor_token=key)
                listening = page.open_port(host, options.port, token, key, say)
            helpers = processes.SessionHelpers(stack, listening)
        options = _with_new_folder(options, say)
        stack.callback(_remove_if_empty, options.folder)
        helpers.show_progress("robot: compiling its tick, or reading it from the cache", say)
        connect = functools.partial(_connect, stack, options, say)
        robot = SimulatedRobot if options.robot is None else connect
        session = Session(options.scenario, options.seed, cue=options.cue, robot=robot)
        session.pedals.say = say
        interruption.check_interruption()
        say(f"robot: ready after {time.monotonic() - start_s:.1f} s")
        # An invalid script is refused before anything is recorded.
        script = None if options.script is None else scripts.Scripted(options.script, session)
        header = _header(options, session)
        frames = Ring.create(FRAMES_CAPACITY, 4 * session.layout.size)
        events = Ring.create(EVENTS_CAPACITY, EVENT_BYTES)
        commands = Ring.create(COMMANDS_CAPACITY, COMMAND_BYTES)
        for ring in (frames, events, commands):
            stack.callback(ring.close)
        helpers.recorder.send(
            (frames.name, events.name, session.layout.names(), options.folder, header)
        )
        recording = helpers.recorder.process
        browser: loop.PageCommands | None = None
        if helpers.page is not None:
            helpers.show_progress("page: loading its scene", say)
            helpers.page.send(
                page.PageOptions(
                    frames.name,
                    events.name,
                    commands.name,
                    session.arms,
                    header,
                    str(options.folder.absolute()),
                    options.host,
                    options.token,
                    options.instructor_token,
                )
            )
            helpers.page.receive_answer()
            browser = loop.PageCommands(commands, drives=options.script is None)
        elsewhere = options.robot is not None
        consoles, itp = robot_process.open_consoles(
            stack, options, session, session.blueprint, say, elsewhere
        )
        if itp is not None:
            stack.callback(lambda: say(f"console: {robot_process.format_counts(itp.counters())}"))
        consoles = [*filter(None, (browser, *consoles, script))]
        say("recorder: opening its file")
        helpers.recorder.receive_answer()
        stop = stack.enter_context(interruption.until_interrupted())
        # Act on a Ctrl-C that was held back until now.
        interruption.check_interruption()
        with clock.use_realtime_priority() as granted:
            say(f"realtime: {granted}")
            timing = loop.run_loop(
                session,
                consoles,
                lambda: bool(stop),
                (frames, events),
                lambda: processes.recorder_error(recording),
            )
        if message := processes.recorder_error(recording):
            say(message)
        recording.join(processes.STARTING_S)
        result = _conclude(options, session, timing, say)
        if browser is not None and linger_s != 0 and not stop:
            say(f"the page stays {'until Ctrl-C' if linger_s is None else f'for {linger_s:g} s'}")
            end = float("inf") if linger_s is None else time.monotonic() + linger_s
            next_command = None
            while next_command is None and not stop and time.monotonic() < end:
                time.sleep(0.05)
                # The page has checked that the scenario exists.
                requests = [each for each in browser.poll() if each.get("do") == "next"]
                next_command = requests[0] if requests else None
            result = dataclasses.replace(result, next_command=next_command, port=helpers.port)
    return result


def next_options(options: SessionOptions, last: FinishedSession) -> SessionOptions:
    """Return the options of the session that the instructor requested after `last`. What the
    request does not name stays as in `options`, the options of `last`; the seed is the scenario's.
    """
    request = last.next_command or {}
    chosen = options.scenario
    if "scenario" in request:
        chosen = scenario.load_scenario(request["scenario"])
    participant = request.get("participant", options.participant)
    seed = request.get("seed", chosen.seed)
    folder = new_folder_path(chosen.name, participant, seed, options.folder.parent)
    port = last.port or options.port
    return dataclasses.replace(
        options, scenario=chosen, participant=participant, seed=seed, folder=folder, port=port
    )


def run_headless(options: SessionOptions, say: Say = lambda _: None) -> FinishedSession:
    """Run a session as fast as possible, with a simulated operator. The same options give the same
    recording to the bit. Raises UserError without a script.
    """
    from ravenjax.train.recording import recorder

    script = options.script
    if script is None:
        raise UserError(
            "nobody drives the session: give --script with a file of commands or one of"
            f" {', '.join(scripts.REACTIONS)}"
        )
    session = Session(options.scenario, options.seed, cue=options.cue)
    # The script is read before the folder is made, so that an invalid one leaves no folder.
    driver = scripts.Scripted(script, session)
    options = _with_new_folder(options, say)
    first = 0
    header = _header(options, session)
    with recorder.open_recording(options.folder, session.layout.names(), header) as writer:
        while not session.over:
            block, events = [], []
            while len(block) < recorder.BLOCK_ROWS and not session.over:
                interruption.check_interruption()
                events += session.tick(driver.poll())
                block.append(session.frame.row.copy())
            writer.add(first, np.stack(block), events)
            first += len(block)
    return _conclude(options, session, None, say)


def new_folder_path(
    name: str, participant: str, seed: int, base: Path = Path("results/sessions")
) -> Path:
    """Return the path of a folder for a session that begins now, from scenario, participant, time
    and seed. Only the group is left out, so that the path does not reveal it.
    """
    # Other characters could leave the folder.
    safe_participant = re.sub(r"[^\w.-]", "-", participant)[:40]
    parts = (name, safe_participant, f"{datetime.now(UTC):%Y%m%d-%H%M%S}", f"seed{seed}")
    return base / "-".join(part for part in parts if part)


def _with_new_folder(options: SessionOptions, say: Say) -> SessionOptions:
    """Create the session's folder, and return the options with its path. If the folder exists, a
    number is added to the name of the new folder. Raises UserError if it cannot be created.
    """
    requested = folder = options.folder
    for number in itertools.count(2):
        try:
            folder.mkdir(parents=True)
            break
        except FileExistsError:
            folder = requested.with_name(f"{requested.name}-{number}")
        except OSError as error:
            raise UserError(
                f"{folder}: cannot be created ({error.strerror or error}); give --out a folder in"
                " which you may write"
            ) from None
    if folder != requested:
        say(f"{requested} exists already; the session is written to {folder}")
    return dataclasses.replace(options, folder=folder)


def _remove_if_empty(folder: Path):
    with contextlib.suppress(OSError):
        folder.rmdir()


def _header(options: SessionOptions, session: Session) -> Json:
    # Returns the content of session.json at the beginning of a session.
    setting = options.scenario
    network_options = {"itp": options.itp_port, "crtk": options.crtk}
    network = [name for name, value in network_options.items() if value is not None]
    consoles = ["script"] if options.script is not None else ["page", *network]
    bases = {}
    for arm in session.arms:
        origin, quaternion = scene.base_pose(arm)
        bases[arm] = {"origin": origin, "quaternion": quaternion}
    return {
        "name": options.folder.name,
        "scenario": setting.resolved(),
        "seed": options.seed,
        "participant": options.participant,
        "group": options.group,
        "cue": session.cue_on,
        "blinded": setting.cue.blinded if options.blinded is None else options.blinded,
        "cue_threshold_mm": setting.cue.threshold_mm,
        "contact_units_per_n": setting.contact.units_per_n if setting.contact.on else None,
        "versions": manifest.package_versions(),
        "code_hash": manifest.code_hash(),
        "engine": "stepper",
        "arms": list(session.arms),
        "bases": bases,
        "robot": options.robot or "virtual",
        "consoles": consoles,
        "hazards": [hazard.header() for hazard in session.hazards],
        "task": session.task.geometry(),
        "summary": {},
    }


def _connect(
    stack: contextlib.ExitStack, options: SessionOptions, say: Say, blueprint: Blueprint
) -> DistantRobot:
    # Connects to a robot in another process, which replaces the simulated robot. Its hazards must
    # be the session's. stack: closes the connection.
    host, itp_port, stream = parse_address(options.robot or "")
    say(f"robot: waiting for an answer from {host}")
    armables = scenario.armable_hazards(options.scenario, blueprint.plan.rows)
    arms, tools = blueprint.setup.arms, blueprint.setup.tools
    if not isinstance(stream, int):
        if armables:
            raise UserError(
                f"scenario {options.scenario.name!r} has {len(armables)} hazards, but a robot that"
                f" is connected over {stream} cannot inject faults: choose a scenario without"
                " hazards, or start `ravenjax robot` and write --robot HOST:ITP_PORT:JOINT_PORT"
            )
        from ravenjax.train.robot_link.crtk import bridge
        from ravenjax.train.robot_link.crtk.ros_robot import RosRobot

        transport = bridge.connect_transport(stream, *RosRobot.topics(arms, stream))
        stack.callback(transport.close)
        robot = RosRobot(host, itp_port, arms, tools, transport, say=say)
        stack.callback(robot.close)
        return DistantRobot(blueprint, robot)
    remote = RemoteRobot(host, itp_port, stream, arms, options.token)
    stack.callback(remote.close)
    greeting = remote.greeting
    if robot_process.hash_hazards(armables) != greeting.get("hazards"):
        raise UserError(
            f"the robot at {host} (scenario {greeting.get('scenario')!r}, seed"
            f" {greeting.get('seed')}) has other hazards than this session"
            f" ({options.scenario.name!r}, seed {options.seed}): start both with the same"
            " scenario, --seed and --set"
        )
    return DistantRobot(blueprint, remote)


def parse_address(text: str) -> tuple[str, int, int | Ros]:
    """Return the parts of HOST[:ITP_PORT[:JOINT_PORT]], in which ros1 or ros2 may replace the joint
    port. Missing ports get their defaults. Raises UserError if the text is invalid.
    """
    parts = re.fullmatch(r"([^:]+)(?::(\d{1,5})(?::(\d{1,5}|ros1|ros2))?)?", text)
    if parts is None:
        raise UserError(
            f"robot is {text!r}, expected HOST[:ITP_PORT[:JOINT_PORT]], such as"
            " 127.0.0.1:36000:36002. If the robot reports its state over ROS, write 'ros1' or"
            " 'ros2' instead of JOINT_PORT"
        )
    host, itp, stream = parts.groups()
    ros: Ros | None = next((name for name in get_args(Ros) if name == stream), None)
    return host, int(itp or UDP_PORT), ros or int(stream or JOINT_PORT)


def _conclude(
    options: SessionOptions, session: Session, timing: clock.LoopTiming | None, say: Say
) -> FinishedSession:
    """Write hazards.csv, commands.jsonl, the summary and the debrief, and return the results. The
    recorder must have written session.json. timing: of the loop; None: it did not run.
    """
    # The imports are here because a session must start fast.
    from ravenjax.store.logs.session import log as session_log
    from ravenjax.train.debrief import page as debrief
    from ravenjax.train.recording import reader

    shared = reader.session_columns(description.read_session(options.folder))
    rows = reader.number_hazards(session.judge.rows(**shared), session.started or 0)
    text = reader.as_csv(COLUMNS, rows)
    (options.folder / reader.TABLE).write_text(text, encoding="utf-8", newline="")
    (options.folder / COMMANDS).write_text("".join(session.command_lines), encoding="utf-8")
    summary: Json = {
        "ended": session.ended,
        "task": session.task.result(),
        "ticks": session.ticks,
        "waited_ms": session.ticks if session.started is None else session.started,
        "hazards": reader.summarize_hazards([reader.HazardRow(**row) for row in rows]),
    }
    if timing is not None:
        summary["timing"] = timing.facts()
    paths = [options.folder / name for name in (session_log.FILE, reader.TABLE, COMMANDS)]
    checksums = {path.name: hash_file(path) for path in paths if path.is_file()}
    description.update_session(options.folder, {"summary": summary, "sha256": checksums})
    say(f"debrief: {debrief.write_debrief(options.folder)}")
    return FinishedSession(options.folder, rows, timing, session.ended)
