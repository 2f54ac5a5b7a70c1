"""On which line of a TOML file a key is written; tomllib does not say."""

from __future__ import annotations

import re

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")
_PART = re.compile(r""""([^"]*)"|'([^']*)'|([A-Za-z0-9_-]+)""")

Key = tuple[str | int, ...]


def dotted(key: Key) -> str:
    """`group[0].fault[1].site` of a key; a part that holds dots itself reads the same as nested tables."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def lines(text: str) -> dict[str, int]:
    """Line number, from 1, of each table header and key, by dotted key; entries of arrays of tables count from 0.

    Keys inside inline tables and within multi-line strings are not told apart: ask `nearest`.
    """
    found: dict[str, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _enter(_parts(header[2]), header[1] == "[[", counts)
            found.setdefault(dotted(table), number)
        elif key := _KEY.match(line):
            found.setdefault(dotted((*table, *_parts(key[1]))), number)
    return found


def nearest(found: dict[str, int], key: Key) -> int | None:
    """Line of `key`, or of the closest table or key around it."""
    for length in range(len(key), 0, -1):
        if dotted(key[:length]) in found:
            return found[dotted(key[:length])]
    return None


def _parts(dotted: str) -> Key:
    return tuple(next(group for group in match.groups() if group is not None) for match in _PART.finditer(dotted))


def _enter(parts: Key, array: bool, counts: dict[Key, int]) -> Key:
    """The key of the table that a header opens; a part that names an array of tables stands for its latest entry."""
    key: Key = ()
    for i, part in enumerate(parts):
        key = (*key, part)
        if array and i == len(parts) - 1:
            counts[key] = counts.get(key, -1) + 1
        if key in counts:
            key = (*key, counts[key])
    return key
