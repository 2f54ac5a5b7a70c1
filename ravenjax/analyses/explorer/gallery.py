"""Writes pages of several campaigns into one folder, with an index page."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from ravenjax.analyses.explorer import page
from ravenjax.bundled import resources
from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError
from ravenjax.store import files

INDEX = "index.html"


@dataclasses.dataclass(frozen=True)
class Card:
    """An entry of the index: a campaign and its page, or the reason why it has no page."""

    campaign: str
    robot: str
    description: str
    duration_ms: int
    file: str = ""
    reason: str = ""


def build_gallery(folder: Path, sources: Sequence[str | Path] = ()) -> list[Card]:
    """Write a page for each campaign file and an index page, and return the entries of the index.

    The default is all bundled campaigns. If a campaign cannot be simulated in a page, its entry has
    the reason. Raise UserError for a source that is not a campaign, for two campaigns with the same
    name, and if no page can be written.
    """
    configs = [
        loading.load_campaign(source, runs=False)
        for source in sources or resources.list_resources("campaigns", "*.toml")
    ]
    names = [config.campaign.name for config in configs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(
            f"two campaigns have the name {', '.join(twice)}, but each page of a gallery needs"
            " another name; leave one of the campaigns out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    cards = [_card(config, folder) for config in configs]
    if not any(card.file for card in cards):
        raise UserError(
            "no page can be written for any of these campaigns: "
            + "; ".join(f"{c.campaign}: {c.reason}" for c in cards)
        )
    files.write_text(folder / INDEX, page.fill("index.html.j2", cards=cards))
    return cards


def _card(config: CampaignConfig, folder: Path) -> Card:
    # Writes the page of one campaign and describes it; if no page is possible, it gives the reason.
    campaign, file, reason = config.campaign, f"{config.campaign.name}.html", ""
    try:
        files.write_text(folder / file, page.render_page(config))
    except UserError as error:
        file, reason = "", str(error)
    duration_ms = round(1000 * campaign.duration_s)
    title = config.robot.title
    return Card(campaign.name, title, campaign.description, duration_ms, file, reason)
