"""Writes the tables of a campaign as the text of a TOML file."""

from collections.abc import Mapping
from typing import Any

from ravenjax.campaign.file.group import PATHS, flatten_table
from ravenjax.campaign.loading import ARRAYS

_ARRAYS = {*ARRAYS, "fault", "run"}
"""Keys of arrays of tables. Each table gets a header such as [[group]]."""


def format_toml(content: Mapping[str, Any]) -> str:
    """Return the text of a TOML file with these tables. Keys that are None are left out.

    Raise ValueError or TypeError for values that TOML cannot represent.
    """
    import tomlkit

    return _filled(tomlkit.document(), content, headed=True).as_string()


def _filled(table, content: Mapping[str, Any], headed: bool = False) -> Any:
    """Fill a table with this content. headed: each inner table gets a header."""
    import tomlkit

    for key, value in content.items():
        if value is not None:
            table.append(tomlkit.key(key), _item(key, value, headed))
    return table


def _item(key: str, value, headed: bool = False) -> Any:
    # Nested tables are written inline, except parameters, whose paths would be hard to read.
    import tomlkit

    if isinstance(value, Mapping):
        if key in PATHS:
            value = flatten_table(value)
        headed = headed or key in PATHS
        return _filled(tomlkit.table() if headed else tomlkit.inline_table(), value)
    if not isinstance(value, list):
        return tomlkit.item(value)
    tables = key in _ARRAYS and value and all(isinstance(inner, Mapping) for inner in value)
    array = tomlkit.aot() if tables else tomlkit.array()
    for inner in value:
        array.append(_item("", inner, bool(tables)))
    return array
