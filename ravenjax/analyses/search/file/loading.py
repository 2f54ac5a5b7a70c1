"""Reads a search file: a campaign file with a section [search] and exactly one group.

The search varies the faults of this group. `ravenjax.campaign.loading` reads the other sections.
One error reports all mistakes of the file.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ravenjax.analyses.search.file import template
from ravenjax.analyses.search.file.config import KINDS, Search, SearchConfig
from ravenjax.campaign import loading
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.file.location import Complaint
from ravenjax.errors import UserError, format_error, format_value, suggest_name

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
    """Return the search of nested tables as in a TOML file.

    `source`, `text`: the file and its text, for error messages. Raise UserError for mistakes.
    """
    search_overrides = []
    campaign_overrides = []
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
    search, complaints = _parse_section(raw)
    if campaign is not None:
        complaints += template.find_search_errors(campaign, search)
    if complaints:
        messages.append(str(where.error(complaints)))
    if campaign is None or search is None or messages:
        raise UserError("\n".join(messages))
    return SearchConfig(campaign, search)


def _parse_section(raw: dict[str, Any]) -> tuple[Search | None, list[Complaint]]:
    # Returns the section [search], or None and its mistakes.
    table = raw.get(SECTION)
    kind = table.get("kind") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        got = "missing" if kind is None else f"got {format_value(kind)}"
        expected = f"{', '.join(KINDS)}{suggest_name(kind, KINDS)}"
        message = f"{got}: write a section [search] with the key kind, one of {expected}"
        return None, [((SECTION, "kind"), message)]
    try:
        return KINDS[kind].model_validate(table), []
    except ValidationError as error:
        return None, [
            ((SECTION, *mistake["loc"]), format_error(mistake, KINDS[kind]))
            for mistake in error.errors()
        ]
