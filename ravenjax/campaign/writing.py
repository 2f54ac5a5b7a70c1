"""A campaign's tables as the text of a TOML file: a header a table, paths of parameters as
dotted keys.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ravenjax import robots
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import PATHS, flatten_parameters
from ravenjax.campaign.loading import ARRAYS, tables_of

if TYPE_CHECKING:
    from tomlkit.items import Table as TomlTable

_ARRAYS = {*ARRAYS, "fault", "run"}
"""Keys under which tables stand one by one, each with a header of its own."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def text(content: Mapping[str, Any]) -> str:
    """The text of a file that holds these tables; what is None is left out. ValueError or TypeError
    for what TOML cannot hold."""
    import tomlkit

    document = tomlkit.document()
    for key, value in _there(content):
        document.append(tomlkit.key(key), _item(key, value))
    return tomlkit.dumps(document)


def _there(content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    return ((key, value) for key, value in content.items() if value is not None)


def _item(key: str, value: Any, inline: bool = False) -> Any:
    """What stands at a key: an array of tables, a table, or a value; inline: within a run, whose
    faults are short.
    """
    import tomlkit

    if (
        key in _ARRAYS
        and not inline
        and isinstance(value, list)
        and value
        and all(map(_is_table, value))
    ):
        array = tomlkit.aot()
        for one in value:
            array.append(_table(one, inline=key == "run"))
        return array
    if key in PATHS and isinstance(value, Mapping):
        return _paths(value)
    if isinstance(value, Mapping) and not inline and key in _headed():
        return _table(value)
    return _value(value)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


@functools.cache
def _headed() -> frozenset[str]:
    """Keys whose table has a header; any other stands in place of a value."""
    return frozenset(
        path[-1] for path, _ in tables_of(config_class_of(robots.find(robots.DEFAULT))) if path
    )


def _table(content: Mapping[str, Any], inline: bool = False) -> TomlTable:
    """Values first: in TOML what follows the header of an inner table belongs to that."""
    import tomlkit
    from tomlkit.items import AoT
    from tomlkit.items import Table as TomlTable

    table, items = (
        tomlkit.table(),
        {key: _item(key, value, inline) for key, value in _there(content)},
    )
    for headed in (False, True):
        for key, item in items.items():
            if isinstance(item, TomlTable | AoT) == headed:
                table.append(tomlkit.key(key), item)
    return table


def _paths(content: Mapping[str, Any]) -> TomlTable:
    """Paths as dotted keys; in quotes where one is the beginning of another, which TOML has no
    other form for.
    """
    import tomlkit

    table = tomlkit.table()
    flat = flatten_parameters({"parameters": content})["parameters"]
    dotted = not _nested(flat) and all(
        _BARE.fullmatch(part) for path in flat for part in path.split(".")
    )
    for path, value in flat.items():
        table.append(
            tomlkit.key(path.split(".")) if dotted and "." in path else tomlkit.key(path),
            _value(value),
        )
    return table


def _nested(paths: Iterable[str]) -> bool:
    ordered = sorted(path.split(".") for path in paths)
    return any(after[: len(before)] == before for before, after in itertools.pairwise(ordered))


def _value(value: Any) -> Any:
    import tomlkit

    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        for key, one in _there(value):
            table.append(tomlkit.key(key), _value(one))
        return table
    if isinstance(value, list):
        array = tomlkit.array()
        for one in value:
            array.append(_value(one))
        return array
    return tomlkit.item(value)
