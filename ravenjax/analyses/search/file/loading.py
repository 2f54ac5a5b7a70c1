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
    of_search: list[str] = []
    of_campaign: list[str] = []
    for override in overriding.check_overrides(overrides):
        section = override.partition("=")[0].partition(".")[0].strip()
        (of_search if section == SECTION else of_campaign).append(override)
    raw, replaced = overriding.all_applied(raw, of_search)
    where = location.Where(source, location.key_lines(text), replaced)
    messages: list[str] = []
    campaign = None
    try:
        campaign = loading.from_dict(
            {k: v for k, v in raw.items() if k != SECTION}, source, text, of_campaign
        )
    except UserError as error:
        messages.append(str(error))
    search, complaints = _section(raw)
    if campaign is not None:
        complaints += template.find_search_errors(campaign, search)
    if complaints:
        messages.append(str(where.error(complaints)))
    if campaign is None or search is None or messages:
        raise UserError("\n".join(messages))
    return SearchConfig(campaign, search)


def _section(raw: dict[str, Any]) -> tuple[Search | None, list[Complaint]]:
    # Checks the section [search] with the model of its kind. Returns the search, or its mistakes.
    table = raw.get(SECTION)
    kind = table.get("kind") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        got = "missing" if kind is None else f"got {format_value(kind)}"
        expected = f"{', '.join(KINDS)}{suggest_name(kind, KINDS)}"
        return None, [
            (
                (SECTION, "kind"),
                f"{got}: write a section [search] with the key kind, one of {expected}",
            )
        ]
    try:
        return KINDS[kind].model_validate(table), []
    except ValidationError as error:
        return None, [
            ((SECTION, *one["loc"]), format_error(one, KINDS[kind])) for one in error.errors()
        ]
