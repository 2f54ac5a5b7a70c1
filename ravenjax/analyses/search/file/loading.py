"""Reads a search file: a campaign file with a section [search] and exactly one group.

The search varies the faults of this group. `ravenjax.campaign.loading` reads the other sections.
One error reports all mistakes of the file.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax.analyses.search.file import template
from ravenjax.analyses.search.file.config import SearchConfig, SearchTable
from ravenjax.campaign import loading
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.file.section import parse
from ravenjax.errors import UserError

SECTION = "search"
FOLDER = "campaigns/searches"
"""Folder of the bundled search files."""


def load_search(path: str | Path, overrides: Sequence[str] = ()) -> SearchConfig:
    """Read a search from a TOML file, or a bundled search by name. Raise UserError for mistakes."""
    file = location.find_campaign_file(path, FOLDER, "search")
    raw, text = location.read_toml(file)
    return from_dict(raw, source=file, text=text, overrides=overrides)


def from_dict(
    raw: dict[str, Any], source: Path | None = None, text: str = "", overrides: Sequence[str] = ()
) -> SearchConfig:
    """Return the search of nested tables as in a TOML file. `source`, `text`: the file and its
    text, for error messages. Raise UserError for mistakes.
    """
    search_overrides, campaign_overrides = [], []
    for override in overriding.check_overrides(overrides):
        section = override.partition("=")[0].partition(".")[0].strip()
        if section == SECTION:
            search_overrides.append(override)
        else:
            campaign_overrides.append(override)
    raw, replaced = overriding.apply_overrides(raw, search_overrides)
    where = location.Where(source, location.key_lines(text), replaced)
    messages = []
    campaign = None
    try:
        campaign_tables = {name: table for name, table in raw.items() if name != SECTION}
        campaign = loading.from_dict(campaign_tables, source, text, campaign_overrides)
    except UserError as error:
        messages.append(str(error))
    tables, complaints = parse(SearchTable, {SECTION: raw[SECTION]} if SECTION in raw else {})
    search = tables and tables.search
    if campaign is not None:
        complaints += template.find_search_errors(campaign, search)
    if complaints:
        messages.append(str(where.error(complaints)))
    if campaign is None or search is None or messages:
        raise UserError("\n".join(messages))
    return SearchConfig(campaign, search)
