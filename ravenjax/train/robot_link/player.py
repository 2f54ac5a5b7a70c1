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
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax import interruption
from ravenjax.errors import UserError
from ravenjax.train.protocol import Say
from ravenjax.train.robot import MOVES, U_STRUCT, V_STRUCT
from ravenjax.train.robot_link import refuse_errors
from ravenjax.train.robot_link.itp import DRIVES, PEDAL
from ravenjax.vocabulary.packets import RELEASE_MS

LEAD_S, LEAD_STEP_S = 0.4, 0.002
KNOCK_S, KNOCK_STEP_S = RELEASE_MS * 1e-3 + 0.5, 0.02
_LARGEST = 2**32 - 1


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
    packets = np.repeat(np.frombuffer(first, U_STRUCT), count)
    before = int(packets["sequence"][0]) - 1
    # 0 is not a valid packet number.
    packets["sequence"] = (before - np.arange(count, 0, -1)) % _LARGEST + 1
    for name in (*MOVES, "surgeon_mode"):
        packets[name] = 0
    total = packets["sequence"] + packets["buttonstate"].sum(axis=1)
    packets["checksum"] = total.astype(np.int32)
    return [packet.tobytes() for packet in packets]


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
        with refuse_errors(
            f"{address[0]}:{address[1]} cannot be reached",
            "give the address and port at which a robot listens",
        ):
            port.connect(address)
        port.setblocking(False)
        say(
            f"sending packets with the pedal up to {address[0]}:{address[1]}, then"
            f" {len(datagrams)} recorded packets of {arrival_s[-1]:.3f} s"
        )
        _knock(port, lead_packets(datagrams[0], len(ahead) + 1)[0], stop)
        begin = time.monotonic()
        delays_s, flags = [0.0], []
        for at, datagram in zip(due.tolist(), whole, strict=True):
            if (wait := begin + at - time.monotonic()) > 0:
                time.sleep(wait)
            if stop:
                break
            _send(port, datagram)
            delays_s.append(time.monotonic() - begin - at)
            flags += _heard(port)
        return Played(
            max(0, len(delays_s) - 1 - len(ahead)),
            len(datagrams),
            max(0.0, time.monotonic() - begin - LEAD_S),
            max(delays_s),
            len(flags),
            sum(flag & (PEDAL | DRIVES) == PEDAL | DRIVES for flag in flags),
        )


def _send(port: socket.socket, datagram: bytes) -> None:
    with contextlib.suppress(ConnectionRefusedError):  # an earlier packet was refused
        port.send(datagram)


def _knock(port: socket.socket, packet: bytes, stop: Sequence) -> None:
    """Send the packet repeatedly until a force packet arrives, for at most `KNOCK_S`."""
    end = time.monotonic() + KNOCK_S
    while time.monotonic() < end and not stop:
        _send(port, packet)
        time.sleep(KNOCK_STEP_S)
        if _heard(port):
            return


def _heard(port: socket.socket) -> list[int]:
    """Return the joint flags of the force packets that have arrived."""
    flags: list[int] = []
    while True:
        try:
            packet = port.recv(2048)
        except BlockingIOError:
            return flags
        except OSError:  # the other machine reports that the port is closed
            continue
        if len(packet) == V_STRUCT.size:
            flags.append(V_STRUCT.unpack(packet)[-2])


def parse_host_port(text: str) -> tuple[str, int]:
    """Parse HOST:PORT. Raises UserError if it is invalid."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise UserError(f"--to is {text!r}, expected HOST:PORT, such as 127.0.0.1:36000")
    return host, int(port)
