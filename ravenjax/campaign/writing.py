"""Writes a campaign's tables as the text of a TOML file, with paths of parameters as keys."""

from collections.abc import Mapping
from typing import Any

from ravenjax.campaign.file.group import PATHS, flatten_parameters
from ravenjax.campaign.loading import ARRAYS

_ARRAYS = {*ARRAYS, "check", "fault", "run"}
"""Keys that hold arrays of tables, each table with its own header."""


def format_toml(content: Mapping[str, Any]) -> str:
    """Return the text of a file that holds these tables. Keys that are None are left out.

    Raises ValueError or TypeError for what TOML cannot hold.
    """
    import tomlkit

    document = tomlkit.document()
    for key, value in content.items():
        if value is not None:
            headed = isinstance(value, Mapping) and key not in PATHS
            document.append(tomlkit.key(key), _table(value) if headed else _item(key, value))
    return tomlkit.dumps(document)


def _table(content: Mapping[str, Any]) -> Any:
    """Return a table with a header.

    Values come first: in TOML what follows the header of an inner table belongs to that table.
    """
    import tomlkit
    from tomlkit.items import AoT, Table

    items = {key: _item(key, value) for key, value in content.items() if value is not None}
    table = tomlkit.table()
    for headed in (False, True):
        for key, item in items.items():
            if isinstance(item, Table | AoT) == headed:
                table.append(tomlkit.key(key), item)
    return table


def _item(key: str, value: Any) -> Any:
    import tomlkit

    if key in PATHS and isinstance(value, Mapping):
        table = tomlkit.table()
        for path, number in flatten_parameters({"parameters": value})["parameters"].items():
            table.append(tomlkit.key(path), _value(number))
        return table
    tables = isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value)
    if key in _ARRAYS and tables:
        array = tomlkit.aot()
        for content in value:
            array.append(_table(content))
        return array
    return _value(value)


def _value(value: Any) -> Any:
    import tomlkit

    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        for key, inner in value.items():
            if inner is not None:
                table.append(tomlkit.key(key), _value(inner))
        return table
    if isinstance(value, list):
        array = tomlkit.array()
        for inner in value:
            array.append(_value(inner))
        return array
    return tomlkit.item(value)
