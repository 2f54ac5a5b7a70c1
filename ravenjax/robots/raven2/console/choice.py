"""Finds out which of several packet formats (profiles) a console uses, while its packets arrive.

A profile is ruled out in two cases. In the first, more packets break its rules than chance
explains. In the second, the packets read by this profile would move the jaw farther than it can
move, although they break no rule of another profile. Until one profile is left, a packet causes
motion only if all remaining profiles read the packet in the same way. The choice is final.
"""

from collections.abc import Collection, Sequence
from operator import add

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import Misfit, PacketReader, PacketReading

MAX_CHANCE_MISFITS, MAX_CHANCE_SHARE = 3, 0.02
"""Largest number of packets that break a profile's rules by chance, and their largest share of the
packets that profiles read differently. A profile that exceeds both is ruled out.
"""
JAW_TRAVEL_MRAD = 1744.0
"""Travel of the jaw, from -10 to 90 degrees; raven2 `local_io.cpp`."""
UNDECIDED = "undecided"


class ProfileChoice:
    """Reads packets as `PacketReader` does, with the profile whose rules the packets follow."""

    def __init__(self, profiles: Sequence[ConsoleProfile], arms: Sequence[ArmName]):
        """Prepare the choice among `profiles`. A single profile is chosen at once. If all profiles
        refuse a packet, messages state the rule of the first profile.
        """
        self.readers = [PacketReader(profile, arms) for profile in profiles]
        self._arms = tuple(arms)
        self._last_misfits: dict[str, Misfit] = {}
        self.reason = ""  # why the profile was chosen, once packets have decided
        self._results: list[PacketReading | Misfit] = []
        self._restart()

    @property
    def profile(self) -> ConsoleProfile | None:
        """The chosen profile; None before the choice."""
        return self.readers[0].profile if len(self.readers) == 1 else None

    def begin_stream(self) -> None:
        """Begin another stream of packets. A profile that was chosen remains chosen."""
        for reader in self.readers:
            reader.begin_stream()
        self._restart()

    def read(self, fields: Sequence, is_next: bool = True) -> PacketReading | Misfit:
        """Return a packet's increments or the rule that it breaks (`Misfit`); rule UNDECIDED if the
        profiles differ. is_next: whether the packet follows the last packet of the stream.
        """
        if len(self.readers) == 1:
            return self.readers[0].read(fields, is_next)
        self._results = results = [reader.read(fields, is_next) for reader in self.readers]
        all_refuse = all(isinstance(result, Misfit) for result in results)
        if all_refuse or all(result == results[0] for result in results):
            return results[0]
        got = "packets that profiles read differently"
        return Misfit(UNDECIDED, "", got, "further packets to decide")

    def accept_packet(self) -> None:
        """Accept the packet that was read last as part of the stream and as evidence."""
        for reader in self.readers:
            reader.accept_packet()
        if len(self.readers) == 1:
            return
        self._packets += 1
        # Disputed are packets that profiles read differently
        self._disputed_packets += any(result != self._results[0] for result in self._results)
        for reader, result in zip(self.readers, self._results, strict=True):
            name = reader.profile.name
            if isinstance(result, Misfit):
                self._misfits[name] += 1
                self._last_misfits[name] = result
            elif reader.profile.jaw.form == "increments":
                self._travel[name] = list(map(add, self._travel[name], result.grasp_mrad))
        ruled_out = {
            reader.profile.name: reason
            for reader in self.readers
            if (reason := self._complaint(reader.profile.name))
        }
        remaining = [reader for reader in self.readers if reader.profile.name not in ruled_out]
        if not remaining:  # the console follows no profile, so the evidence is worthless
            self._restart()
        elif ruled_out:
            self.readers = remaining
            self.reason = "; ".join(f"Not profile {name}: {why}" for name, why in ruled_out.items())

    def _complaint(self, name: str) -> str:
        """Return why packets rule out a profile: too many break its rules, or it would move the jaw
        too far while another profile fits all packets. Returns "" if they do not rule it out.
        """
        count = self._misfits[name]
        if count > max(MAX_CHANCE_MISFITS, MAX_CHANCE_SHARE * self._disputed_packets):
            return f"{count} of the first {self._packets} packets have {self._last_misfits[name]}"
        another_fits = any(n == 0 for other, n in self._misfits.items() if other != name)
        for arm, travel in zip(self._arms, self._travel[name], strict=True):
            if another_fits and abs(travel) > JAW_TRAVEL_MRAD:
                return (
                    f"the first {self._packets} packets would move the jaw of {arm} by {travel}"
                    f" mrad, more than its travel of {JAW_TRAVEL_MRAD:g} mrad"
                )
        return ""

    def _restart(self):
        # Forgets all evidence about the profiles.
        names = [reader.profile.name for reader in self.readers]
        self._misfits = dict.fromkeys(names, 0)
        # Numbers of packets of the stream, and of packets that profiles read differently
        self._packets = self._disputed_packets = 0
        # Sums of the jaw increments of each arm, by profile, mrad
        self._travel = {name: [0] * len(self._arms) for name in names}


def matching_profile(
    packets: Collection[Sequence], profiles: Sequence[ConsoleProfile], arms: Sequence[ArmName]
) -> str:
    """Return the name of the first profile whose rules 90 % of the packets follow; "" if none.
    packets: the fields of each packet. Rules about consecutive packets are not checked.
    """
    for profile in profiles:
        reader = PacketReader(profile, arms)
        results = (reader.read(fields, is_next=False) for fields in packets)
        fits = sum(isinstance(result, PacketReading) for result in results)
        if packets and fits >= 0.9 * len(packets):
            return profile.name
    return ""
