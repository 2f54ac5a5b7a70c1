"""`ravenjax play`: sends a recorded stream of a console's packets again, byte by byte and at the
recorded times.

Robots count a pedal only after it was seen up, and a recording may begin with the pedal down. So
the first packet goes out ahead for `LEAD_S`, every `LEAD_STEP_S`, with the pedal up, without
displacements, and under the numbers before it.

Robots and sessions follow one console at a time, and the one before, or the play before, for two
more seconds. So one such packet goes out first, again and again under the same number, until a
force packet tells that this console is followed; a real Raven sends none and gets the recording
after `KNOCK_S`.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax import interruption
from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.reading import BUTTONS, CHECKSUM, FIELDS, MODE
from ravenjax.train.robot import V_STRUCT
from ravenjax.train.robot_link.itp import DRIVES, PEDAL
from ravenjax.vocabulary.packets import RELEASE_MS

LEAD_S, LEAD_STEP_S = 0.4, 0.002
KNOCK_S, KNOCK_STEP_S = RELEASE_MS * 1e-3 + 0.5, 0.02
_LARGEST = 2**32 - 1
_DISPLACEMENTS = slice(3, 9)
_FLAGS = V_STRUCT.fields["jointflags"][1] if V_STRUCT.fields else 0


class Played(NamedTuple):
    """What was sent, and what came back."""

    packets: int  # of the recording
    of: int
    seconds: float
    latest_s: float  # a packet went out so long after its time, at most
    forces: int  # force packets that came back
    driving: int  # of those, how many said that this console's pedal counts

    def __str__(self) -> str:
        """In words, for the command line."""
        late_ms = self.latest_s * 1e3
        sent = (
            f"{self.packets} of {self.of} packets sent in {self.seconds:.3f} s, at most"
            f" {late_ms:.1f} ms late"
        )
        if not self.forces:
            return f"{sent}; no force packet came back: does a robot listen there?"
        words = (
            f"{sent}; {self.forces} force packets came back, {self.driving} of them with the pedal"
            " down"
        )
        return words if self.driving else f"{words}: the terminal of the robot or session says why"


def lead(first: bytes, count: int = round(LEAD_S / LEAD_STEP_S)) -> list[bytes]:
    """The packets that go out ahead of the recording's first one."""
    fields = list(FIELDS.unpack_from(first))
    number = fields[0]
    fields[_DISPLACEMENTS] = [0] * 6
    fields[MODE] = 0
    packets = []
    for before in range(count, 0, -1):
        fields[0] = (number - 1 - before) % _LARGEST + 1  # 0 is no number of a packet
        total = fields[0] + fields[BUTTONS] + fields[BUTTONS + 1]
        fields[CHECKSUM] = (total + 2**31) % 2**32 - 2**31
        packets.append(FIELDS.pack(*fields))
    return packets


def play(
    datagrams: Sequence[bytes],
    arrival_s: np.ndarray,
    address: tuple[str, int],
    say: Callable[[str], None] = print,
) -> Played:
    """Send them to a robot until the end, or Ctrl-C. arrival_s: when each came, since the first.
    UserError.
    """
    ahead = lead(datagrams[0])
    whole = [*ahead, *datagrams]
    due = np.concatenate([np.arange(len(ahead)) * LEAD_STEP_S, LEAD_S + np.asarray(arrival_s)])
    with interruption.until_interrupted() as stop, _connected(address) as port:
        say(
            f"{len(datagrams)} packets of {arrival_s[-1]:.3f} s to {address[0]}:{address[1]}; pedal"
            " up ahead of them"
        )
        _knock(port, lead(datagrams[0], len(ahead) + 1)[0], stop)
        begin = time.monotonic()
        sent = forces = driving = 0
        latest = 0.0
        for at, datagram in zip(due.tolist(), whole, strict=True):
            if (wait := begin + at - time.monotonic()) > 0:
                time.sleep(wait)
            if stop:
                break
            with contextlib.suppress(ConnectionRefusedError):  # of a packet before: nobody listened
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
    """Send the packet until a force packet comes back, or nobody tells for `KNOCK_S`."""
    end = time.monotonic() + KNOCK_S
    while time.monotonic() < end and not stop:
        with contextlib.suppress(ConnectionRefusedError):
            port.send(packet)
        time.sleep(KNOCK_STEP_S)
        if any(True for _ in _heard(port)):
            return


@contextlib.contextmanager
def _connected(address: tuple[str, int]) -> Iterator[socket.socket]:
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        port = socket.socket(family, kind, protocol)
    except OSError as error:
        raise UserError(
            f"{address[0]}:{address[1]}: no such address ({error.strerror or error})"
        ) from None
    with port:
        try:
            port.connect(place)
        except OSError as error:
            raise UserError(
                f"{address[0]}:{address[1]}: cannot be reached ({error.strerror or error})"
            ) from None
        port.setblocking(False)
        yield port


def _heard(port: socket.socket) -> Iterator[int]:
    """The flags of each force packet that has come."""
    while True:
        try:
            packet = port.recv(2048)
        except BlockingIOError:
            return
        except OSError:  # nobody listens there, as the other machine said
            continue
        if len(packet) == V_STRUCT.itemsize:
            yield int.from_bytes(packet[_FLAGS : _FLAGS + 4], "little")


def parse(text: str) -> tuple[str, int]:
    """HOST:PORT. UserError."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise UserError(f"--to is {text!r}, expected HOST:PORT, such as 127.0.0.1:36000")
    return host.removeprefix("[").removesuffix("]"), int(port)
