"""Runs `ravenjax play`: sends a recorded stream of a console's packets to a robot, byte for byte.

A robot accepts a new console only two seconds after the last packet of the previous console. So the
player first repeats one packet until a force packet shows that the robot accepts it. A real Raven
sends no force packets, so this phase ends after `REPEAT_S`. A robot reacts to a pressed pedal only
after the pedal was up. So the player then sends packets with the pedal up for `LEAD_S`.
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
from ravenjax.train.robot import DELTAS, U_STRUCT, V_STRUCT
from ravenjax.train.robot_link import refuse_errors
from ravenjax.train.robot_link.itp import DRIVES, PEDAL
from ravenjax.vocabulary.packets import RELEASE_MS

# Duration of a phase before the recording, and interval of its packets.
LEAD_S, LEAD_INTERVAL_S = 0.4, 0.002
# The first of these packets is repeated until a force packet arrives.
LEAD_COUNT = round(LEAD_S / LEAD_INTERVAL_S) + 1
REPEAT_S, REPEAT_INTERVAL_S = RELEASE_MS * 1e-3 + 0.5, 0.02
_MAX_NUMBER = 2**32 - 1  # packet number


class Played(NamedTuple):
    """Counts of the packets that were sent and of the force packets that were received."""

    packets: int  # packets of the recording that were sent
    of: int  # packets of the recording
    seconds: float
    latest_s: float  # the largest delay of a packet
    forces: int  # force packets received
    driving: int  # force packets received while the pedal counted

    def __str__(self) -> str:
        """Return a sentence for the terminal."""
        sent = (
            f"{self.packets} of {self.of} packets sent in {self.seconds:.3f} s, at most"
            f" {self.latest_s * 1e3:.1f} ms late"
        )
        if not self.forces:
            return f"{sent}; no force packet arrived: check that a robot listens at this address"
        words = (
            f"{sent}; {self.forces} force packets arrived, {self.driving} of them with the pedal"
            " down"
        )
        return words if self.driving else f"{words}; the robot's terminal shows why"


def lead_packets(first: bytes) -> list[bytes]:
    """Return LEAD_COUNT packets without motion, pedal up. Their numbers precede that of `first`."""
    packets = np.repeat(np.frombuffer(first, U_STRUCT), LEAD_COUNT)
    # Numbers are 1 to the largest number, because 0 is not valid. An index counts them from 0.
    first_index = int(packets["sequence"][0]) - 1
    packets["sequence"] = (first_index - np.arange(LEAD_COUNT, 0, -1)) % _MAX_NUMBER + 1
    for name in (*DELTAS, "surgeon_mode"):
        packets[name] = 0
    # The checksum also contains increments and pedal, which are 0.
    total = packets["sequence"] + packets["buttonstate"].sum(axis=1)
    packets["checksum"] = total.astype(np.int32)
    return [packet.tobytes() for packet in packets]


def play_packets(
    datagrams: Sequence[bytes], arrival_s: np.ndarray, address: tuple[str, int], say: Say
) -> Played:
    """Send recorded packets to a robot until the end, or Ctrl-C. Return what was sent and received.
    arrival_s: time of each packet after the first. Raises UserError if `address` is unreachable.
    """
    first_packet, *lead = lead_packets(datagrams[0])
    lead_times = np.arange(len(lead)) * LEAD_INTERVAL_S
    times_s = np.concatenate([lead_times, LEAD_S + np.asarray(arrival_s)])
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
            f"sending to {address[0]}:{address[1]}: first packets in which the pedal is up, then"
            f" {len(datagrams)} recorded packets, for {arrival_s[-1]:.3f} s"
        )
        _await_force(port, first_packet, stop)
        begin = time.monotonic()
        delays_s, flags = [0.0], []
        for due_s, datagram in zip(times_s.tolist(), [*lead, *datagrams], strict=True):
            if (wait := begin + due_s - time.monotonic()) > 0:
                time.sleep(wait)
            if stop:
                break
            _send(port, datagram)
            delays_s.append(time.monotonic() - begin - due_s)
            flags += _receive_flags(port)
        return Played(
            # `delays_s` begins with a zero, and Ctrl-C may come before the recording begins.
            packets=max(0, len(delays_s) - 1 - len(lead)),
            of=len(datagrams),
            seconds=max(0.0, time.monotonic() - begin - LEAD_S),
            latest_s=max(delays_s),
            forces=len(flags),
            driving=sum(flag & (PEDAL | DRIVES) == PEDAL | DRIVES for flag in flags),
        )


def _send(port: socket.socket, datagram: bytes):
    # The kernel reports that an earlier packet was refused.
    with contextlib.suppress(ConnectionRefusedError):
        port.send(datagram)


def _await_force(port: socket.socket, packet: bytes, stop: Sequence):
    """Send the packet repeatedly until a force packet arrives, for at most `REPEAT_S`."""
    end = time.monotonic() + REPEAT_S
    while time.monotonic() < end and not stop:
        _send(port, packet)
        time.sleep(REPEAT_INTERVAL_S)
        if _receive_flags(port):
            return


def _receive_flags(port: socket.socket) -> list[int]:
    """Return the joint flags of the force packets that have arrived."""
    flags = []
    while True:
        try:
            packet = port.recv(2048)
        except BlockingIOError:
            return flags
        # An earlier packet was sent to a closed port. Further packets may follow this error.
        except OSError:
            continue
        # The flags are the last field but one.
        if len(packet) == V_STRUCT.size:
            flags.append(V_STRUCT.unpack(packet)[-2])


def parse_host_port(text: str) -> tuple[str, int]:
    """Return host and port of the option --to, HOST:PORT. Raises UserError if it is invalid."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise UserError(f"--to is {text!r}, expected HOST:PORT, such as 127.0.0.1:36000")
    return host, int(port)
