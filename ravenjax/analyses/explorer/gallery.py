"""Writes pages of several campaigns into one folder, with an index page."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from ravenjax import resources
from ravenjax.analyses.explorer import page
from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError
from ravenjax.store import files

INDEX = "index.html"


@dataclasses.dataclass(frozen=True)
class Card:
    """An entry of the index: the file name of a campaign's page, or the reason why it has none."""

    campaign: str
    robot: str
    description: str
    duration_ms: int
    file: str = ""
    reason: str = ""


def build_gallery(folder: Path, sources: Sequence[str | Path] = ()) -> list[Card]:
    """Write the pages of campaigns and an index page. Return the entries of the index.

    sources: campaign files or names; empty: all bundled campaigns. The entry of a campaign
    without a page has the reason. Raises UserError for a source that is not a campaign, for two
    campaigns of the same name, and if no campaign can have a page.
    """
    configs = [
        loading.load_campaign(source, runs=False)
        for source in sources or resources.list_resources("campaigns", "*.toml")
    ]
    names = [config.campaign.name for config in configs]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise UserError(
            f"more than one campaign has the name {', '.join(repeated)}: the pages of a gallery"
            " need different names; leave out all but one"
        )
    folder.mkdir(parents=True, exist_ok=True)
    cards = [_write_page(config, folder) for config in configs]
    if not any(card.file for card in cards):
        reasons = "; ".join(f"{card.campaign}: {card.reason}" for card in cards)
        raise UserError(f"no web page can be made of any of these campaigns: {reasons}")
    files.write_text(folder / INDEX, page.fill("index.html.j2", cards=cards))
    return cards


def _write_page(config: CampaignConfig, folder: Path) -> Card:
    # Writes the page of a campaign, if it can have one. Returns its entry of the index.
    campaign, file, reason = config.campaign, f"{config.campaign.name}.html", ""
    try:
        files.write_text(folder / file, page.render_page(config))
    except UserError as error:
        file, reason = "", str(error)
    return Card(
        campaign=campaign.name,
        robot=config.robot.title,
        description=campaign.description,
        duration_ms=round(1000 * campaign.duration_s),
        file=file,
        reason=reason,
    )
