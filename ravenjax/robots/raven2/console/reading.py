"""Converts a packet's fields into increments of the tips, or names the broken rule of the console's
packet format (its *profile*).

Positions of jaws, and orientations of hands, become differences between consecutive packets.
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
"""Layout of U_STRUCT. Unpacking with `struct` is ten times as fast as with NumPy."""
QUAT, BUTTONS, GRASP, MODE, CHECKSUM = 9, 17, 19, 21, 22
"""Indices of Qx[0], buttonstate[0], grasp[0], surgeon_mode and checksum among the fields."""
assert FIELDS.size == U_STRUCT.itemsize

Quat = tuple[float, ...]
_NO_ROTATION: Quat = (0.0, 0.0, 0.0, 1.0)


class PacketReading(NamedTuple):
    """The motion that a packet commands; one entry per arm."""

    delta_um: tuple[tuple[int, int, int], ...]
    quat: tuple[Quat, ...]
    grasp_mrad: tuple[int, ...]


class Misfit(NamedTuple):
    """Why a packet is refused: the first rule that it breaks."""

    cause: str  # mode, checksum, buttons, step, quaternion, turn or grasp
    arm: str  # "" if the rule concerns the whole packet
    got: object
    expected: str

    def __str__(self) -> str:
        of = f" of {self.arm}" if self.arm else ""
        return f"{self.cause}{of}: got {self.got}, expected {self.expected}"


class _Hand(NamedTuple):
    """The state of an arm after the last packet of the stream."""

    jaw: int | None  # value of the jaw
    quat: Quat | None  # orientation, a unit quaternion
    left: tuple[float, ...]  # remainders of rounding to whole numbers: um (3), mrad


_FIRST = _Hand(None, None, (0.0, 0.0, 0.0, 0.0))


class PacketReader:
    """Reads a stream of packets with the rules of one profile."""

    def __init__(self, profile: ConsoleProfile, arms: Sequence[ArmName]):
        """Prepare to read the fields of these arms; other arms may have any values."""
        self.profile = profile
        self._slots = tuple(ARMS.index(arm) for arm in arms)
        # State of the arms, and their state after the packet that was read last
        self._hands = self._next = (_FIRST,) * len(self._slots)
        largest = profile.largest
        self._step_square = largest.step_um**2
        self._cos_square = math.cos(largest.turn_rad / 2) ** 2

    def begin(self) -> None:
        """Reset the state, because another stream begins."""
        self._hands = (_FIRST,) * len(self._slots)

    def follow(self) -> None:
        """Accept the packet that was read last as part of the stream."""
        self._hands = self._next

    def read(self, fields: Sequence, joined: bool = True) -> PacketReading | Misfit:
        """Return the increments that a packet's fields (of `FIELDS`) command, or a broken rule.

        The state of the stream changes only with `follow`. joined: the packet follows the last
        packet of the stream; else only its content is checked.
        """
        self._next = self._hands
        profile = self.profile
        if fields[MODE] not in (0, 1):
            return Misfit("mode", "", fields[MODE], "surgeon_mode 0 or 1")
        if profile.stream.checksum:
            buttons = fields[BUTTONS] + fields[BUTTONS + 1]
            total = fields[0] + sum(fields[3:9]) + buttons + fields[MODE]
            if (total - fields[CHECKSUM]) & 0xFFFFFFFF:
                expected = str((total + 2**31) % 2**32 - 2**31)
                return Misfit("checksum", "", fields[CHECKSUM], expected)
        arms = []
        for slot, hand in zip(self._slots, self._hands, strict=True):
            hand_reading = self._hand(fields, slot, hand if joined else _FIRST)
            if isinstance(hand_reading, Misfit):
                return hand_reading
            arms.append(hand_reading)
        deltas, quats, grasps, self._next = zip(*arms, strict=True)
        return PacketReading(deltas, quats, grasps)

    def _hand(
        self, fields: Sequence, slot: int, hand: _Hand
    ) -> Misfit | tuple[tuple[int, int, int], Quat, int, _Hand]:
        # Returns the increments of one hand and its new state, or the first rule that is broken.
        profile, arm, largest = self.profile, ARMS[slot], self.profile.largest
        jaw = fields[GRASP + slot]
        if profile.stream.buttonstate == "jaw" and fields[BUTTONS + slot] != jaw:
            return Misfit("buttons", arm, fields[BUTTONS + slot], f"the value of grasp, {jaw}")
        um, (*left, left_jaw) = profile.position.um, hand.left
        x, y, z = fields[3 + slot : 9 : 2]
        if um != 1.0:
            steps = (_whole(n * um + rest) for n, rest in zip((x, y, z), left, strict=True))
            (x, y, z), left = zip(*steps, strict=True)
        if x * x + y * y + z * z > self._step_square:
            expected = f"at most {largest.step_um:g} um"
            return Misfit("step", arm, f"{math.hypot(x, y, z):g} um", expected)
        sent = fields[QUAT + slot : QUAT + slot + 7 : 2]
        turn, orientation = self._turn(sent, hand.quat)
        if turn is None:
            return Misfit("quaternion", arm, list(sent), self._form())
        if not turn[3] * turn[3] >= self._cos_square * sum(c * c for c in turn):
            expected = f"at most {largest.turn_rad:g} rad ({self._form()})"
            return Misfit("turn", arm, list(sent), expected)
        mrad = profile.jaw.mrad
        step: float = jaw
        if profile.jaw.form == "positions":
            position = jaw * abs(mrad)
            if not profile.jaw.lowest_mrad <= position <= profile.jaw.highest_mrad:
                ends = f"{profile.jaw.lowest_mrad:g}..{profile.jaw.highest_mrad:g} mrad"
                return Misfit("grasp", arm, f"{position:g} mrad", f"a position in {ends}")
            step = 0 if hand.jaw is None else jaw - hand.jaw
        grasp = int(step)
        if mrad != 1.0:
            grasp, left_jaw = _whole(step * mrad + left_jaw)
        if abs(grasp) > largest.jaw_mrad:
            expected = f"an increment of at most {largest.jaw_mrad:g} mrad"
            return Misfit("grasp", arm, f"{grasp} mrad", expected)
        return (x, y, z), turn, grasp, _Hand(jaw, orientation, (*left, left_jaw))

    def _turn(self, sent: Sequence[float], before: Quat | None) -> tuple[Quat | None, Quat | None]:
        """Return the rotation that a packet commands, and the hand's orientation, as quaternions.

        sent: Qx, Qy, Qz, Qw of the packet. before: orientation of the last packet. The rotation is
        None if `sent` is no rotation. The orientation is None unless packets contain it.
        """
        x, y, z, w = sent
        square = x * x + y * y + z * z + w * w
        form = self.profile.orientation.form
        if form == "vector":
            if w != 1.0 or not square < math.inf:  # also refuses NaN
                return None, None
            if square == 1.0:
                return _NO_ROTATION, None
            angle = math.sqrt(x * x + y * y + z * z)
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
        turn = mapping.quat_mul(Vec(orientation), Vec((-x, -y, -z, w)))
        return (-turn if turn[3] < 0.0 else turn), orientation

    def _form(self) -> str:
        # Describes the expected form of the orientation in words.
        form = self.profile.orientation.form
        if form == "vector":
            return f"a rotation vector in {self.profile.orientation.unit}, with Qw = 1"
        of = ", the rotation since the last packet" if form == "increments" else ""
        return f"a unit quaternion{of}"


def _whole(value: float):
    whole = round(value)
    return whole, value - whole
