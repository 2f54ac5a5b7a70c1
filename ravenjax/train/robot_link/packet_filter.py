"""Checks each datagram of a console before anything moves.

In this order, and each refusal is counted under its cause:

1. size: shorter than 124 bytes is dropped, longer is cut, as the robot does (raven2: network_layer.cpp);
2. one console at a time: whose stream is followed, until it has been silent for `RELEASE_MS`;
3. content, as the console's profile has it: pedal 0 or 1, the checksum right, orientations finite and of their form,
   increments within the profile's largest after conversion. The robot itself checks none of that. What is refused so
   far is as if it had never arrived;
4. sequence: the robot's own rules (`raven2.stages.network`): the number after the last is taken, a gap loses the
   packet after it too, 0 and repeated numbers are dropped, and a stream begins at 1, or loses its first packet. But
   stricter, for the robot would follow a replayed stream: going back means a restart only at number 1, only from a
   console that has been quiet for `QUIET_MS`, and the packet that restarts is lost; a leap further than
   `RESET_GAP` ahead is dropped. After `RELEASE_MS` of silence any stream may begin.

Where the profile is to be found (`store.consoles`, "auto"), packets that profiles read differently
are "undecided" until one profile is left: the stream goes on over them, and nothing moves.

No protocol without a secret can tell a recorded stream from a console that starts: bind loopback or
name the console's address (`only_host`) where others share the network.
"""  # noqa: E501

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.choice import UNDECIDED, ProfileChoice, fitting
from ravenjax.robots.raven2.console.reading import FIELDS, MODE, Misfit
from ravenjax.robots.raven2.stages.network import RESET_GAP
from ravenjax.store.consoles import loading as consoles
from ravenjax.train.robot import U_STRUCT, ArmName, ConsoleProfile, Packet, turn_by
from ravenjax.vocabulary.packets import QUIET_MS, RELEASE_MS

SIZE = FIELDS.size
_LAST = 2**32 - 1

TAKEN = "accepted"
CAUSES = (
    TAKEN,
    "short",  # less than 124 bytes
    "stranger",  # another console's stream is followed, or its address is not the one named
    "mode",  # surgeon_mode is neither 0 nor 1
    "checksum",
    "buttons",  # not the jaw again, where the console sends it twice
    "step",  # displacement above the limit
    "quaternion",  # not finite, or not of the profile's form
    "turn",  # rotation above the limit
    "grasp",  # jaw increment above the limit, or a position out of range
    UNDECIDED,  # profiles that the console may have read it differently
    "zero",  # number 0 is reserved
    "duplicate",  # the last number again
    "behind",  # reordered or replayed
    "far_ahead",  # too far for a gap
    "skip",  # a gap: the stream goes on after this packet, which is lost as well
    "restart",  # number 1 of a console that was quiet: the stream goes on after this packet
)
"""What becomes of a datagram: each is counted under exactly one of these."""


Increments = dict[str, Any]
"""A command "increments" of `protocol.messages`: the pedal, and in the ITP frame, of each arm,
`delta_um`, `quat` (x, y, z, w) and `grasp_mrad` (positive closes).
"""

KEPT_MISFITS, MISFIT_SHARE = 32, 0.02
"""After so many packets that break the profile's rules the gate says which other one they fit.
Where they fit none it says so, if they are such a share of all."""


class Gate:
    """Judges datagrams one by one; no sockets, no clock."""

    def __init__(
        self,
        arms: Sequence[ArmName],
        profiles: Sequence[ConsoleProfile] = (),
        only_host: str | None = None,
    ) -> None:
        """arms: those whose fields are read; an arm that is not there may have any.

        profiles: that of the console, or several of which it has one; none: the robot's own
        protocol. only_host: the only address that may send; None: any.
        """
        self._only_host = only_host
        self.counts: dict[str, int] = dict.fromkeys(CAUSES, 0)
        self._arms = tuple(arms)
        self._choice = ProfileChoice(profiles or (consoles.load("raven"),), arms)
        self._open = len(self._choice.readers) > 1  # packets have yet to decide
        self._misfits: deque[Sequence] = deque(maxlen=KEPT_MISFITS)
        self._misfit_count, self._advised = 0, False
        self._news: list[str] = []
        self._peer: tuple | None = None
        self._last = 0  # number at which the stream stands; 0: none yet
        self._heard_ms = -math.inf  # when the stream last went on

    @property
    def received(self) -> int:
        """Datagrams so far."""
        return sum(self.counts.values())

    def peer(self, now_ms: float) -> tuple | None:
        """Source address of the console that is followed; None: none."""
        if self._peer is not None and now_ms - self._heard_ms > RELEASE_MS:
            self._peer, self._last = None, 0
            self._choice.begin()
        return self._peer

    @property
    def profile(self) -> ConsoleProfile | None:
        """What packets are read as; None while it is not decided."""
        return self._choice.profile

    def news(self) -> list[str]:
        """What a user should be told since the last call: which profile was found, or which one
        would fit.
        """
        news, self._news = self._news, []
        return news

    def admit(self, datagram: bytes, source: tuple, now_ms: float) -> Increments | None:
        """What is asked of the robot, None where the datagram is refused.

        source: (host, port, ...) of the sender. now_ms: monotonic.
        """
        increments, cause = self._judged(datagram, source, now_ms)
        self.counts[cause] += 1
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
                self._news.append(
                    f"console: profile {profile.name}, {profile.title}. {self._choice.reason}"
                )
        if cause != TAKEN or isinstance(reading, Misfit):
            return None, cause
        tables = dict(zip(self._arms, zip(*reading, strict=True), strict=True))
        return increments_of(bool(fields[MODE]), tables, "itp"), TAKEN

    def _note(self, fields: Sequence, misfit: Misfit) -> None:
        """Say once that the profile is not the console's, and which one is, when it shows."""
        self._misfits.append(fields)
        self._misfit_count += 1
        if self._advised or self._misfit_count % KEPT_MISFITS:
            return
        profile = self._choice.profile
        others = [one for one in consoles.bundled() if one != profile]
        fits = fitting(self._misfits, others, self._arms) if profile else ""
        if not fits and self._misfit_count < MISFIT_SHARE * self.received:
            return
        self._advised = True
        under = f"profile {profile.name}" if profile else "any profile"
        words = (
            f"console: {self._misfit_count} of {self.received + 1} packets do not fit {under}, the"
            f" last for {misfit}"
        )
        self._news.append(
            f"{words}. They fit {fits}: start again with --console {fits}"
            if fits
            else (
                f"{words}. No bundled profile fits them: write one, and start again with --console"
                " FILE.toml"
            )
        )

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
            restarts = number == 1 and now_ms - self._heard_ms > QUIET_MS
            return ("restart", True) if restarts else ("behind", False)
        if last and number - last > RESET_GAP:
            return "far_ahead", False
        return "skip", True


def increments_of(pedal: bool, tables: Mapping[ArmName, Sequence[Any]], source: str) -> Increments:
    """The command; tables: displacement, turn and jaw increment of each arm."""
    return {
        "type": "increments",
        "source": source,
        "pedal": pedal,
        "arms": {
            arm: {"delta_um": list(delta), "quat": list(quat), "grasp_mrad": grasp}
            for arm, (delta, quat, grasp) in tables.items()
        },
    }


def merge(commands: Sequence[Increments]) -> Increments | None:
    """All commands, in their order, as one: displacements add up, turns follow each other."""
    total = None
    for command in commands:
        if total is None:
            total = command
            continue
        arms = {}
        for arm, then in command["arms"].items():
            before = total["arms"][arm]
            deltas = zip(before["delta_um"], then["delta_um"], strict=True)
            arms[arm] = {
                "delta_um": [a + b for a, b in deltas],
                "quat": list(turn_by(before["quat"], then["quat"])),
                "grasp_mrad": before["grasp_mrad"] + then["grasp_mrad"],
            }
        total = {**command, "arms": arms}
    return total


def packet_of(command: Increments, arms: Sequence[str], sequence: int) -> Packet:
    """What the network hands to the robot, under another number."""
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
