"""The report's page of a generated campaign."""

from __future__ import annotations

from pathlib import Path

from generated_campaigns import Campaign
from page_text import Node, parse

from ravenjax.report import page
from ravenjax.report.data.runs import Runs


def rendered(campaign: Campaign) -> Node:
    """The page without its charts, whose numbers have tests of their own."""
    runs = Runs.of(campaign.frame, campaign.manifest)
    try:
        return parse(page.render(runs, campaign.manifest, Path("out"))).without("figure")
    finally:
        runs.close()
