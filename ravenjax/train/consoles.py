"""Connects the consoles other than the page to a session: a script, or ITP over the network."""

import math

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import STALE_MS, Command
from ravenjax.train.robot import ArmName
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.robot_link.packet_filter import TAKEN, Gate
from ravenjax.train.session import pedal, scripts
from ravenjax.train.session.advance import Session
from ravenjax.train.session.command_log import read_commands

SOME_PACKETS = 10
"""The number of packets refused within `STALE_MS`, with none accepted, that triggers a message."""
UNATTENDED_MS = 60_000
"""The tick at which the session's time begins even if a script has not driven."""


class Scripted:
    """Presents a scripted or recorded operator to the realtime loop as a console."""

    def __init__(self, script: str, session: Session) -> None:
        self._session = session
        self._operator: scripts.Follower | scripts.Recorded
        if script in scripts.REACTIONS:
            speeds = session.scenario.speeds
            self._operator = scripts.Follower(session.task, session.arms, speeds, script)
        else:
            self._operator = scripts.Recorded(read_commands(script))

    def poll(self) -> list[Command]:
        """Return the commands to carry out before this tick."""
        session = self._session
        commands = self._operator.messages(session.ticks, session.frame)
        if session.ticks == UNATTENDED_MS and session.started is None:
            commands.append({"type": "instructor", "do": "start"})
        return commands

    def tell(self, frame: Frame) -> None:
        """Do nothing: a script reads the frame in `poll`."""


class Refusals:
    """Reports when the packet filter refuses all packets of a console."""

    def __init__(self, gate: Gate) -> None:
        self._gate, self._counts = gate, dict(gate.counts)
        self._polls, self._published = 0, ""

    def poll(self) -> list[Command]:
        """Return the command "unheard" in the tick in which the filter starts or stops refusing
        all.
        """
        self._polls += 1
        if self._polls % STALE_MS:
            return []
        counts, before = dict(self._gate.counts), self._counts
        more = {cause: count - before[cause] for cause, count in counts.items()}
        self._counts = counts
        accepted, why = more.pop(TAKEN), self._published
        cause = "stranger" if more["stranger"] >= SOME_PACKETS else max(more, key=more.__getitem__)
        if cause != "stranger" and accepted:
            why = ""
        elif more[cause] >= SOME_PACKETS:
            why = pedal.packets_message(cause)
        if why == self._published:
            return []
        self._published = why
        return [{"type": "unheard", "why": why}]


class ItpConsole:
    """A console over the network: receives increments and sends forces."""

    def __init__(self, server: ItpServer, session: Session) -> None:
        self._server, self._session = server, session
        self._refusals = Refusals(server.gate)

    def poll(self) -> list[Command]:
        messages = (*self._server.poll(), *self._refusals.poll())
        return [{**message, "console": "itp"} for message in messages]

    def tell(self, frame: Frame) -> None:
        drives = self._session.arbiter.owner == "itp"
        forces = {}
        if drives and frame.number("console_alive"):
            setting, cue_on = self._session.scenario, frame.number("cue_on") != 0
            gain, cap = setting.contact.units_per_n, setting.cue.cap
            arms = self._session.arms
            forces = {arm: force_at_hand(frame, arm, gain, cap, cue_on) for arm in arms}
        self._server.send_force(
            forces,
            int(frame.number("runlevel")),
            bool(frame.number("soft_estopped")),
            pedal=drives and frame.number("pedal") != 0,
            drives=drives,
        )


def force_at_hand(
    frame: Frame, arm: ArmName, units_per_n: float, cap: float, cue: bool
) -> tuple[float, float, float]:
    """Return the force at the operator's hand in device units, frame 0.

    It is at most `cap`, or as large as the cue alone where the cue exceeds `cap`. cue: whether the
    operator feels the cue. Contact is always felt: it is the tissue's resistance.
    """
    places, numbers = frame.layout.places, frame.numbers
    first, touch = places[f"{arm}/force"].start, places[f"{arm}/contact"].start
    pull = numbers[first : first + 3] if cue else [0.0, 0.0, 0.0]
    x, y, z = (a + units_per_n * b for a, b in zip(pull, numbers[touch : touch + 3], strict=True))
    size, most = math.hypot(x, y, z), max(cap, math.hypot(*pull))
    share = most / size if size > most else 1.0
    return x * share, y * share, z * share
