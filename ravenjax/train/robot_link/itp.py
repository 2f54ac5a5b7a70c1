"""The ITP server: receives a console's increments over UDP and sends the cue's force.

The realtime loop polls the server once a tick. The server never waits.
docs/how-to/training-messages.md describes the force packets.
"""

import contextlib
import math
import operator
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ravenjax.numbers.vec import Vec
from ravenjax.store import consoles
from ravenjax.train import robot
from ravenjax.train.protocol import STALE_MS, Command, Frame, Json, Say
from ravenjax.train.realtime.loop import TickedSession
from ravenjax.train.robot import ARMS, FIELDS, ArmName, Arms, ConsoleProfile, Misfit, Packet
from ravenjax.train.robot_link import WORDS, refuse_errors
from ravenjax.train.session.console_arbiter import packets_message
from ravenjax.vocabulary.packets import QUIET_MS, RELEASE_MS

SIZE = FIELDS.size
PEDAL, ALIVE, SOFT_ESTOPPED, DRIVES = 1 << 2, 1 << 3, 1 << 4, 1 << 5
"""Bits of jointflags. Bits 0 and 1: the arm is present; bits 8 and 9: its cue pulls."""
_MAX_NUMBER = 2**32 - 1  # largest packet number
TAKEN = "accepted"
CAUSES = tuple(WORDS["causes"])
"""Possible results of the checks of a datagram. Each datagram has exactly one result."""
Increments = Json
"""A command "increments": the pedal, and for each arm, in the ITP frame, `delta_um`, `quat` (x, y,
z, w) and `grasp_mrad` (positive closes).
"""
STILL: Json = {"delta_um": [0, 0, 0], "quat": [0.0, 0.0, 0.0, 1.0], "grasp_mrad": 0}
"""The increment of an arm that does not move."""

CONTINUING = (TAKEN, "restart", "skip")
"""Results of the check of a packet's number that do not interrupt the stream."""
KEPT_MISFITS, MISFIT_SHARE = 32, 0.02
"""Number of packets that do not fit the profile after which the gate names a profile that fits. If
none fits, the gate reports this, provided that such packets are at least this share of all. The
same limits apply to the report of dropped packets.
"""


class Gate:
    """Checks each datagram of a console before its content moves the robot. The checks are, in this
    order: size, sender, content by the console's profile, sequence number. Each refusal is counted
    under its cause. raven2 itself checks no content; its rules for the number are those of
    `raven2.stages.network`. Two rules here are stricter, so that nobody can replay a stream: a
    lower number counts as a restart only if it is 1 and the console was quiet for `QUIET_MS`, and a
    packet more than `robot.RESET_GAP` ahead is dropped. After `RELEASE_MS` of silence any stream
    may begin. ITP has no secret, so a recorded stream looks like a console: in a shared network,
    listen on loopback or set the console's address (`only_host`).
    """

    _misfit_count, _misfits_reported = 0, False
    _drops_reported = False  # whether dropped packets were reported
    _peer: tuple | None = None
    _last_number = 0  # Number of the last packet; 0: none yet
    _last_packet_ms = -math.inf  # when the last packet was accepted or skipped to

    def __init__(
        self,
        arms: Arms,
        profiles: Sequence[ConsoleProfile] = (),
        only_host: str | None = None,
        say: Say = lambda _: None,
    ):
        """arms: the arms whose fields are read; fields of other arms may have any value. profiles:
        of the console, or several of which one fits; empty: raven2's own. only_host: the only
        address that may send; None: any. say: prints which profile was found or would fit.
        """
        self._only_host, self._say = only_host, say
        self.counts: dict[str, int] = dict.fromkeys(CAUSES, 0)
        self.arms = arms
        self._choice = robot.ProfileChoice(profiles or (consoles.load_profile("raven"),), arms)
        self._misfits: deque[Sequence] = deque(maxlen=KEPT_MISFITS)

    @property
    def received(self) -> int:
        return sum(self.counts.values())

    def peer(self, now_ms: float) -> tuple | None:
        """Return the address of the console that sends; None after `RELEASE_MS` of silence."""
        if self._peer is not None and now_ms - self._last_packet_ms > RELEASE_MS:
            self._peer, self._last_number = None, 0
            self._choice.begin_stream()
        return self._peer

    @property
    def profile(self) -> ConsoleProfile | None:
        """The profile by which packets are read; None while it is undecided."""
        return self._choice.profile

    def admit(self, datagram: bytes, source: tuple, now_ms: float) -> Increments | None:
        """Return the increments in a datagram, or None if it is refused. now_ms: monotonic."""
        increments, cause = self._check(datagram, source, now_ms)
        self.counts[cause] += 1
        # Causes for which a well-formed packet is refused, such as "stranger" or "duplicate".
        drops = WORDS["drops"]
        dropped = sum(self.counts[drop] for drop in drops) if cause in drops else 0
        are_many = dropped >= max(KEPT_MISFITS, MISFIT_SHARE * self.received)
        if are_many and not self._drops_reported:
            self._drops_reported = True
            self._say(
                f"console: {dropped} of {self.received} packets were dropped, the last as {cause}."
                " Either two consoles send, or the network loses packets"
            )
        return increments

    def _check(
        self, datagram: bytes, source: tuple, now_ms: float
    ) -> tuple[Increments | None, str]:
        # Returns the increments, or None if they may not move the robot, and one of `CAUSES`.
        if len(datagram) < SIZE:
            return None, "short"
        peer = self.peer(now_ms)
        if (peer and source != peer) or (self._only_host and source[0] != self._only_host):
            return None, "stranger"
        fields = FIELDS.unpack_from(datagram)
        number = fields[0]
        cause = self._check_number(number, now_ms)
        # The stream may continue although the packet is dropped.
        continues = cause in CONTINUING
        reading = self._choice.read(fields, is_next=cause == TAKEN)
        if isinstance(reading, Misfit):
            if reading.cause != robot.UNDECIDED:
                self._record_misfit(fields, reading)
                return None, reading.cause
            # The packet is in order, but may not move the robot before the profile is known.
            cause = robot.UNDECIDED if cause == TAKEN else cause
        if continues:
            self._last_number, self._last_packet_ms, self._peer = number, now_ms, source
            was_undecided = self.profile is None
            self._choice.accept_packet()
            if was_undecided and (profile := self.profile) is not None:
                title, reason = profile.title, self._choice.reason
                self._say(f"console: profile {profile.name}, {title}. {reason}")
        if cause != TAKEN or isinstance(reading, Misfit):
            return None, cause
        # `reading` has the displacements, turns and jaw increments of all arms.
        tables = dict(zip(self.arms, zip(*reading, strict=True), strict=True))
        return increments_of(bool(fields[robot.MODE]), tables, "itp"), TAKEN

    def _record_misfit(self, fields: Sequence, misfit: Misfit):
        """Store a packet that does not fit the profile. Report once which bundled profile fits
        these packets, or, if they are a large share, that none fits.
        """
        self._misfits.append(fields)
        self._misfit_count += 1
        # Profiles are compared only after every `KEPT_MISFITS` such packets.
        if self._misfits_reported or self._misfit_count % KEPT_MISFITS:
            return
        profile = self._choice.profile
        others = [other for other in consoles.bundled_profiles() if other != profile]
        fitting = robot.matching_profile(self._misfits, others, self.arms) if profile else ""
        if not fitting and self._misfit_count < MISFIT_SHARE * self.received:
            return
        self._misfits_reported = True
        tried = f"profile {profile.name}" if profile else "any profile"
        advice = f"They fit {fitting}: start again with --console {fitting}"
        if not fitting:
            advice = "No bundled profile fits: write one, and start again with --console FILE.toml"
        # `received` does not count the present packet yet.
        self._say(
            f"console: {self._misfit_count} of {self.received + 1} packets do not fit {tried}, the"
            f" last for {misfit}. {advice}"
        )

    def _check_number(self, number: int, now_ms: float) -> str:
        """Return the result of the check of a packet's number, one of `CAUSES`."""
        last = self._last_number
        if number == 0:
            return "zero"
        # 1 follows the largest number.
        if number == (last + 1 if last < _MAX_NUMBER else 1):
            return TAKEN
        if number == last:
            return "duplicate"
        if number < last:
            is_quiet = now_ms - self._last_packet_ms > QUIET_MS
            return "restart" if number == 1 and is_quiet else "behind"
        # A new stream (`last` is 0) may begin with any number.
        return "far_ahead" if last and number - last > robot.RESET_GAP else "skip"


def increments_of(pedal: bool, tables: Mapping[ArmName, Sequence[Any]], source: str) -> Increments:
    """Return a command "increments". tables: displacement, turn and jaw increment of each arm."""
    return {
        "type": "increments",
        "source": source,
        "pedal": pedal,
        "arms": {
            arm: {"delta_um": list(delta), "quat": list(quat), "grasp_mrad": grasp}
            for arm, (delta, quat, grasp) in tables.items()
        },
    }


def merge_commands(commands: Sequence[Increments]) -> Increments | None:
    """Combine commands "increments", in their order, into one; None if there are none.
    Displacements are added and turns are chained. The pedal is that of the last command.
    """
    if not commands:
        return None
    total = commands[0]
    for command in commands[1:]:
        arms = {}
        for arm, later in command["arms"].items():
            earlier = total["arms"][arm]
            arms[arm] = {
                "delta_um": [*map(operator.add, earlier["delta_um"], later["delta_um"])],
                "quat": list(robot.turn_by(earlier["quat"], later["quat"])),
                "grasp_mrad": earlier["grasp_mrad"] + later["grasp_mrad"],
            }
        total = {**command, "arms": arms}
    return total


def packet_of(command: Increments, arms: Sequence[str], sequence: int) -> Packet:
    """Convert a command "increments" to a packet for these arms, with the number `sequence`."""
    tables = [command["arms"][arm] for arm in arms]
    return Packet(
        received=1,
        size=robot.U_STRUCT.itemsize,
        sequence=sequence,
        delta=tuple(Vec(table["delta_um"]) for table in tables),
        quat=tuple(Vec(table["quat"]) for table in tables),
        grasp=tuple(table["grasp_mrad"] for table in tables),
        surgeon_mode=int(command["pedal"]),
    )


LOOPBACK = "127.0.0.1"
MIN_DATAGRAMS_PER_TICK = 8
"""The least number of datagrams that one tick reads. Further datagrams wait in the kernel."""
DEFAULT_PACKETS_PER_TICK = 4
"""The largest number of packets accepted in one tick while the console's profile is unknown."""
BUFFER_BYTES = 1 << 16
"""Size of the kernel's buffer: some 150 datagrams, so that waiting datagrams are never old."""
MIN_REFUSED_PACKETS = 10
"""The number of packets refused within `STALE_MS`, with none accepted, that triggers a message."""
FORCE_SCALE = 1000.0  # Units of a force packet in a device unit
_FORCE_LIMIT = 2**31 - 1
_AXES = np.array([robot.ITP_AXES[arm] for arm in ARMS], int)
"""ITP axes of each arm, as columns, in frame 0."""


class ItpServer:
    """A UDP port for consoles. One console at a time may drive."""

    last_sequence = 0  # number of the console's packet accepted last
    _pedal = False
    _accepted_ms = -math.inf
    _sent_forces = 0

    def __init__(
        self,
        gate: Gate,
        host: str = LOOPBACK,
        port: int = robot.UDP_PORT,
        clock: Callable[[], int] = time.monotonic_ns,
    ):
        """gate: checks the datagrams. Raises UserError if the port is taken."""
        self.gate, self._clock = gate, clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with refuse_errors(
            f"UDP {host}:{port} cannot be opened for consoles",
            "another session may use it. Give another port, or 0 for any free one",
            self._socket,
        ):
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._socket.bind((host, port))
        self._present = sum(1 << ARMS.index(arm) for arm in gate.arms)

    @property
    def address(self) -> tuple[str, int]:
        return self._socket.getsockname()[:2]

    def poll(self) -> list[Command]:
        """Return the motion since the last call as one command "increments", or []. It accepts at
        most as many packets as the profile allows. The others wait in the kernel. Refused datagrams
        do not delay them, because at least `MIN_DATAGRAMS_PER_TICK` are read.
        """
        now_ms = self._clock() * 1e-6
        profile = self.gate.profile
        limit = DEFAULT_PACKETS_PER_TICK if profile is None else profile.stream.per_tick
        accepted = []
        for _ in range(max(MIN_DATAGRAMS_PER_TICK, limit)):
            try:
                datagram, source = self._socket.recvfrom(SIZE)
            except BlockingIOError:
                break
            # The last force was sent to a closed port. Further datagrams may follow this error.
            except OSError:
                continue
            increments = self.gate.admit(datagram, source, now_ms)
            if increments is not None:
                accepted.append(increments)
                # A packet begins with its number.
                self.last_sequence = int.from_bytes(datagram[:4], "little")
                if len(accepted) == limit:
                    break
        total = merge_commands(accepted)
        if total is None:
            return []
        self._pedal, self._accepted_ms = total["pedal"], now_ms
        return [total]

    def send_force(
        self,
        forces: Mapping[str, Sequence[float]],
        runlevel: int = 0,
        soft_estopped: bool = False,
        pedal: bool = True,
        drives: bool = True,
    ) -> None:
        """Send the force of each arm (3, device units, frame 0 of the arm) to the console. Call it
        at most once a tick. pedal: whether a pedal that the console holds down counts. drives:
        False if another console drives; then the force is zero. A console that is silent gets zero
        force and pedal up, until the gate forgets the console's address.
        """
        now_ms = self._clock() * 1e-6
        peer = self.gate.peer(now_ms)
        if peer is None:
            return
        alive = now_ms - self._accepted_ms <= STALE_MS
        flags = self._present | SOFT_ESTOPPED * soft_estopped | DRIVES * drives
        components = [0] * 6
        if alive:
            flags |= ALIVE | PEDAL * (pedal and self._pedal)
            for arm, force in forces.items() if drives else ():
                index = ARMS.index(arm)  # type: ignore[arg-type]
                # From frame 0 to the axes of ITP.
                units = np.dot([_round_force(FORCE_SCALE * float(x)) for x in force], _AXES[index])
                # A packet has x of gold and green arm, then y of both, then z of both.
                components[index::2] = units
                # Bits 8 and 9: the cue of the gold and of the green arm pulls.
                flags |= (1 << 8 + index) if units.any() else 0
        self._sent_forces += 1
        total = sum(components) + int(runlevel) + self._sent_forces
        # The sum of all fields, as a signed number of 32 bits.
        checksum = (total + 2**31) % 2**32 - 2**31
        number = self._sent_forces % 2**32
        datagram = robot.V_STRUCT.pack(
            number, self.last_sequence, 0, 0, *components, int(runlevel), flags, checksum
        )
        # If the packet cannot be sent, the next tick sends a newer force.
        with contextlib.suppress(OSError):
            self._socket.sendto(datagram, peer)

    def counters(self) -> dict[str, int]:
        """Return the counts of datagrams by `CAUSES`, and of force packets."""
        return {**self.gate.counts, "force_sent": self._sent_forces}

    def close(self) -> None:
        self._socket.close()


def _round_force(value: float) -> int:
    # Returns the nearest number of 32 bits; 0 for NaN, which is not equal to itself.
    return 0 if value != value else round(max(-_FORCE_LIMIT, min(_FORCE_LIMIT, value)))


class ItpConsole:
    """An ITP console of the realtime loop: receives increments and sends forces."""

    _polls, _refusal = 0, ""

    def __init__(self, server: ItpServer, session: TickedSession):
        self._server, self._session = server, session
        self._counts = Counter(server.gate.counts)

    def poll(self) -> list[Command]:
        """Return the console's motion as one command "increments", or []. If the reason why packets
        are refused has changed, add a command "unheard" with the new reason ("": accepted again).
        """
        commands, self._polls = self._server.poll(), self._polls + 1
        # The loop polls once a millisecond, so the reason is determined every `STALE_MS`.
        refusal = self._find_refusal() if self._polls % STALE_MS == 0 else self._refusal
        if refusal != self._refusal:
            self._refusal = refusal
            commands.append({"type": "unheard", "why": refusal})
        return [{**command, "console": "itp"} for command in commands]

    def _find_refusal(self) -> str:
        """Return why packets since the last call were refused; "" if some were accepted. If fewer
        than `MIN_REFUSED_PACKETS` were refused for one cause, return the last reason.
        """
        counts = Counter(self._server.gate.counts)
        new_counts, self._counts = counts - self._counts, counts
        accepted = new_counts.pop(TAKEN, 0)
        # A second console learns why it is refused, although packets of the first are accepted.
        if new_counts["stranger"] >= MIN_REFUSED_PACKETS:
            return packets_message("stranger")
        if accepted:
            return ""
        [(cause, count)] = new_counts.most_common(1) or [("", 0)]
        return packets_message(cause) if count >= MIN_REFUSED_PACKETS else self._refusal

    def send_frame(self, frame: Frame) -> None:
        # Sends the force of this frame to the console: zero unless the console drives.
        drives = self._session.arbiter.owner == "itp"
        forces = {}
        if drives and frame.number("console_alive"):
            setting, cue_on = self._session.scenario, frame.number("cue_on") != 0
            gain, cap = setting.contact.units_per_n, setting.cue.cap
            for arm in self._session.arms:
                forces[arm] = force_at_hand(frame, arm, gain, cap, cue_on)
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
    """Return the force at the operator's hand in device units, frame 0. The sum of cue and contact
    force is limited to `cap`, or to the cue alone if the cue is larger. units_per_n: device units
    per N of contact, which the operator always feels. cue: whether the operator feels the cue.
    """
    cue_force = frame[f"{arm}/force"].tolist() if cue else [0.0] * 3
    contact_n = frame[f"{arm}/contact"].tolist()
    x, y, z = (a + units_per_n * b for a, b in zip(cue_force, contact_n, strict=True))
    size, limit = math.hypot(x, y, z), max(cap, math.hypot(*cue_force))
    share = limit / size if size > limit else 1.0
    return x * share, y * share, z * share
