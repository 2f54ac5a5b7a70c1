"""`ravenjax robot`: control software and virtual robot as a process of their own, which any ITP
console can drive.

    console  -- ITP, UDP --> gate --> one packet a tick --> control software, virtual robot
             <-- force ----                                      |
    listeners <-- joint state, TCP -------------------------------
              --- orders -->  arm, disarm, estop, reset

Faults strike in here, where no console sees them. A console that falls silent is the robot's to
notice: its own time-out (5 s) lifts the pedal, as on the real one.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from ravenjax import interruption
from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.console.packet import UDP_PORT
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.train import scenario
from ravenjax.train.realtime.clock import Clock, LoopTiming, no_collection, realtime
from ravenjax.train.robot_link.crtk import console
from ravenjax.train.robot_link.crtk.console import CrtkConsole
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.robot_link.crtk.names import ARM_NAMES
from ravenjax.train.robot_link.itp import LOOPBACK, ItpServer
from ravenjax.train.robot_link.joints.stream import JOINT_PORT, JointServer
from ravenjax.train.robot_link.packet_filter import PacketLimits
from ravenjax.train.robot_link.station import Station
from ravenjax.train.scenario import Armable, Scenario
from ravenjax.train.session.simulation import PacketRobot


@dataclasses.dataclass
class Counters:
    """What a process did."""

    timing: LoopTiming
    itp: dict[str, int]
    joints: dict[str, int]

    def lines(self) -> list[str]:
        """For the terminal, without what did not happen."""
        timing = self.timing
        loop = (
            f"{timing.ticks} ticks, {timing.late} late, {timing.skipped} ms skipped; compute p50"
            f" {timing.percentile('compute', 0.5):g} us, p99"
            f" {timing.percentile('compute', 0.99):g} us"
        )
        return [
            f"loop: {loop}",
            *(
                f"{name}: {', '.join(f'{key} {n}' for key, n in counts.items() if n) or 'nothing'}"
                for name, counts in (("console", self.itp), ("joint stream", self.joints))
            ),
        ]


@dataclasses.dataclass(frozen=True)
class Strike:
    """A hazard that the process arms by itself."""

    number: int  # of the session's list
    at_ms: int  # since the process began

    @staticmethod
    def parse(text: str) -> Strike:
        """NUMBER@MS. UserError."""
        number, _, at = text.partition("@")
        try:
            strike = Strike(int(number), int(at))
        except ValueError:
            strike = Strike(-1, -1)
        if strike.number < 0 or strike.at_ms < 0:
            raise UserError(
                f"hazard is {shown(text)}, expected NUMBER@MS, such as 0@5000: hazard 0 after 5 s"
            )
        return strike


def run(
    chosen: Scenario,
    seed: int | None = None,
    *,
    host: str = LOOPBACK,
    itp_port: int = UDP_PORT,
    joint_port: int = JOINT_PORT,
    hazards: Sequence[Strike] = (),
    token: str | None = None,
    console_host: str | None = None,
    profiles: Sequence[ConsoleProfile] = (),
    seconds: float | None = None,
    crtk: Ros | None = None,
    say: Callable[[str], None] = print,
) -> Counters:
    """Run the robot of a scenario until Ctrl-C, SIGTERM, or for so many seconds.

    seed: draws the scenario's hazards; its own if None. host: address to listen on, loopback unless
    told otherwise. token: what orders from other machines must carry; None: they are refused.
    console_host: the only host that may drive. profiles: that of the console, or several of which
    it has one. crtk: also speak CRTK over this ROS. UserError where a port cannot be had or a
    hazard is not there.
    """
    number = chosen.seed if seed is None else seed
    robot = PacketRobot(scenario.campaign(chosen, number))
    armables = scenario.armable(chosen, robot.blueprint.plan.rows)
    for strike in hazards:
        if strike.number >= len(armables):
            choice = f"it has 0..{len(armables) - 1}" if armables else "it has none"
            raise UserError(f"hazard {strike.number} is not in scenario {chosen.name!r}: {choice}")
    greeting = {
        "robot": "ravenjax",
        "arms": list(robot.arms),
        "scenario": chosen.name,
        "seed": number,
        "hazards": digest(armables),
    }
    with contextlib.ExitStack() as stack:
        itp = ItpServer(
            robot.arms, host, itp_port, PacketLimits(console=console_host), profiles=profiles
        )
        stack.callback(itp.close)
        joints = JointServer(greeting, host, joint_port, token)
        stack.callback(joints.close)
        beside = _speaks(stack, crtk, robot, say) if crtk else None
        station = Station(robot, itp, joints, len(armables), robot.blueprint.plan.runs - 1, beside)
        stop = stack.enter_context(interruption.until_interrupted())
        for one in armables:
            say(f"hazard {one.number}: {one.title} ({one.hazard})")
        lasting = {one.number: one.lasts_ms for one in armables}
        with realtime(min) as granted:
            # Locking the memory can take seconds: the ports are told after it, and who reads them
            # is served at once.
            say(f"realtime: {granted}")
            for warning in exposed(host, token, console_host):
                say(warning)
            say("console: ITP over UDP {}:{}".format(*itp.address))
            say("joint state: TCP {}:{}".format(*joints.address))
            if crtk:
                say(f"CRTK: {crtk}, {', '.join(ARM_NAMES[arm] for arm in robot.arms)}")
            timing = serve(station, due(hazards, lasting), seconds, lambda: bool(stop), say)
        counters = Counters(timing, itp.counters(), joints.counts)
    for line in counters.lines():
        say(line)
    return counters


def _speaks(
    stack: contextlib.ExitStack, ros: Ros, robot: PacketRobot, say: Callable[[str], None]
) -> CrtkConsole:
    """The process that speaks CRTK for this robot."""
    return console.spawn(stack, ros, robot.blueprint.layout, console.traits(robot.blueprint), say)


def serve(
    station: Station,
    orders: Sequence[tuple[int, dict[str, Any]]] = (),
    seconds: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = print,
) -> LoopTiming:
    """Tick `station` against the clock. orders: (tick, order), in the order of their ticks."""
    waiting = list(orders)
    end = float("inf") if seconds is None else seconds * 1000.0
    with no_collection():
        clock = Clock()
        while station.ticks < end and not stopped():
            clock.wait()
            while waiting and waiting[0][0] <= station.ticks:
                content = waiting.pop(0)[1]
                if (
                    content.get("order") != "disarm" or station.armed == content["number"]
                ):  # another may be at work by now
                    station.obey(content)
            station.tick()
            for line in station.news():
                say(line)
            clock.done()
    return clock.timing


def due(strikes: Sequence[Strike], lasting: dict[int, int]) -> list[tuple[int, dict[str, Any]]]:
    """The orders of these strikes: each hazard is armed, and disarmed after as many ms as it is
    left at work.
    """
    orders = []
    for strike in strikes:
        orders.append((strike.at_ms, {"order": "arm", "number": strike.number}))
        orders.append(
            (strike.at_ms + lasting[strike.number], {"order": "disarm", "number": strike.number})
        )
    return sorted(orders, key=lambda order: order[0])


def exposed(host: str, token: str | None, console: str | None) -> list[str]:
    """What the user should know who listens on more than this machine."""
    if host == "localhost" or host.startswith("127."):
        return []
    words = (
        []
        if console
        else [
            f"whoever reaches {host} can drive this robot; --console-host ADDRESS lets one in only"
        ]
    )
    return (
        words
        if token
        else [*words, "orders from other machines are refused; --token TOKEN allows them"]
    )


def digest(hazards: Sequence[Armable]) -> str:
    """Of a session's list of hazards: alike where scenario, seed and version are, so that
    numbers mean the same.
    """
    return hashlib.sha256(" ".join(one.run_id for one in hazards).encode()).hexdigest()[:16]
