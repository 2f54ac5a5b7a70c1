"""Writes the tables of a campaign as the text of a TOML file."""

from collections.abc import Mapping
from typing import Any

from ravenjax.campaign.file.group import PATHS, flatten_table

_ARRAYS = {"group", "detector", "check", "harm", "fault", "run"}
"""Keys of arrays of tables. Each table gets a header such as [[group]]."""


def format_toml(content: Mapping[str, Any]) -> str:
    """Return the text of a TOML file with these tables. Keys that are None are left out. Raise
    ValueError or TypeError for values that TOML cannot represent.
    """
    import tomlkit

    return _fill_table(tomlkit.document(), content, with_headers=True).as_string()


def _fill_table(table, content: Mapping[str, Any], with_headers: bool = False) -> Any:
    # Fills a table of tomlkit with this content, and returns the table. with_headers: each inner
    # table gets a header such as [haptics], and is not written inline.
    import tomlkit

    for key, value in content.items():
        if value is not None:
            table.append(tomlkit.key(key), _make_item(key, value, with_headers))
    return table


def _make_item(key: str, value, with_header: bool = False) -> Any:
    # Converts the value of a key to an item of tomlkit. Nested tables are written inline, except
    # parameters, whose paths would be hard to read.
    import tomlkit

    if isinstance(value, Mapping):
        if key in PATHS:
            value = flatten_table(value)
        with_header = with_header or key in PATHS
        return _fill_table(tomlkit.table() if with_header else tomlkit.inline_table(), value)
    if not isinstance(value, list):
        return tomlkit.item(value)
    has_tables = key in _ARRAYS and all(isinstance(inner, Mapping) for inner in value)
    # An empty list has no table that could get a header.
    is_array_of_tables = has_tables and bool(value)
    array = tomlkit.aot() if is_array_of_tables else tomlkit.array()
    for inner in value:
        array.append(_make_item("", inner, with_header=is_array_of_tables))
    return array
