"""Which of several profiles a console's packets have, from the first of them on.

A profile is out once more packets break its rules than a stream may lose by chance, or once its jaw
increments add up to more than the jaw's whole travel while another profile has no complaint. Until
one is left, what all that are left read alike counts, and what they read differently moves nothing.
A choice is final.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import Misfit, PacketReader, PacketReading

CHANCE_COUNT, CHANCE_SHARE = 3, 0.02
"""So many misfits may be chance, and such a share of packets that profiles read differently: out
is what has more.
"""
JAW_TRAVEL_MRAD = 1744.0
"""-10 to 90 degrees; raven2 `local_io.cpp`."""
UNDECIDED = "undecided"


class ProfileChoice:
    """Reads as `PacketReader` does, under whichever profile it is."""

    def __init__(self, profiles: Sequence[ConsoleProfile], arms: Sequence[ArmName]) -> None:
        """profiles: one, which then is the choice, or several, in order of preference where a
        message must name one.
        """
        self.readers = [PacketReader(profile, arms) for profile in profiles]
        self._arms = tuple(arms)
        self._misfits: dict[str, int] = {}
        self._last: dict[str, Misfit] = {}
        self._travel: dict[str, list[int]] = {}
        self._packets = self._telling = (
            0  # of the stream so far, and those that profiles read differently
        )
        self.reason = ""  # why the profile is what it is, once packets have decided
        self._results: list[PacketReading | Misfit] = []
        self._restart()

    @property
    def profile(self) -> ConsoleProfile | None:
        """The profile, once there is one."""
        return self.readers[0].profile if len(self.readers) == 1 else None

    def begin(self) -> None:
        """Another stream begins. A choice stays."""
        for reader in self.readers:
            reader.begin()
        self._restart()

    def read(self, fields: Sequence, joined: bool = True) -> PacketReading | Misfit:
        """What a packet asks for; a `Misfit` of cause "undecided" where profiles do not read it
        alike.
        """
        if len(self.readers) == 1:
            return self.readers[0].read(fields, joined)
        self._results = results = [reader.read(fields, joined) for reader in self.readers]
        if all(result == results[0] for result in results) or all(
            isinstance(result, Misfit) for result in results
        ):
            return results[0]
        return Misfit(UNDECIDED, "", "packets that profiles read differently", "more of them")

    def follow(self) -> None:
        """The packet that was read last belongs to the stream: it is evidence, too."""
        for reader in self.readers:
            reader.follow()
        if len(self.readers) > 1:
            self._weigh()

    def _weigh(self) -> None:
        self._packets += 1
        self._telling += any(result != self._results[0] for result in self._results)
        for reader, result in zip(self.readers, self._results, strict=True):
            name = reader.profile.name
            if isinstance(result, Misfit):
                self._misfits[name] += 1
                self._last[name] = result
            elif reader.profile.jaw.form == "increments":
                self._travel[name] = [
                    a + b for a, b in zip(self._travel[name], result.grasp_mrad, strict=True)
                ]
        out = {
            reader.profile.name: why
            for reader in self.readers
            if (why := self._complaint(reader.profile.name))
        }
        left = [reader for reader in self.readers if reader.profile.name not in out]
        if not left:
            self._restart()
        elif out:
            self.readers = left
            self.reason = "; ".join(f"It is not {name}: {why}" for name, why in out.items())

    def _complaint(self, name: str) -> str:
        """What speaks against a profile; "" while it may be the one."""
        count = self._misfits[name]
        if count > max(CHANCE_COUNT, CHANCE_SHARE * self._telling):
            return f"{count} of the first {self._packets} packets have {self._last[name]}"
        others_fit = any(not n for other, n in self._misfits.items() if other != name)
        for arm, travel in zip(self._arms, self._travel[name], strict=True):
            if others_fit and abs(travel) > JAW_TRAVEL_MRAD:
                return (
                    f"the first {self._packets} packets would move the jaw of {arm} by {travel}"
                    " mrad, beyond its travel"
                )
        return ""

    def _restart(self) -> None:
        names = [reader.profile.name for reader in self.readers]
        self._misfits, self._packets, self._telling = dict.fromkeys(names, 0), 0, 0
        self._travel = {name: [0] * len(self._arms) for name in names}


def fitting(
    packets: Collection[Sequence], profiles: Sequence[ConsoleProfile], arms: Sequence[ArmName]
) -> str:
    """Name of the first profile that nine in ten packets (their fields) fit, each by itself; ""
    where none is.
    """
    for profile in profiles:
        reader = PacketReader(profile, arms)
        fits = sum(
            isinstance(reader.read(fields, joined=False), PacketReading) for fields in packets
        )
        if packets and fits >= 0.9 * len(packets):
            return profile.name
    return ""
