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
import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax import interruption
from ravenjax.errors import UserError, shown
from ravenjax.train import scenario
from ravenjax.train.realtime.clock import Clock, LoopTiming, no_collection, realtime
from ravenjax.train.robot import UDP_PORT, ConsoleProfile
from ravenjax.train.robot_link.crtk.messages import ARM_NAMES, Ros
from ravenjax.train.robot_link.itp import LOOPBACK, ItpServer
from ravenjax.train.robot_link.joint_server import JOINT_PORT, JointServer
from ravenjax.train.robot_link.packet_filter import PacketLimits
from ravenjax.train.robot_link.station import Station
from ravenjax.train.scenario import Armable, Scenario
from ravenjax.train.session.simulation import PacketRobot


class Strike(NamedTuple):
    """A hazard that the process arms by itself."""

    number: int  # of the session's list
    at_ms: int  # since the process began

    @staticmethod
    def parse(text: str) -> Strike:
        """NUMBER@MS. UserError."""
        parts = text.split("@")
        if len(parts) != 2 or not all(part.isdecimal() for part in parts):
            raise UserError(
                f"hazard is {shown(text)}, expected NUMBER@MS, such as 0@5000: hazard 0 after 5 s"
            )
        return Strike(int(parts[0]), int(parts[1]))


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
) -> None:
    """Run the robot of a scenario until Ctrl-C, SIGTERM, or for so many seconds.

    seed: draws the scenario's hazards; its own if None. host: address to listen on. token: what
    orders from other machines must carry; None: they are refused. console_host: the only host that
    may drive. profiles: that of the console, or several of which it has one. crtk: also speak CRTK
    over this ROS. UserError where a port cannot be had or a hazard is not there.
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
        limits = PacketLimits(console=console_host)
        itp = ItpServer(robot.arms, host, itp_port, limits, profiles=profiles)
        stack.callback(itp.close)
        joints = JointServer(greeting, host, joint_port, token)
        stack.callback(joints.close)
        beside = None
        if crtk:
            from ravenjax.train.robot_link.crtk import bridge

            beside = bridge.spawn(stack, crtk, robot.blueprint, say)
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
        counts = {"console": itp.counters(), "joint stream": joints.counts}
    p50, p99 = (timing.percentile("compute", share) for share in (0.5, 0.99))
    say(
        f"loop: {timing.ticks} ticks, {timing.late} late, {timing.skipped} ms skipped; compute p50"
        f" {p50:g} us, p99 {p99:g} us"
    )
    for name, numbers in counts.items():
        say(f"{name}: {in_words(numbers) or 'nothing'}")


def in_words(counts: Mapping[str, int]) -> str:
    """For the terminal, without what did not happen."""
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


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
                # Another hazard may be at work by now.
                if content["order"] != "disarm" or station.armed == content["number"]:
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
    for number, at_ms in strikes:
        orders.append((at_ms, {"order": "arm", "number": number}))
        orders.append((at_ms + lasting[number], {"order": "disarm", "number": number}))
    return sorted(orders, key=lambda order: order[0])


def exposed(host: str, token: str | None, console: str | None) -> list[str]:
    """What the user should know who listens on more than this machine."""
    if host == "localhost" or host.startswith("127."):
        return []
    warnings = []
    if not console:
        warnings.append(
            f"whoever reaches {host} can drive this robot; --console-host ADDRESS lets one in only"
        )
    if not token:
        warnings.append("orders from other machines are refused; --token TOKEN allows them")
    return warnings


def digest(hazards: Sequence[Armable]) -> str:
    """Of a session's list of hazards: alike where scenario, seed and version are, so that
    numbers mean the same.
    """
    return hashlib.sha256(" ".join(one.run_id for one in hazards).encode()).hexdigest()[:16]
