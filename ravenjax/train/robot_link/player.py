"""Runs `ravenjax play`: replays a recorded stream of a console's packets, byte for byte.

A robot accepts a pedal only after the pedal was up. The player therefore sends the first packet
with the pedal up, again and again, for `LEAD_S`. The robot may still follow another console, until
two seconds after that console's last packet. So the player continues until a force packet shows
that the robot follows the player. A real Raven sends no force packets; then the recording starts
after `KNOCK_S`.
"""

import contextlib
import socket
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax import interruption
from ravenjax.errors import UserError
from ravenjax.train.protocol import Say
from ravenjax.train.robot import BUTTONS, CHECKSUM, FIELDS, MODE, V_STRUCT
from ravenjax.train.robot_link.itp import DRIVES, PEDAL
from ravenjax.vocabulary.packets import RELEASE_MS

LEAD_S, LEAD_STEP_S = 0.4, 0.002
KNOCK_S, KNOCK_STEP_S = RELEASE_MS * 1e-3 + 0.5, 0.02
_LARGEST = 2**32 - 1
_DISPLACEMENTS = slice(3, 9)


class Played(NamedTuple):
    """Summary of the packets sent and the force packets received."""

    packets: int  # packets of the recording that were sent
    of: int
    seconds: float
    # The largest delay of a packet after its time.
    latest_s: float
    forces: int  # force packets received
    # Force packets that say that this console's pedal counts.
    driving: int

    def __str__(self) -> str:
        late_ms = self.latest_s * 1e3
        sent = (
            f"{self.packets} of {self.of} packets sent in {self.seconds:.3f} s, at most"
            f" {late_ms:.1f} ms late"
        )
        if not self.forces:
            return f"{sent}; no force packet came back: check that a robot listens there"
        words = (
            f"{sent}; {self.forces} force packets came back, {self.driving} of them with the pedal"
            " down"
        )
        return words if self.driving else f"{words}; the robot's terminal shows why"


def lead_packets(first: bytes, count: int = round(LEAD_S / LEAD_STEP_S)) -> list[bytes]:
    """Return the packets to send ahead of the recording's first one."""
    fields = list(FIELDS.unpack_from(first))
    number = fields[0]
    fields[_DISPLACEMENTS] = [0] * 6
    fields[MODE] = 0
    packets = []
    for before in range(count, 0, -1):
        fields[0] = (number - 1 - before) % _LARGEST + 1  # 0 is not a valid packet number
        total = fields[0] + fields[BUTTONS] + fields[BUTTONS + 1]
        fields[CHECKSUM] = (total + 2**31) % 2**32 - 2**31
        packets.append(FIELDS.pack(*fields))
    return packets


def play_packets(
    datagrams: Sequence[bytes], arrival_s: np.ndarray, address: tuple[str, int], say: Say = print
) -> Played:
    """Send the packets to a robot until the end, or Ctrl-C. arrival_s: counted from the first.

    Raises UserError if the address is not valid or reachable.
    """
    ahead = lead_packets(datagrams[0])
    whole = [*ahead, *datagrams]
    due = np.concatenate([np.arange(len(ahead)) * LEAD_STEP_S, LEAD_S + np.asarray(arrival_s)])
    with (
        interruption.until_interrupted() as stop,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port,
    ):
        try:
            port.connect(address)
        except OSError as error:
            raise UserError(
                f"{address[0]}:{address[1]} cannot be reached ({error.strerror or error})"
            ) from None
        port.setblocking(False)
        say(
            f"sending packets with the pedal up to {address[0]}:{address[1]}, then"
            f" {len(datagrams)} recorded packets of {arrival_s[-1]:.3f} s"
        )
        _knock(port, lead_packets(datagrams[0], len(ahead) + 1)[0], stop)
        begin = time.monotonic()
        sent = forces = driving = 0
        latest = 0.0
        for at, datagram in zip(due.tolist(), whole, strict=True):
            if (wait := begin + at - time.monotonic()) > 0:
                time.sleep(wait)
            if stop:
                break
            with contextlib.suppress(ConnectionRefusedError):  # an earlier packet was refused
                port.send(datagram)
            sent += 1
            latest = max(latest, time.monotonic() - begin - at)
            for flags in _heard(port):
                forces += 1
                driving += flags & (PEDAL | DRIVES) == PEDAL | DRIVES
        return Played(
            max(0, sent - len(ahead)),
            len(datagrams),
            max(0.0, time.monotonic() - begin - LEAD_S),
            latest,
            forces,
            driving,
        )


def _knock(port: socket.socket, packet: bytes, stop: Sequence) -> None:
    """Send the packet repeatedly until a force packet arrives, for at most `KNOCK_S`."""
    end = time.monotonic() + KNOCK_S
    while time.monotonic() < end and not stop:
        with contextlib.suppress(ConnectionRefusedError):
            port.send(packet)
        time.sleep(KNOCK_STEP_S)
        if any(True for _ in _heard(port)):
            return


def _heard(port: socket.socket) -> Iterator[int]:
    while True:
        try:
            packet = port.recv(2048)
        except BlockingIOError:
            return
        except OSError:  # the other machine reports that the port is closed
            continue
        if len(packet) == V_STRUCT.size:
            *_, jointflags, _ = V_STRUCT.unpack(packet)
            yield jointflags


def parse_host_port(text: str) -> tuple[str, int]:
    """Parse HOST:PORT. Raises UserError if it is invalid."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise UserError(f"--to is {text!r}, expected HOST:PORT, such as 127.0.0.1:36000")
    return host, int(port)
