"""What a stop rule sees of a campaign: each group as a stratum of draws, and where they stand in
the fault table.
"""

from __future__ import annotations

from typing import NamedTuple

from ravenjax.campaign.faults import design, sampled_order
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.stats.sample_size.sequential import Sequential, Stratum


class Draws(NamedTuple):
    """The draws of one group in the fault table, as `sampled_order` puts them."""

    first: int  # row of the first
    number: int
    rows: int  # rows of each

    def range(self, taken: int) -> range:
        """Rows of the first `taken` draws."""
        return range(self.first, self.first + taken * self.rows)


def draws(config: CampaignConfig) -> tuple[Draws, ...]:
    """Of each group in the order of the table."""
    result, first = [], 0
    for group in config.group:
        rows = design.count(config.model_copy(update={"group": (group,)}))
        each = sampled_order.rows_of_a_draw(config, group)
        result.append(Draws(first, rows // each, each))
        first += rows
    return tuple(result)


def rule(config: CampaignConfig) -> Sequential:
    """The stop rule of a campaign that has one."""
    if (stop := config.stop) is None:
        raise ValueError(f"campaign {config.campaign.name!r} has no [stop] section")
    strata = tuple(
        Stratum(group.name, of.number, bool(group.fault))
        for group, of in zip(config.group, draws(config), strict=True)
    )
    return Sequential(
        strata, stop.rates, stop.half_width, stop.looks, stop.confidence, stop.of, stop.allocation
    )
