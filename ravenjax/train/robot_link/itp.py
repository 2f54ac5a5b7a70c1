"""The ITP server: receives a console's increments over UDP and sends the cue's force.

It is polled once a tick and never waits. Force packets have the original's `v_struct` (52 bytes,
little-endian), which raven2 declares and never sends. This server defines its meaning:

- sequence: number of the force packet, from 1.
- last_sequence: number of the console's packet accepted last.
- pactyp, version: 0.
- fx, fy, fz: [gold, green] along the axes of the ITP frame, in thousandths of a device unit of the
  haptic cue. The published cap of 0.05 device units reads 50. A device in newtons scales them.
- runlevel: 0 to 3.
- jointflags: bits 0 and 1: gold and green are present. Bit 2: the pedal counts as down. Bit 3: the
  console is alive. Bit 4: the software holds its E-stop. Bit 5: this console drives. Bits 8 and 9:
  the gold and the green cue pull.
- checksum: sum of forces, run level and number, wrapped to 32 bits, as in the console's packet.
"""

import contextlib
import math
import socket
import time
from collections.abc import Callable, Mapping, Sequence

from ravenjax.errors import UserError
from ravenjax.train.protocol import STALE_MS, Command, Frame, Say
from ravenjax.train.realtime.loop import TickedSession
from ravenjax.train.robot import ARMS, ITP_AXES, UDP_PORT, V_STRUCT, ArmName, ConsoleProfile
from ravenjax.train.robot_link.packet_filter import (
    ALIVE,
    DRIVES,
    PEDAL,
    SIZE,
    SOFT_ESTOPPED,
    TAKEN,
    Gate,
    merge_commands,
)
from ravenjax.train.session.console_arbiter import packets_message

LOOPBACK = "127.0.0.1"
PER_TICK = 8
"""Datagrams read in one tick, at least. The others wait in the kernel."""
USUAL_PER_TICK = 4
"""The largest number of packets accepted in one tick while the console's profile is unknown."""
BUFFER_BYTES = 1 << 16
"""Size of the kernel's buffer: some 150 datagrams, so that waiting datagrams are never old."""
SOME_PACKETS = 10
"""The number of packets refused within `STALE_MS`, with none accepted, that triggers a message."""
FORCE_SCALE = 1000.0
_FORCE_LIMIT = 2**31 - 1


_AXES = tuple(
    [
        next((k, FORCE_SCALE * row[axis]) for k, row in enumerate(ITP_AXES[arm]) if row[axis])
        for axis in range(3)
    ]
    for arm in ARMS
)
"""For each arm and ITP axis: its axis of frame 0, and the factor of the force."""


class ItpServer:
    """A UDP port for consoles, which one console at a time may drive."""

    def __init__(
        self,
        arms: Sequence[ArmName],
        host: str = LOOPBACK,
        port: int = UDP_PORT,
        clock: Callable[[], int] = time.monotonic_ns,
        profiles: Sequence[ConsoleProfile] = (),
        only_host: str | None = None,
        say: Say = lambda _: None,
    ) -> None:
        """profiles, only_host, say: as of `Gate`. Raises UserError if the port is taken."""
        self.arms = tuple(arms)
        self.gate = Gate(arms, profiles, only_host, say)
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise UserError(
                f"UDP {host}:{port} cannot be opened for consoles ({error}): another session may"
                " use it. Give another port, or 0 for any free one"
            ) from None
        self.last_sequence = 0  # number of the console's packet accepted last
        self._pedal = False
        self._taken_ms = float("-inf")
        self._sent = 0
        self._present = sum(1 << ARMS.index(arm) for arm in arms)

    @property
    def address(self) -> tuple[str, int]:
        return self._socket.getsockname()[:2]

    def poll(self) -> list[Command]:
        """Return the increments since the last call as one command "increments", or [].

        At most `SentStream.per_tick` packets count in one tick. The others wait in the kernel.
        """
        now_ms = self._clock() * 1e-6
        profile = self.gate.profile
        most = USUAL_PER_TICK if profile is None else profile.stream.per_tick
        accepted: list[Command] = []
        for _ in range(max(PER_TICK, most)):
            try:
                datagram, source = self._socket.recvfrom(SIZE)
            except BlockingIOError:
                break
            except OSError:  # the host of a former console reports that its port is closed
                continue
            increments = self.gate.admit(datagram, source, now_ms)
            if increments is not None:
                accepted.append(increments)
                self.last_sequence = int.from_bytes(datagram[:4], "little")
                if len(accepted) == most:
                    break
        total = merge_commands(accepted)
        if total is None:
            return []
        self._pedal, self._taken_ms = total["pedal"], now_ms
        return [total]

    def send_force(
        self,
        forces: Mapping[str, Sequence[float]],
        runlevel: int = 0,
        soft_estopped: bool = False,
        pedal: bool = True,
        drives: bool = True,
    ) -> bool:
        """Send the force of each arm (3, device units, frame 0 of the arm) to the console.

        Call it at most once a tick. pedal: False if a pedal that the console holds down does not
        count. drives: False if another console drives; then the force is zero. A stale console gets
        zero force and pedal up until `RELEASE_MS`. Returns whether a packet was sent.
        """
        now_ms = self._clock() * 1e-6
        peer = self.gate.peer(now_ms)
        if peer is None:
            return False
        alive = now_ms - self._taken_ms <= STALE_MS
        flags = self._present | SOFT_ESTOPPED * soft_estopped | DRIVES * drives
        components = [0] * 6
        if alive:
            flags |= ALIVE | PEDAL * (pedal and self._pedal)
            for arm, force in forces.items() if drives else ():
                slot = ARMS.index(arm)  # type: ignore[arg-type]
                pull = [_whole(float(force[axis]) * scale) for axis, scale in _AXES[slot]]
                components[slot::2] = pull
                flags |= (1 << 8 + slot) if any(pull) else 0
        self._sent += 1
        total = sum(components) + int(runlevel) + self._sent
        checksum = (total + 2**31) % 2**32 - 2**31
        number = self._sent % 2**32
        datagram = V_STRUCT.pack(
            number, self.last_sequence, 0, 0, *components, int(runlevel), flags, checksum
        )
        # If the packet cannot be sent, the next tick sends a newer force.
        with contextlib.suppress(OSError):
            self._socket.sendto(datagram, peer)
        return True

    def counters(self) -> dict[str, int]:
        """Return the counts of datagrams by `packet_filter.CAUSES`, and of force packets."""
        return {**self.gate.counts, "force_sent": self._sent}

    def close(self) -> None:
        self._socket.close()


def _whole(value: float) -> int:
    return 0 if value != value else round(max(-_FORCE_LIMIT, min(_FORCE_LIMIT, value)))


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
            why = packets_message(cause)
        if why == self._published:
            return []
        self._published = why
        return [{"type": "unheard", "why": why}]


class ItpConsole:
    """A console over the network: receives increments and sends forces."""

    def __init__(self, server: ItpServer, session: TickedSession) -> None:
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
