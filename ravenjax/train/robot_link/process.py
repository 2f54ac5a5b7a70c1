"""Runs `ravenjax robot`: a simulated robot with its control software, driven over a network.

Consoles send packets to this process. Faults act after a packet has arrived, so a console cannot
detect them in the packets that it sends. If a console sends nothing for 5 s, the robot treats the
pedal as up, as the real robot does. Increments that arrive within one millisecond are added up, as
in raven2's network thread. The robot gets the sum as one packet with a new sequence number. Only
the foot pedals decide which of several consoles drives the robot.
"""

import contextlib
import dataclasses
import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from ravenjax import interruption
from ravenjax.errors import format_value
from ravenjax.store.consoles import profile_choices
from ravenjax.train import scenario
from ravenjax.train.page import is_loopback
from ravenjax.train.protocol import Command, Event, Frame, Say
from ravenjax.train.realtime import clock, loop
from ravenjax.train.robot import NO_PACKET_SEQUENCE
from ravenjax.train.robot_link import WORDS, itp, joint_stream
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.robot_link.itp import LOOPBACK, Gate, ItpConsole, ItpServer
from ravenjax.train.robot_link.joint_stream import JointServer, TrippedChecks
from ravenjax.train.session import console_arbiter
from ravenjax.train.session.console_arbiter import NETWORK, NOBODY, console_of
from ravenjax.train.session.simulation import Blueprint, PacketRobot
from ravenjax.vocabulary import checks

CHECKS_EVERY = 100  # The smallest number of ticks between two readings of the robot's checks
ORDERS: dict[str, Command] = WORDS["orders"]  # Command of a session for each order of a listener


class PacketSession:
    """A session without task and judge: consoles drive a simulated robot until "end"."""

    ticks, over = 0, False
    accepted_console = ""
    """The console whose packet the robot accepted in this tick; "" if none."""
    _number = 0  # number of the robot's newest packet
    _trips_read, _reading_tick = 0.0, 0  # The checks' trips at the last reading, and its tick

    def __init__(self, chosen: scenario.Scenario, robot: PacketRobot, say: Say = lambda _: None):
        """say: prints for the user why a pedal does not count."""
        self.scenario, self.robot, self.frame, self.arms = chosen, robot, robot.frame, robot.arms
        self.arbiter = console_arbiter.ConsoleArbiter(by_pedals=True)
        self.pedals = console_arbiter.PedalReasons(say)
        self.checks: TrippedChecks = {}

    def move(self, commands: list[Command]) -> None:
        """Compute the first half of the tick: orders, consoles and the robot. Fill `frame`."""
        # The messages with increments that the arbiter admits.
        hands = []

        def admit(message: Command) -> bool:
            hands.append(message)
            return True

        owner = self.arbiter.owner
        if self.arbiter.step(self.ticks) and owner == "crtk":
            # The CRTK process has ended, so its pedal counts as up.
            still = dict.fromkeys(self.arms, itp.STILL)
            hands.append({"console": owner, "pedal": False, "arms": still})
        for command in commands:
            console = console_of(command)
            match command["type"]:
                case "increments":
                    self.arbiter.receive(command, admit, self.ticks)
                # A console's server or process reports why it refuses the console's messages.
                case "unheard" if command.get("once"):
                    self.pedals.report(console, command["why"])
                case "unheard":
                    self.arbiter.set_refusal(console, command["why"])
                case _:
                    self._obey(command)
        # Without an owner, the pedal is up, and the first console moves the hands.
        driver = self.arbiter.owner
        if driver == NOBODY and hands:
            driver = hands[0]["console"]
        packet = None
        total = itp.merge_commands([hand for hand in hands if hand["console"] == driver])
        if total is not None:
            self._number += 1
            packet = itp.packet_of(total, self.arms, self._number)
        frame = self.robot.tick(packet)
        # A frame has numbers in float32.
        is_accepted = frame.number("last_seq") == float(np.float32(self._number))
        self.accepted_console = driver if total is not None and is_accepted else ""
        frame["cue_on"], frame["pedal"] = self.scenario.cue.on, self.arbiter.pedal_down
        frame["console_alive"] = self.arbiter.owner != NOBODY

    def conclude(self) -> list[Event]:
        """Compute the second half of the tick: print why pedals do not count, and read the trips of
        the checks. Return no events, because nothing records them here.
        """
        reasons = {name: self.arbiter.refusal_reason(name, self.ticks) for name in NETWORK}
        self.pedals.update(reasons)
        frame, trips = self.frame, self.frame.number("trips")
        if trips != self._trips_read and self.ticks - self._reading_tick >= CHECKS_EVERY:
            self._trips_read, self._reading_tick = trips, self.ticks
            outcomes, self.checks = self.robot.outcomes(), {}
            # The tick of the session at which the robot was last restarted.
            start_tick = self.ticks - int(frame.number("tick"))
            for name in checks.check_names(outcomes):
                count = int(outcomes[f"check_{name}_count"])
                if count > 0:
                    first_tick = start_tick + int(outcomes[f"check_{name}_first_ms"])
                    self.checks[name] = count, first_tick
        self.ticks += 1
        return []

    def _obey(self, command: Command):
        # Carries out a listener's order, or the command "end".
        match command["do"]:
            case "arm":
                self.robot.arm(command["hazard"])
            case "disarm":
                self.robot.disarm()
            case "estop":
                # The E-stop button is the last row of the fault table.
                self.robot.press_estop(self.robot.blueprint.plan.runs - 1)
                self.arbiter.require_lifts("")
            case "restart":
                self.robot.reset()
                self._number, self._trips_read, self.checks = 0, 0.0, {}
                self.arbiter.require_lifts("restart")
            case "end":
                self.over = True


@dataclasses.dataclass
class JointConsole:
    """A console of the loop for the listeners of the joint stream: their orders and reports."""

    server: JointServer
    itp_server: ItpServer
    session: PacketSession
    hazards: int
    """Number of hazards that can be armed."""
    last_seq: int = NO_PACKET_SEQUENCE  # Number of the last accepted packet over ITP

    def poll(self) -> list[Command]:
        # Returns the commands of the valid orders that arrived. Answers each order.
        commands = []
        for listener, content in self.server.poll():
            kind, number = content.get("order"), content.get("number")
            error = None
            if not isinstance(kind, str) or kind not in ORDERS:
                error = f"order is {format_value(kind)}, expected one of {', '.join(ORDERS)}"
            # `type` excludes True and False, which are instances of int.
            elif kind == "arm" and (type(number) is not int or not 0 <= number < self.hazards):
                expected = f"one of the scenario's {self.hazards} hazards, from 0"
                error = f"number is {format_value(number)}, expected {expected}"
            else:
                commands.append(ORDERS[kind] | {"hazard": number})
            self.server.answer((listener, content), error)
        return commands

    def send_frame(self, frame: Frame) -> None:
        # Sends a report on this tick to all listeners. It names the last packet over ITP that the
        # robot accepted, even if the robot has accepted another console's packets since.
        session = self.session
        if session.accepted_console == "itp":
            self.last_seq = self.itp_server.last_sequence
        ticks, checks = session.ticks, session.checks
        self.server.publish(joint_stream.encode_report(frame, ticks, self.last_seq, checks))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConsoleOptions:
    """The options for network consoles."""

    host: str = LOOPBACK
    token: str | None = None
    itp_port: int | None = None  # None: no console over ITP
    console: str = "raven"  # The console's profile: a name or file of `store.consoles`, or "auto"
    console_host: str | None = None  # the only host that may drive over ITP; None: any
    crtk: Ros | None = None  # the ROS over which consoles use CRTK; None: no CRTK


def run_robot(
    chosen: scenario.Scenario, options: ConsoleOptions, seed: int | None, joint_port: int, say: Say
) -> None:
    """Run the robot of a scenario until Ctrl-C or SIGTERM. options: orders from other machines need
    `options.token`; if it is None, they are refused. seed: for the draw of hazards; None: the
    scenario's. Raises UserError if a port cannot be opened.
    """
    used_seed = chosen.seed if seed is None else seed
    robot = PacketRobot(scenario.session_campaign(chosen, used_seed))
    session = PacketSession(chosen, robot, say)
    armables = scenario.armable_hazards(chosen, robot.blueprint.plan.rows)
    greeting = {
        "robot": "ravenjax",
        "arms": list(robot.arms),
        "scenario": chosen.name,
        "seed": used_seed,
        "hazards": hash_hazards(armables),
    }
    with contextlib.ExitStack() as stack:
        consoles, itp_server = open_consoles(stack, options, session, robot.blueprint, say)
        joints = JointServer(greeting, options.host, joint_port, options.token)
        stack.callback(joints.close)
        assert itp_server is not None
        # Orders of listeners come before the commands of consoles in a tick.
        consoles.insert(0, JointConsole(joints, itp_server, session, len(armables)))
        stop = stack.enter_context(interruption.until_interrupted())
        for armable in armables:
            say(f"hazard {armable.number}: {armable.title} ({armable.hazard})")
        say("joint state: TCP {}:{}".format(*joints.address))
        # A session on this machine uses the CPU with the largest number.
        with clock.use_realtime_priority(choose_cpu=min) as granted:
            say(f"realtime: {granted}")
            timing = loop.run_loop(session, consoles, lambda: bool(stop))
    say(
        "loop: {ticks} ticks, {late_ticks} late, {skipped_ms} ms skipped; compute p50"
        " {compute_p50_us:g} us, p99 {compute_p99_us:g} us".format(**timing.facts())
    )
    for name, counts in (("console", itp_server.counters()), ("joint stream", joints.counts)):
        say(f"{name}: {format_counts(counts)}")


def format_counts(counts: Mapping[str, int]) -> str:
    """Return the counts as text for the terminal, without zeros."""
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count) or "nothing"


def open_consoles(
    stack: contextlib.ExitStack,
    options: ConsoleOptions,
    session: loop.TickedSession,
    blueprint: Blueprint,
    say: Say,
    elsewhere: bool = False,
) -> tuple[list[loop.Console], ItpServer | None]:
    """Open the ports of network consoles until `stack` ends, and print who can reach them. Return
    the consoles, and the server of the consoles over ITP (None without `options.itp_port`).
    elsewhere: another process has the robot. Raises UserError if a port cannot be opened.
    """
    consoles: list[loop.Console] = []
    server = None
    host = options.host
    if options.itp_port is not None:
        gate = Gate(session.arms, profile_choices(options.console), options.console_host, say)
        server = ItpServer(gate, host, options.itp_port)
        stack.callback(server.close)
        if not is_loopback(host):
            if not options.console_host:
                say(
                    f"any machine that reaches {host} can drive this robot; --console-host ADDRESS"
                    " allows one only"
                )
            if not options.token:
                say("orders from other machines are refused; --token TOKEN allows them")
        say("console: ITP over UDP {}:{}".format(*server.address))
        consoles.append(ItpConsole(server, session))
    if options.crtk is not None:
        from ravenjax.train.robot_link.crtk import bridge

        say(f"CRTK: its process for {options.crtk} is being started")
        consoles.append(bridge.spawn_bridge(stack, options.crtk, blueprint, say, elsewhere))
    return consoles, server


def hash_hazards(hazards: Sequence[scenario.Armable]) -> str:
    """Return a hash of a list of hazards. Equal hashes mean the same hazards in the same order."""
    return hashlib.sha256(" ".join(hazard.run_id for hazard in hazards).encode()).hexdigest()[:16]
