"""Which groups of a campaign draw their faults. The others enumerate fixed values: nothing is sampled there."""

from __future__ import annotations

from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Group


def groups(config: CampaignConfig) -> frozenset[str]:
    """Names of the groups each of whose faults has something that was drawn, be it the onset alone.

    Drawn parameters of the robot or the operator do not count: they make no other fault.
    """
    return frozenset(group.name for group in config.group if _draws(config, group))


def _draws(config: CampaignConfig, group: Group) -> bool:
    sampled = group.design in SAMPLED
    return bool(group.fault or group.run) and all(
        any(slot >= 0 and (axis.drawn or (sampled and axis.kind != "fixed")) for (slot, _), axis in axes.items())
        for _, axes in design.faults_and_axes(config, group)
    )
