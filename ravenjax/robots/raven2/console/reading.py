"""Converts a packet's fields into increments of the tips, or names the rule that the packet breaks.

The rules and units are those of the console's *profile*. If packets contain positions of the jaw or
orientations of the hand, their differences between consecutive packets are the increments.
Therefore the robot does not follow motion before the first packet or during lost packets.
"""

import math
import struct
from collections.abc import Sequence
from typing import NamedTuple

from ravenjax.numbers import Vec
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console.packet import U_STRUCT
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.geometry import mapping

FIELDS = struct.Struct("<3I6i8d6i")
"""Layout of `packet.U_STRUCT`. Unpacking with `struct` is ten times as fast as with NumPy."""
DELTA, QUAT, BUTTONS, GRASP, MODE, CHECKSUM = 3, 9, 17, 19, 21, 22
"""Indices of delx[0], Qx[0], buttonstate[0], grasp[0], surgeon_mode and checksum in the fields.
The fields of the two arms alternate.
"""
assert FIELDS.size == U_STRUCT.itemsize

Quat = tuple[float, ...]
_NO_ROTATION: Quat = (0.0, 0.0, 0.0, 1.0)


class PacketReading(NamedTuple):
    """The motion that a packet commands; one entry per arm."""

    delta_um: tuple[tuple[int, int, int], ...]
    quat: tuple[Quat, ...]  # rotation since the last packet
    grasp_mrad: tuple[int, ...]  # increment, positive closes


class Misfit(NamedTuple):
    """Why a packet is refused: the first rule that it breaks."""

    cause: str  # mode, checksum, buttons, step, quaternion, turn or grasp; `choice.UNDECIDED`
    arm: str  # "" if the rule concerns the whole packet
    got: object
    expected: str

    def __str__(self) -> str:
        arm = f" of {self.arm}" if self.arm else ""
        return f"{self.cause}{arm}: got {self.got}, expected {self.expected}"


class _HandState(NamedTuple):
    """The state of the operator's hand for one arm after the last packet of the stream."""

    jaw: int | None  # field grasp; None before the first packet
    quat: Quat | None  # orientation, a unit quaternion; None if packets contain none
    remainders: tuple[float, ...]  # of rounding increments to whole numbers: um (3), mrad


_START = _HandState(None, None, (0.0, 0.0, 0.0, 0.0))


class PacketReader:
    """Reads a stream of packets with the rules of one profile."""

    def __init__(self, profile: ConsoleProfile, arms: Sequence[ArmName]):
        """Prepare to read the fields of these arms; the fields of other arms are ignored."""
        self.profile = profile
        self._slots = tuple(ARMS.index(arm) for arm in arms)
        # State of each hand in the stream, and its state if the packet read last is accepted
        self._hands = self._next_hands = (_START,) * len(self._slots)
        largest = profile.largest
        self._max_step_square = largest.step_um**2
        # A smaller cosine of half the angle is a larger rotation
        self._min_cos_square = math.cos(largest.turn_rad / 2) ** 2

    def begin_stream(self) -> None:
        """Reset the state, because another stream begins."""
        self._hands = (_START,) * len(self._slots)

    def accept_packet(self) -> None:
        """Accept the packet that was read last as part of the stream."""
        self._hands = self._next_hands

    def read(self, fields: Sequence, is_next: bool = True) -> PacketReading | Misfit:
        """Return the increments that a packet commands, or the first rule that it breaks.
        fields: as unpacked by `FIELDS`. is_next: whether the packet follows the last packet of the
        stream; otherwise only its content is checked. `accept_packet` changes the stream's state.
        """
        self._next_hands = self._hands
        if fields[MODE] not in (0, 1):
            return Misfit("mode", "", fields[MODE], "surgeon_mode 0 or 1")
        if self.profile.stream.checksum:
            buttons = fields[BUTTONS] + fields[BUTTONS + 1]
            total = fields[0] + sum(fields[DELTA:QUAT]) + buttons + fields[MODE]
            # The checksum is the sum of these fields as int32, which wraps
            if (total - fields[CHECKSUM]) & 0xFFFFFFFF:
                expected = str((total + 2**31) % 2**32 - 2**31)
                return Misfit("checksum", "", fields[CHECKSUM], expected)
        arms = []
        for slot, hand in zip(self._slots, self._hands, strict=True):
            hand_reading = self._read_hand(fields, slot, hand if is_next else _START)
            if isinstance(hand_reading, Misfit):
                return hand_reading
            arms.append(hand_reading)
        deltas, quats, grasps, self._next_hands = zip(*arms, strict=True)
        return PacketReading(deltas, quats, grasps)

    def _read_hand(
        self, fields: Sequence, slot: int, hand: _HandState
    ) -> Misfit | tuple[tuple[int, int, int], Quat, int, _HandState]:
        # Returns the increments of one hand and its new state, or the first rule that is broken.
        # The fields of position and quaternion alternate between the two hands (slots).
        profile, arm, largest = self.profile, ARMS[slot], self.profile.largest
        jaw = fields[GRASP + slot]
        if profile.stream.buttonstate == "jaw" and fields[BUTTONS + slot] != jaw:
            return Misfit("buttons", arm, fields[BUTTONS + slot], f"the value of grasp, {jaw}")
        um, (*remainders, jaw_remainder) = profile.position.um, hand.remainders
        x, y, z = fields[DELTA + slot : QUAT : 2]
        if um != 1.0:
            exact = (n * um + rest for n, rest in zip((x, y, z), remainders, strict=True))
            (x, y, z), remainders = zip(*map(_round_with_remainder, exact), strict=True)
        if x * x + y * y + z * z > self._max_step_square:
            expected = f"at most {largest.step_um:g} um"
            return Misfit("step", arm, f"{math.hypot(x, y, z):g} um", expected)
        sent = fields[QUAT + slot : QUAT + slot + 7 : 2]
        turn, orientation = self._read_rotation(sent, hand.quat)
        if turn is None:
            return Misfit("quaternion", arm, list(sent), self._describe_form())
        # A turn by an angle has w = cos(angle / 2) |turn|. `not >=` also refuses NaN
        if not turn[3] * turn[3] >= self._min_cos_square * sum(c * c for c in turn):
            expected = f"at most {largest.turn_rad:g} rad ({self._describe_form()})"
            return Misfit("turn", arm, list(sent), expected)
        mrad = profile.jaw.mrad
        increment: float = jaw
        if profile.jaw.form == "positions":
            # The bounds apply to the scaled value, whatever direction of values closes the jaw
            position = jaw * abs(mrad)
            if not profile.jaw.lowest_mrad <= position <= profile.jaw.highest_mrad:
                ends = f"{profile.jaw.lowest_mrad:g}..{profile.jaw.highest_mrad:g} mrad"
                return Misfit("grasp", arm, f"{position:g} mrad", f"a position in {ends}")
            increment = 0 if hand.jaw is None else jaw - hand.jaw
        grasp = int(increment)
        if mrad != 1.0:
            grasp, jaw_remainder = _round_with_remainder(increment * mrad + jaw_remainder)
        if abs(grasp) > largest.jaw_mrad:
            expected = f"an increment of at most {largest.jaw_mrad:g} mrad"
            return Misfit("grasp", arm, f"{grasp} mrad", expected)
        return (x, y, z), turn, grasp, _HandState(jaw, orientation, (*remainders, jaw_remainder))

    def _read_rotation(
        self, sent: Sequence[float], before: Quat | None
    ) -> tuple[Quat | None, Quat | None]:
        # Returns the rotation that a packet commands, and the hand's orientation, as quaternions.
        # sent: Qx, Qy, Qz, Qw of the packet. before: orientation of the last packet. The rotation
        # is None if `sent` is no rotation. The orientation is None unless packets contain it.
        x, y, z, w = sent
        square = x * x + y * y + z * z + w * w
        form = self.profile.orientation.form
        if form == "vector":
            if w != 1.0 or not square < math.inf:  # also refuses NaN
                return None, None
            if square == 1.0:  # the vector is zero, because Qw is 1
                return _NO_ROTATION, None
            angle = math.sqrt(x * x + y * y + z * z)
            # Half a turn is refused as too large. Without the bound, still larger angles could pass
            half_angle = min(0.5 * angle * self.profile.orientation.rad, math.pi / 2)
            factor = math.sin(half_angle) / angle if angle else 0.0
            return (x * factor, y * factor, z * factor, math.cos(half_angle)), None
        if not 0.98 < square < 1.02:
            return None, None
        if form == "increments":
            return (x, y, z, w), None
        scale = 1.0 / math.sqrt(square)
        orientation = x * scale, y * scale, z * scale, w * scale
        if before is None:
            return _NO_ROTATION, orientation
        x, y, z, w = before
        # The orientation times the inverse of the last orientation
        turn = mapping.quat_mul(Vec(orientation), Vec((-x, -y, -z, w)))
        # `turn` and -turn are the same rotation; the one with a positive w has the smaller angle
        return (-turn if turn[3] < 0.0 else turn), orientation

    def _describe_form(self) -> str:
        # Describes the expected form of the orientation in words.
        form = self.profile.orientation.form
        if form == "vector":
            return f"a rotation vector in {self.profile.orientation.unit}, with Qw = 1"
        meaning = ", the rotation since the last packet" if form == "increments" else ""
        return f"a unit quaternion{meaning}"


def _round_with_remainder(value: float) -> tuple[int, float]:
    whole = round(value)
    return whole, value - whole
