"""Runs `ravenjax robot`: control software and virtual robot in a process that any ITP console can
drive.

A console sends packets by ITP over UDP and gets forces back. Listeners get the joint state over TCP
and send orders: arm, disarm, estop, reset. Faults act in this process, where no console sees them.
If a console falls silent, the robot's own time-out of 5 s raises the pedal, as on the real robot.

Increments that arrive within one millisecond are added up, as in the original, whose network thread
adds them up before the control loop reads. The robot gets the sum as one packet with a new number,
so that its own rules see a stream without gaps; the gate has already applied them. In addition to
the ITP console there may be a CRTK console. `session.console_arbiter` decides which one drives and
whether its pedal counts. Unlike in a session, no console here keeps the seat while its pedal is up.
"""

import contextlib
import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from ravenjax import interruption
from ravenjax.errors import UserError, format_value
from ravenjax.train import scenario
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import Command, Json, Say
from ravenjax.train.realtime.clock import Clock, no_collection, use_realtime_priority
from ravenjax.train.realtime.loop import Console
from ravenjax.train.robot import NO_PACKET_SEQUENCE, UDP_PORT, ArmName, ConsoleProfile
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.robot_link.itp import LOOPBACK, ItpServer
from ravenjax.train.robot_link.joint_stream import JOINT_PORT, JointServer, encode_report
from ravenjax.train.robot_link.packet_filter import (
    Increments,
    increments_of,
    merge_commands,
    packet_of,
)
from ravenjax.train.scenario import Armable, Scenario
from ravenjax.train.session.console_arbiter import ConsoleArbiter
from ravenjax.train.session.pedal import NETWORK, PedalReasons
from ravenjax.train.session.simulation import PacketRobot
from ravenjax.vocabulary import checks

ITP, CRTK = "itp", "crtk"
"""Names of the consoles that a robot may have."""
CHECKS_EVERY = 100
"""The smallest number of ticks between two readings of the robot's checks."""


class Station:
    """One robot with its ports: call `tick` once a millisecond, and `obey` for orders."""

    def __init__(
        self,
        machine: PacketRobot,
        itp: ItpServer,
        joints: JointServer,
        hazards: int,
        estop_row: int,
        crtk: Console | None = None,
        say: Say = lambda _: None,
    ) -> None:
        """hazards: number of rows that may be armed. crtk: an additional console.

        say: prints for the user why a pedal does not count.
        """
        self.machine, self.itp, self.joints, self.crtk = machine, itp, joints, crtk
        self.ticks = 0
        self._hazards, self._estop_row = hazards, estop_row
        self._number = 0  # number of the robot's newest packet
        self._arbiter, self._pedals = ConsoleArbiter(), PedalReasons(say)
        self._checks: dict[str, tuple[int, int]] = {}  # as in the joint reports
        # The checks' trips at the last reading, and its tick.
        self._trips, self._looked = 0.0, 0
        self._last_seq = NO_PACKET_SEQUENCE  # of the console's packet taken last

    def tick(self) -> Frame:
        """Advance by one tick: obey orders, take increments, step the robot, publish its report."""
        for order in self.joints.poll():
            try:
                self.obey(order.content)
            except UserError as error:
                self.joints.answer(order, str(error))
            else:
                self.joints.answer(order)
        command = self._choose()
        packet = None
        if command is not None:
            self._number += 1
            packet = packet_of(command, self.machine.arms, self._number)
        frame = self.machine.tick(packet)
        was_taken = frame.number("last_seq") == float(np.float32(self._number))
        if command is not None and was_taken and command["console"] == ITP:
            self._last_seq = self.itp.last_sequence
        self._look(frame)
        self.joints.publish(encode_report(frame, self.ticks, self._last_seq, self._checks))
        drives = self._arbiter.owner != CRTK
        forces = {arm: frame[f"{arm}/force"].tolist() for arm in self.machine.arms}
        runlevel, stopped = int(frame.number("runlevel")), bool(frame.number("soft_estopped"))
        self.itp.send_force(forces, runlevel, stopped, drives, drives)
        if self.crtk is not None:
            self.crtk.tell(frame)
        self.ticks += 1
        return frame

    def _choose(self) -> Increments | None:
        commands = [{**command, "console": ITP} for command in self.itp.poll()]
        if self.crtk is not None:
            commands += self._poll_crtk(self.crtk)
        chosen: Increments | None = None
        if self._arbiter.vacate(self.ticks) == CRTK:
            # The CRTK process is gone, so its pedal counts as up.
            still = dict.fromkeys(self.machine.arms, ((0, 0, 0), (0.0, 0.0, 0.0, 1.0), 0))
            chosen = {**increments_of(False, still, CRTK), "console": CRTK}

        def take(counted: Command) -> bool:
            nonlocal chosen
            if chosen is None or counted["pedal"]:
                chosen = dict(counted)
            return True

        for command in commands:
            self._arbiter.hear(command, take, self.ticks)
        self._pedals.look({name: self._arbiter.why_not(name, self.ticks) for name in NETWORK})
        return chosen

    def _poll_crtk(self, console: Console) -> list[Increments]:
        requests: list[Increments] = []
        for command in console.poll():
            if command["type"] == "unheard":
                self._pedals.once(CRTK, command["why"])
            elif command["type"] == "operator":
                self.obey({"order": {"estop": "estop", "restart": "reset"}[command["do"]]})
            else:
                requests.append({**command, "console": CRTK})
        total = merge_commands(requests)
        return [] if total is None else [total]

    def _look(self, frame: Frame) -> None:
        """Update how often each check of the robot has tripped so far, and when it first did."""
        trips = frame.number("trips")
        if trips == self._trips or self.ticks - self._looked < CHECKS_EVERY:
            return
        self._trips, self._looked = trips, self.ticks
        outcomes, began = self.machine.outcomes(), self.ticks - int(frame.number("tick"))
        self._checks = {
            name: (count, began + int(outcomes[f"check_{name}_first_ms"]))
            for name in checks.check_names(outcomes)
            if (count := int(outcomes[f"check_{name}_count"])) > 0
        }

    def obey(self, content: Json) -> None:
        """Carry out an order of `joint_stream`. Raises UserError if that is not possible."""
        kind, number = content.get("order"), content.get("number")
        if kind == "arm":
            if type(number) is not int or not 0 <= number < self._hazards:
                expected = f"a hazard's number 0..{self._hazards - 1}"
                if not self._hazards:
                    expected = "no hazard: the scenario has none"
                raise UserError(f"number is {format_value(number)}, expected {expected}")
            self.machine.arm(number)
        elif kind == "disarm":
            self.machine.disarm()
        elif kind == "estop":
            self.machine.press(self._estop_row)
            self._arbiter.rearm("", self.ticks)
        elif kind == "reset":
            self.machine.reset()
            self._number = 0
            self._arbiter.rearm("restart", self.ticks)
            self._trips, self._checks = 0.0, {}
        else:
            raise UserError(
                f"order is {format_value(kind)}, expected one of arm, disarm, estop, reset"
            )


def run_robot(
    chosen: Scenario,
    seed: int | None = None,
    *,
    host: str = LOOPBACK,
    itp_port: int = UDP_PORT,
    joint_port: int = JOINT_PORT,
    token: str | None = None,
    console_host: str | None = None,
    profiles: Sequence[ConsoleProfile] = (),
    crtk: Ros | None = None,
    say: Say = print,
) -> None:
    """Run the robot of a scenario until Ctrl-C or SIGTERM.

    seed: draws the scenario's hazards; None: its own. token: required in orders from other
    machines; None: they are refused. console_host: the only host that may drive. profiles: of the
    console, or several of which one applies. Raises UserError if a port cannot be opened.
    """
    number = chosen.seed if seed is None else seed
    robot = PacketRobot(scenario.session_campaign(chosen, number))
    armables = scenario.armable_hazards(chosen, robot.blueprint.plan.rows)
    greeting = {
        "robot": "ravenjax",
        "arms": list(robot.arms),
        "scenario": chosen.name,
        "seed": number,
        "hazards": hash_hazards(armables),
    }
    with contextlib.ExitStack() as stack:
        itp = open_console_port(
            stack, robot.arms, host, itp_port, profiles, console_host, token, say
        )
        joints = JointServer(greeting, host, joint_port, token)
        stack.callback(joints.close)
        beside = None
        if crtk:
            from ravenjax.train.robot_link.crtk import bridge

            beside = bridge.spawn_bridge(stack, crtk, robot.blueprint, say)
        estop_row = robot.blueprint.plan.runs - 1
        station = Station(robot, itp, joints, len(armables), estop_row, beside, say)
        stop = stack.enter_context(interruption.until_interrupted())
        for armable in armables:
            say(f"hazard {armable.number}: {armable.title} ({armable.hazard})")
        say("joint state: TCP {}:{}".format(*joints.address))
        with use_realtime_priority(min) as granted, no_collection():
            say(f"realtime: {granted}")
            clock = Clock()
            while not stop:
                clock.wait()
                station.tick()
                clock.done()
        timing = clock.timing
        counts = {"console": itp.counters(), "joint stream": joints.counts}
    p50, p99 = (timing.percentile("compute", share) for share in (0.5, 0.99))
    say(
        f"loop: {timing.ticks} ticks, {timing.late} late, {timing.skipped} ms skipped; compute p50"
        f" {p50:g} us, p99 {p99:g} us"
    )
    for name, numbers in counts.items():
        say(f"{name}: {in_words(numbers) or 'nothing'}")


def in_words(counts: Mapping[str, int]) -> str:
    """Return the counts for the terminal, without zeros."""
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def open_console_port(
    stack: contextlib.ExitStack,
    arms: Sequence[ArmName],
    host: str,
    port: int,
    profiles: Sequence[ConsoleProfile],
    only_host: str | None,
    token: str | None,
    say: Say,
) -> ItpServer:
    """Open a port for consoles until `stack` ends, and say who can reach it. Raises UserError."""
    server = ItpServer(arms, host, port, profiles=profiles, only_host=only_host, say=say)
    stack.callback(server.close)
    if host != "localhost" and not host.startswith("127."):
        if not only_host:
            say(
                f"any machine that reaches {host} can drive this robot; --console-host ADDRESS"
                " allows one only"
            )
        if not token:
            say("orders from other machines are refused; --token TOKEN allows them")
    say("console: ITP over UDP {}:{}".format(*server.address))
    return server


def hash_hazards(hazards: Sequence[Armable]) -> str:
    """Return a hash of a list of hazards. Lists with the same hash number their hazards equally."""
    return hashlib.sha256(" ".join(hazard.run_id for hazard in hazards).encode()).hexdigest()[:16]
