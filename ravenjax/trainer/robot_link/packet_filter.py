"""The gate: what a console's datagram must pass before anything moves.

In this order, and each refusal is counted under its cause:

1. size: shorter than 124 bytes is dropped, longer is cut, as the robot does (raven2: network_layer.cpp);
2. one console at a time: whose stream is followed, until it has been silent for `PacketLimits.release_ms`;
3. content: pedal 0 or 1, quaternions finite and of about unit length, increments within `PacketLimits`. The robot
   itself checks none of that. What is refused so far is as if it had never arrived;
4. sequence: the robot's own rules (`raven2.stages.network`): the number after the last is taken, a gap loses the
   packet after it too, 0 and repeated numbers are dropped, and a stream begins at 1, or loses its first packet. But
   stricter, for the robot would follow a replayed stream: going back means a restart only at number 1, only from a
   console that has been quiet for `PacketLimits.quiet_ms`, and the packet that restarts is lost; a leap further than
   `PacketLimits.gap` ahead is dropped. After `release_ms` of silence any stream may begin.

No protocol without a secret can tell a recorded stream from a console that starts: bind loopback or name the console's
address (`PacketLimits.console`) where others share the network.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Sequence

from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console.packet import U_STRUCT
from ravenjax.robots.raven2.stages.network import RESET_GAP
from ravenjax.trainer.protocol.messages import STALE_MS
from ravenjax.trainer.robot_link.increments import Increments

SIZE = U_STRUCT.itemsize
_FIELDS = struct.Struct("<3I6i8d6i")  # U_STRUCT; unpacking it is ten times as fast as NumPy is
_QUAT, _GRASP, _MODE = 9, 19, 21  # places of Qx[0], grasp[0] and surgeon_mode among the fields
_LAST = 2**32 - 1

TAKEN = "accepted"
CAUSES = (
    TAKEN,
    "short",  # less than 124 bytes
    "stranger",  # another console's stream is followed, or its address is not the one named
    "mode",  # surgeon_mode is neither 0 nor 1
    "step",  # displacement above the limit
    "quaternion",  # not finite, or not of about unit length
    "turn",  # rotation above the limit
    "grasp",  # jaw increment above the limit
    "zero",  # number 0 is reserved
    "duplicate",  # the last number again
    "behind",  # reordered or replayed
    "far_ahead",  # too far for a gap
    "skip",  # a gap: the stream goes on after this packet, which is lost as well
    "restart",  # number 1 of a console that was quiet: the stream goes on after this packet
)
"""What becomes of a datagram: each is counted under exactly one of these."""


@dataclasses.dataclass(frozen=True)
class PacketLimits:
    """Bounds of one packet and of the stream. The robot has none of the first three."""

    step_um: float = 1000.0  # displacement; recorded teleoperation stays below 232 um per ms
    turn_rad: float = 0.1  # rotation
    grasp_mrad: int = 200
    gap: int = RESET_GAP  # numbers that may be missing
    quiet_ms: float = float(STALE_MS)  # silence after which number 1 restarts the stream: the console was dead
    release_ms: float = 2000.0  # silence after which another console may take over
    console: str | None = None  # the only host that may send; None: any


DEFAULT = PacketLimits()


class Gate:
    """Judges datagrams one by one; no sockets, no clock."""

    def __init__(self, arms: Sequence[ArmName], limits: PacketLimits = DEFAULT) -> None:
        """arms: those whose fields are read; an arm that is not there may have any."""
        self.limits = limits
        self.counts: dict[str, int] = dict.fromkeys(CAUSES, 0)
        self.cut = 0  # datagrams longer than 124 bytes; they count under their cause too
        self._slots = tuple(ARMS.index(arm) for arm in arms)
        self._step_square = limits.step_um**2
        self._cos_square = math.cos(min(limits.turn_rad, math.pi) / 2) ** 2
        self._peer: tuple | None = None
        self._last = 0  # number at which the stream stands; 0: none yet
        self._heard_ms = -math.inf  # when the stream last went on

    @property
    def received(self) -> int:
        """Datagrams so far."""
        return sum(self.counts.values())

    def peer(self, now_ms: float) -> tuple | None:
        """Source address of the console that is followed; None: none."""
        if self._peer is not None and now_ms - self._heard_ms > self.limits.release_ms:
            self._peer, self._last = None, 0
        return self._peer

    def admit(self, datagram: bytes, source: tuple, now_ms: float) -> Increments | None:
        """What is asked of the robot, None where the datagram is refused.

        source: (host, port, ...) of the sender. now_ms: monotonic.
        """
        increments, cause = self._judged(datagram, source, now_ms)
        self.counts[cause] += 1
        return increments

    def _judged(self, datagram: bytes, source: tuple, now_ms: float) -> tuple[Increments | None, str]:
        if len(datagram) < SIZE:
            return None, "short"
        self.cut += len(datagram) > SIZE
        peer = self.peer(now_ms)
        named = self.limits.console
        if (peer is not None and source != peer) or (named is not None and source[0] != named):
            return None, "stranger"
        fields = _FIELDS.unpack_from(datagram)
        if fields[_MODE] not in (0, 1):
            return None, "mode"
        deltas, quats, grasps = [], [], []
        for slot in self._slots:
            x, y, z = delta = fields[3 + slot], fields[5 + slot], fields[7 + slot]
            if x * x + y * y + z * z > self._step_square:
                return None, "step"
            qx, qy, qz, qw = quat = fields[_QUAT + slot : _QUAT + slot + 7 : 2]
            square = qx * qx + qy * qy + qz * qz + qw * qw
            if not 0.98 < square < 1.02:  # so written, NaN is refused too
                return None, "quaternion"
            if qw * qw < self._cos_square * square:
                return None, "turn"
            grasp = fields[_GRASP + slot]
            if not -self.limits.grasp_mrad <= grasp <= self.limits.grasp_mrad:
                return None, "grasp"
            deltas.append(delta)
            quats.append(quat)
            grasps.append(grasp)
        number = fields[0]
        cause, goes_on = self._numbered(number, now_ms)
        if goes_on:
            self._last, self._heard_ms, self._peer = number, now_ms, source
        if cause != TAKEN:
            return None, cause
        return Increments(number, fields[_MODE], tuple(deltas), tuple(quats), tuple(grasps)), TAKEN

    def _numbered(self, number: int, now_ms: float) -> tuple[str, bool]:
        """What becomes of a packet of this number, and whether the stream goes on after it."""
        last = self._last
        if number == 0:
            return "zero", False
        if number == (last + 1 if last < _LAST else 1):
            return TAKEN, True
        if number == last:
            return "duplicate", False
        if number < last:
            restarts = number == 1 and now_ms - self._heard_ms > self.limits.quiet_ms
            return ("restart", True) if restarts else ("behind", False)
        if last and number - last > self.limits.gap:
            return "far_ahead", False
        return "skip", True
