"""The Raven's own words of a campaign: whether tools, motions and keys of [campaign] exist and fit together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ravenjax.campaign.file.location import Complaint
from ravenjax.campaign.file.semantics import unknown
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.tools import TOOLS

if TYPE_CHECKING:
    from ravenjax.robots.raven2.campaign.config import RavenConfig


def complaints(config: RavenConfig) -> Iterator[Complaint]:
    """(key, message) of what is wrong."""
    campaign = config.campaign
    if campaign.tools is not None and len(campaign.tools) != len(campaign.arms):
        yield ("campaign", "tools"), f"got {len(campaign.tools)}, expected one per arm ({len(campaign.arms)})"
    if campaign.build == "dyn_sim" and campaign.software != "fork2015":
        yield ("campaign", "build"), "got 'dyn_sim', expected software = 'fork2015': only the 2015 fork was built so"
    if campaign.software == "fork2015" and campaign.policy != type(campaign).model_fields["policy"].default:
        yield ("campaign", "policy"), f"got {campaign.policy!r}, but the 2015 fork has no policy: remove the key"
    for tool in campaign.tools or ():
        if tool not in TOOLS:
            yield ("campaign", "tools"), unknown("tool", tool, TOOLS)
    operator = config.operator
    if operator.motion is not None and operator.motion not in MOTIONS:
        yield ("operator", "motion"), unknown("motion", operator.motion, MOTIONS)
    if operator.motion == "clutched" and campaign.console == "absolute":
        yield ("operator", "motion"), "got 'clutched', expected console = 'increments': an absolute one has no clutch"
