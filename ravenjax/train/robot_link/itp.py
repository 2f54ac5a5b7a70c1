"""The ITP server: a console's increments in by UDP, the cue's force out. Polled once a tick, it
never waits.

Force packets are the original's `v_struct` (52 bytes, little-endian), which raven2 declares and
never sends; what the sources leave open about it is settled here:

    sequence        number of the force packet, from 1
    last_sequence   number of the console's packet taken last
    pactyp, version 0
    fx, fy, fz      [gold, green], axes of the ITP frame: thousandths of a device unit of the haptic cue, so that the
                    published cap of 0.05 device units reads 50; a device that takes newtons scales them
    runlevel        of the robot, 0 to 3
    jointflags      bit 0 gold is there, bit 1 green is there, bit 2 the pedal counts as down, bit 3 the console counts
                    as alive, bit 4 the robot's software holds its E-stop, bit 5 this console drives (0: it watches),
                    bit 8 the gold cue pulls, bit 9 the green one
    checksum        sum of forces, run level and number, wrapped to 32 bits, as the console's own packet has it
"""  # noqa: E501

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot import ARMS, ITP_AXES, UDP_PORT, V_STRUCT, ArmName, ConsoleProfile
from ravenjax.train.robot_link.packet_filter import (
    SIZE,
    Gate,
    merge,
)

LOOPBACK = "127.0.0.1"
PER_TICK = 8
"""Datagrams looked at in one tick, at least; the others wait in the kernel, which drops what
does not fit.
"""
USUAL_PER_TICK = 4
"""Accepted ones among them while the console's profile is not known."""
BUFFER_BYTES = 1 << 16
"""Of the kernel: some 150 datagrams, so that what waits is never old."""
PEDAL, ALIVE, SOFT_ESTOPPED, DRIVES = 1 << 2, 1 << 3, 1 << 4, 1 << 5
"""Bits of jointflags; bit 0 and 1: the arm is there, 8 and 9: its cue pulls."""
FORCE_SCALE = 1000.0
_V_FIELDS = struct.Struct("<4I7iIi")
_FORCE_LIMIT = 2**31 - 1
assert _V_FIELDS.size == V_STRUCT.itemsize


_AXES = tuple(
    [
        next((k, FORCE_SCALE * row[axis]) for k, row in enumerate(ITP_AXES[arm]) if row[axis])
        for axis in range(3)
    ]
    for arm in ARMS
)
"""Of each arm and ITP axis: which axis of frame 0 it lies along, and what to multiply by."""


class ItpServer:
    """One UDP port that one console at a time may drive."""

    def __init__(
        self,
        arms: Sequence[ArmName],
        host: str = LOOPBACK,
        port: int = UDP_PORT,
        clock: Callable[[], int] = time.monotonic_ns,
        profiles: Sequence[ConsoleProfile] = (),
        only_host: str | None = None,
    ) -> None:
        """port 0: any free one. profiles, only_host: as of `Gate`. UserError where the address
        cannot be had.
        """
        self.arms = tuple(arms)
        self.gate = Gate(arms, profiles, only_host)
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise UserError(
                f"UDP {host}:{port} cannot be opened for consoles ({error}); another session may"
                " hold it. Give another port, or 0 for any free one"
            ) from None
        self.last_sequence = 0  # of the console's packet that was accepted last
        self._pedal = False
        self._taken_ms = float("-inf")
        self._sent = 0
        self._present = sum(1 << ARMS.index(arm) for arm in arms)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port it listens on."""
        return self._socket.getsockname()[:2]

    def poll(self) -> list[dict[str, Any]]:
        """One command "increments": what the console asks for since the last call; or none.

        Of a burst at most `SentStream.per_tick` packets count, which bounds the displacement of one
        tick. The others wait in the kernel, in their order, for the next ones.
        """
        now_ms = self._clock() * 1e-6
        profile = self.gate.profile
        most = USUAL_PER_TICK if profile is None else profile.stream.per_tick
        accepted: list[dict[str, Any]] = []
        for _ in range(max(PER_TICK, most)):
            try:
                datagram, source = self._socket.recvfrom(SIZE)
            except BlockingIOError:
                break
            except OSError:  # a former console's host answered that nobody listens there
                continue
            increments = self.gate.admit(datagram, source, now_ms)
            if increments is not None:
                accepted.append(increments)
                self.last_sequence = int.from_bytes(datagram[:4], "little")
                if len(accepted) == most:
                    break
        total = merge(accepted)
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
        """Send the force of each arm (3, device units, frame 0 of the arm) to the console, at most
        once a tick.

        pedal: False where a pedal that the console holds down does not count. drives: False where
        another does. A console that is stale gets zero force and pedal up, until
        `RELEASE_MS`, when it counts as gone. Returns whether a packet went out.
        """
        now_ms = self._clock() * 1e-6
        peer = self.gate.peer(now_ms)
        if peer is None:
            return False
        alive = now_ms - self._taken_ms <= STALE_MS
        flags = self._present | (SOFT_ESTOPPED if soft_estopped else 0) | (DRIVES if drives else 0)
        components = [0] * 6
        if alive:
            flags |= ALIVE | (PEDAL if pedal and self._pedal else 0)
            for arm, force in forces.items():
                slot = ARMS.index(arm)  # type: ignore[arg-type]
                pull = [_whole(float(force[axis]) * scale) for axis, scale in _AXES[slot]]
                components[slot::2] = pull
                flags |= (1 << 8 + slot) if any(pull) else 0
        self._sent += 1
        total = sum(components) + int(runlevel) + self._sent
        checksum = (total + 2**31) % 2**32 - 2**31
        datagram = _V_FIELDS.pack(
            self._sent % 2**32,
            self.last_sequence,
            0,
            0,
            *components,
            int(runlevel),
            flags,
            checksum,
        )
        # No room, or no way to that host: the next tick has a newer force.
        with contextlib.suppress(OSError):
            self._socket.sendto(datagram, peer)
        return True

    def counters(self) -> dict[str, int]:
        """Datagrams by what became of them (`packet_filter.CAUSES`), and force packets."""
        return {**self.gate.counts, "force_sent": self._sent}

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


def _whole(value: float) -> int:
    """The nearest whole number that 32 bits hold; 0 for NaN."""
    return 0 if value != value else round(max(-_FORCE_LIMIT, min(_FORCE_LIMIT, value)))
