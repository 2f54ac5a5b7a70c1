"""What a Raven-II's campaign file must mean besides having the right types; as
`ravenjax.campaign.file.semantics`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ravenjax.campaign.file.location import Complaint
from ravenjax.campaign.file.semantics import parameter_tables, unknown
from ravenjax.robots.raven2.campaign import older_packets
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.tools import TOOLS
from ravenjax.vocabulary import packets

if TYPE_CHECKING:
    from ravenjax.robots.raven2.campaign.config import RavenConfig


def complaints(config: RavenConfig) -> Iterator[Complaint]:
    """(key, message) of what is wrong with the words of a file whose types are right."""
    yield from _campaign(config)
    yield from _operator(config)
    yield from _resent_packets(config)
    yield from _random_packets(config)


def _campaign(config: RavenConfig) -> Iterator[Complaint]:
    """Of [campaign]."""
    campaign = config.campaign
    if campaign.tools is not None and len(campaign.tools) != len(campaign.arms):
        yield (
            ("campaign", "tools"),
            f"got {len(campaign.tools)}, expected one per arm ({len(campaign.arms)})",
        )
    if campaign.build != "robot" and campaign.software != "fork2015":
        yield (
            ("campaign", "build"),
            (
                f"got {campaign.build!r}, expected software = 'fork2015': only the 2015 fork was"
                " built so"
            ),
        )
    if campaign.cables == "break" and not config.watches_cables:
        yield (
            ("campaign", "cables"),
            (
                "got 'break', but motors pull at the cables of parameter_set"
                f" {campaign.parameter_set!r} twelve times as hard as real ones can: take"
                " parameter_set = 'power_consistent'"
            ),
        )
    if (
        campaign.software == "fork2015"
        and campaign.policy != type(campaign).model_fields["policy"].default
    ):
        yield (
            ("campaign", "policy"),
            f"got {campaign.policy!r}, but the 2015 fork has no policy: remove the key",
        )
    for tool in campaign.tools or ():
        if tool not in TOOLS:
            yield ("campaign", "tools"), unknown("tool", tool, TOOLS)


def _operator(config: RavenConfig) -> Iterator[Complaint]:
    """Of [operator]."""
    operator = config.operator
    if operator.motion is not None and operator.motion not in MOTIONS:
        yield ("operator", "motion"), unknown("motion", operator.motion, MOTIONS)
    if operator.hands is not None and config.reaction is not None:
        yield (
            ("reaction",),
            (
                f"is how the built-in operator reacts, but operator.hands is {operator.hands}: let"
                " the file react (view.arms has the cue's force), and remove [reaction]; or remove"
                " operator.hands"
            ),
        )
    if operator.motion == "clutched" and config.campaign.console == "absolute":
        yield (
            ("operator", "motion"),
            "got 'clutched', expected console = 'increments': an absolute one has no clutch",
        )


def _resent_packets(config: RavenConfig) -> Iterator[Complaint]:
    """Packets of before are made anew from the plan, and what hands of one's own did then is not
    remembered.
    """
    for g, group in enumerate(config.group if config.operator.hands is not None else ()):
        if older_packets.age_ms((group,), 1) > 0:
            yield (
                ("group", g),
                (
                    "faults at site 'network' may send packets of before, which are made of the"
                    f" plan, but operator.hands is {config.operator.hands}, which may have done"
                    " otherwise: remove operator.hands, or let the faults lose packets (effect"
                    " 'drop', channels lost and bursts)"
                ),
            )


def _random_packets(config: RavenConfig) -> Iterator[Complaint]:
    """What does not go with packets whose length is drawn."""
    own = config.campaign.packet_choice == packets.OWN
    for key, table in parameter_tables(config):
        if (choice := table.get("network.packets")) and packets.OWN in choice.values and not own:
            yield (
                (*key, "network.packets"),
                (
                    f"got {packets.OWN}, which is the shares in campaign.packets, but there are"
                    " none: write them there"
                ),
            )
        if "network.cycles_per_packet" in table and config.random_packets:
            yield (
                (*key, "network.cycles_per_packet"),
                (
                    "nothing reads it where packets are drawn: remove it, or for n cycles a packet"
                    " write campaign.packets = [0, .., 1] with n numbers"
                ),
            )
    for g, group in enumerate(config.group if config.random_packets else ()):
        age = min(older_packets.age_ms((group,), config.longest_packet), config.campaign.ticks)
        if age > older_packets.LONGEST_MS:
            yield (
                ("group", g),
                (
                    f"faults at site 'network' may send packets of {age:.0f} ms ago, expected at"
                    f" most {older_packets.LONGEST_MS} where the lengths of packets are drawn: give"
                    " them smaller values, write a shorter campaign.duration_s, or"
                    ' campaign.packets = "every_cycle"'
                ),
            )
