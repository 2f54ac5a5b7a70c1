"""Checks each datagram of a console before anything moves.

The checks run in this order, and each refusal is counted under its cause:

1. Size: a datagram of less than 124 bytes is dropped. A longer one is cut, as the robot does
   (raven2: network_layer.cpp).

2. One console at a time: the console whose stream is followed, until it has been silent for
   `RELEASE_MS`.

3. Content, by the console's profile: pedal 0 or 1, a correct checksum, orientations finite and of
   their form, increments within the profile's largest after conversion. The robot checks none of
   this. A datagram that was refused so far has no effect.

4. Sequence, by the robot's rules (`raven2.stages.network`): the number after the last is taken, a
   gap loses the packet after it too, 0 and repeated numbers are dropped. A stream begins at 1, or
   loses its first packet. Two rules are stricter, because the robot would follow a replayed stream.
   Going back counts as a restart only at number 1 and only from a console that has been quiet for
   `QUIET_MS`; the restarting packet is lost. A packet more than `RESET_GAP` ahead is dropped.
   After `RELEASE_MS` of silence any stream may begin.

If the profile is to be found ("auto" of `store.consoles`), packets that profiles read differently
are "undecided" until one profile is left. The stream goes on over them, and nothing moves.

No protocol without a secret can distinguish a recorded stream from a console that starts. Where
others share the network, bind loopback or give the console's address (`only_host`).
"""

import math
import operator
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax.numbers.vec import Vec
from ravenjax.store.consoles import loading as consoles
from ravenjax.train.protocol import Say
from ravenjax.train.robot import (
    FIELDS,
    MODE,
    RESET_GAP,
    U_STRUCT,
    UNDECIDED,
    ArmName,
    ConsoleProfile,
    Misfit,
    Packet,
    ProfileChoice,
    matching_profile,
    turn_by,
)
from ravenjax.vocabulary.packets import QUIET_MS, RELEASE_MS

SIZE = FIELDS.size
PEDAL, ALIVE, SOFT_ESTOPPED, DRIVES = 1 << 2, 1 << 3, 1 << 4, 1 << 5
"""Bits of jointflags. Bits 0 and 1: the arm is present; bits 8 and 9: its cue pulls."""
_LAST = 2**32 - 1

TAKEN = "accepted"
CAUSES = (
    TAKEN,
    "short",  # less than 124 bytes
    "stranger",  # another console is followed, or the address is not `only_host`
    "mode",  # surgeon_mode is neither 0 nor 1
    "checksum",
    "buttons",  # jaw value not repeated, where the console sends it twice
    "step",  # displacement above the limit
    "quaternion",  # not finite, or not of the profile's form
    "turn",  # rotation above the limit
    "grasp",  # jaw increment above the limit, or a position out of range
    UNDECIDED,  # the profiles that remain read it differently
    "zero",  # number 0 is reserved
    "duplicate",  # same number as the last
    "behind",  # reordered or replayed
    "far_ahead",  # too far ahead for a gap
    "skip",  # a gap: this packet is lost as well, then the stream goes on
    "restart",  # number 1 of a console that was quiet: lost, then the stream goes on
)
"""Possible results for a datagram. Each is counted under exactly one of them."""


Increments = dict[str, Any]
"""A command "increments" of `protocol`.

It has the pedal, and for each arm, in the ITP frame, `delta_um`, `quat` (x, y, z, w) and
`grasp_mrad` (positive closes).
"""

STILL: dict[str, Any] = {"delta_um": [0, 0, 0], "quat": [0.0, 0.0, 0.0, 1.0], "grasp_mrad": 0}
"""The increment of an arm that does not move."""

DROPS = ("stranger", "duplicate", "behind", "far_ahead", "skip")
"""Results for a well-formed packet that is not the next one of the stream."""
KEPT_MISFITS, MISFIT_SHARE = 32, 0.02
"""After this number of packets that break the profile's rules, the gate names a profile that fits
them. If none fits, it says so, provided that these packets are at least this share of all. It also
reports this number of dropped packets, if they are at least this share.
"""


class Gate:
    """Judges datagrams one by one; it uses no sockets and no clock."""

    def __init__(
        self,
        arms: Sequence[ArmName],
        profiles: Sequence[ConsoleProfile] = (),
        only_host: str | None = None,
        say: Say = lambda _: None,
    ) -> None:
        """arms: the arms whose fields are read; fields of other arms may have any value.

        profiles: that of the console, or several of which one applies; none: the robot's own
        protocol. only_host: the only address that may send; None: any. say: prints for the user
        which profile was found, or which one would fit.
        """
        self._only_host, self._say = only_host, say
        self.counts: dict[str, int] = dict.fromkeys(CAUSES, 0)
        self._arms = tuple(arms)
        self._choice = ProfileChoice(profiles or (consoles.load_profile("raven"),), arms)
        self._open = len(self._choice.readers) > 1  # whether packets have yet to decide the profile
        self._misfits: deque[Sequence] = deque(maxlen=KEPT_MISFITS)
        self._misfit_count, self._advised = 0, False
        self._warned = False  # whether dropped packets were reported
        self._peer: tuple | None = None
        # Number of the stream's last packet; 0: none yet.
        self._last = 0
        self._heard_ms = -math.inf  # when the stream last went on

    @property
    def received(self) -> int:
        return sum(self.counts.values())

    def peer(self, now_ms: float) -> tuple | None:
        """Return the source address of the console that is followed, or None."""
        if self._peer is not None and now_ms - self._heard_ms > RELEASE_MS:
            self._peer, self._last = None, 0
            self._choice.begin()
        return self._peer

    @property
    def profile(self) -> ConsoleProfile | None:
        """The profile by which packets are read; None while it is undecided."""
        return self._choice.profile

    def admit(self, datagram: bytes, source: tuple, now_ms: float) -> Increments | None:
        """Return the increments in a datagram, or None if it is refused. now_ms: monotonic."""
        increments, cause = self._judged(datagram, source, now_ms)
        self.counts[cause] += 1
        dropped = sum(self.counts[drop] for drop in DROPS) if cause in DROPS else 0
        many = dropped >= max(KEPT_MISFITS, MISFIT_SHARE * self.received)
        if many and not self._warned:
            self._warned = True
            self._say(
                f"console: {dropped} of {self.received} packets were dropped, the last as {cause}."
                " Either two consoles send, or packets are lost on the way"
            )
        return increments

    def _judged(
        self, datagram: bytes, source: tuple, now_ms: float
    ) -> tuple[Increments | None, str]:
        if len(datagram) < SIZE:
            return None, "short"
        peer = self.peer(now_ms)
        named = self._only_host
        if (peer is not None and source != peer) or (named is not None and source[0] != named):
            return None, "stranger"
        fields = FIELDS.unpack_from(datagram)
        number = fields[0]
        cause, goes_on = self._numbered(number, now_ms)
        reading = self._choice.read(fields, joined=cause == TAKEN)
        if isinstance(reading, Misfit):
            if reading.cause != UNDECIDED:
                self._note(fields, reading)
                return None, reading.cause
            cause = UNDECIDED if cause == TAKEN else cause
        if goes_on:
            self._last, self._heard_ms, self._peer = number, now_ms, source
            self._choice.follow()
            if self._open and (profile := self._choice.profile) is not None:
                self._open = False
                self._say(
                    f"console: profile {profile.name}, {profile.title}. {self._choice.reason}"
                )
        if cause != TAKEN or isinstance(reading, Misfit):
            return None, cause
        tables = dict(zip(self._arms, zip(*reading, strict=True), strict=True))
        return increments_of(bool(fields[MODE]), tables, "itp"), TAKEN

    def _note(self, fields: Sequence, misfit: Misfit) -> None:
        """Report once that the profile does not fit the console, and which one does, if known."""
        self._misfits.append(fields)
        self._misfit_count += 1
        if self._advised or self._misfit_count % KEPT_MISFITS:
            return
        profile = self._choice.profile
        others = [other for other in consoles.bundled_profiles() if other != profile]
        fits = matching_profile(self._misfits, others, self._arms) if profile else ""
        if not fits and self._misfit_count < MISFIT_SHARE * self.received:
            return
        self._advised = True
        under = f"profile {profile.name}" if profile else "any profile"
        words = (
            f"console: {self._misfit_count} of {self.received + 1} packets do not fit {under}, the"
            f" last for {misfit}"
        )
        advice = f"They fit {fits}: start again with --console {fits}"
        if not fits:
            advice = "No bundled profile fits them: write one, and start again with --console"
            advice += " FILE.toml"
        self._say(f"{words}. {advice}")

    def _numbered(self, number: int, now_ms: float) -> tuple[str, bool]:
        """Return the result for a packet's number, and whether the stream goes on after it."""
        last = self._last
        if number == 0:
            return "zero", False
        if number == (last + 1 if last < _LAST else 1):
            return TAKEN, True
        if number == last:
            return "duplicate", False
        if number < last:
            restarts = number == 1 and now_ms - self._heard_ms > QUIET_MS
            return ("restart", True) if restarts else ("behind", False)
        if last and number - last > RESET_GAP:
            return "far_ahead", False
        return "skip", True


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
    """Combine commands, in their order, into one: displacements are added, turns are chained."""
    if not commands:
        return None
    total = commands[0]
    for command in commands[1:]:
        arms = {}
        for arm, then in command["arms"].items():
            before = total["arms"][arm]
            arms[arm] = {
                "delta_um": [*map(operator.add, before["delta_um"], then["delta_um"])],
                "quat": list(turn_by(before["quat"], then["quat"])),
                "grasp_mrad": before["grasp_mrad"] + then["grasp_mrad"],
            }
        total = {**command, "arms": arms}
    return total


def packet_of(command: Increments, arms: Sequence[str], sequence: int) -> Packet:
    """Return the packet that the network hands to the robot, under another number."""
    tables = [command["arms"][arm] for arm in arms]
    return Packet(
        received=1,
        size=U_STRUCT.itemsize,
        sequence=sequence,
        delta=tuple(Vec(table["delta_um"]) for table in tables),
        quat=tuple(Vec(table["quat"]) for table in tables),
        grasp=tuple(table["grasp_mrad"] for table in tables),
        surgeon_mode=int(command["pedal"]),
    )
