"""Static types of `tables`, for editors and checkers: the text of `tables.pyi`, from the JSON
Schema of campaign files.

Words are those of the Raven-II, so that an editor completes them and a checker marks one that is
none.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from ravenjax import robots
from ravenjax.campaign.file.axis import FORMS, PHASE
from ravenjax.campaign.inspection import json_schema
from ravenjax.campaign.inspection.json_schema import Schema
from ravenjax.notebook.file_table import FileTable
from ravenjax.notebook.table_classes import CLASSES, SECTION, CampaignTable

COMMAND = "ravenjax reference --types ravenjax/notebook/tables.pyi"

_HEAD = f'''\
"""Static types of `tables`; a test holds them up to date.

Written by `{COMMAND}`.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias

from numpy.typing import NDArray

from ravenjax.notebook.axes import Form
from ravenjax.notebook.file_table import FileTable
'''
_PLAIN = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}
_ORDER = ("None", "Form", "Mapping", "NDArray", "Sequence")
"""What stands last in a union, the last first."""
_FEW = 4
"""Words up to which a type names them itself; more have a name."""


def text() -> str:
    """The whole file, in its formatting."""
    schema = json_schema.schema(robots.find(robots.DEFAULT))
    section = schema["properties"][SECTION]["$ref"].rpartition("/")[2]
    properties = {name: schema["$defs"][name]["properties"] for name in CLASSES}
    own = schema["$defs"][section]["properties"]
    properties[CampaignTable.__name__] = own | {
        key: node for key, node in schema["properties"].items() if key != SECTION
    }
    words: dict[str, str] = {}
    classes = [
        "\n".join(_class(kind, properties[name], words))
        for name, kind in [*CLASSES.items(), (CampaignTable.__name__, CampaignTable)]
    ]
    aliases = [_alias(name, literal) for literal, name in words.items()]
    return "\n".join([_HEAD, *aliases, "", *classes])


def _alias(name: str, literal: str) -> str:
    members = literal.removeprefix("Literal[").removesuffix("]").split(", ")
    return "\n".join([f"{name}: TypeAlias = Literal[", *(f"    {one}," for one in members), "]"])


def _class(kind: type[FileTable], properties: Schema, words: dict[str, str]) -> Iterator[str]:
    hints = {key: _hint(properties[key], key, words) for key in kind._names}
    yield f"class {kind.__name__}(FileTable):"
    yield _indented(f'"""{kind.__doc__}\n"""')
    yield "    def __init__("
    yield "        self,"
    yield "        *,"
    for key, hint in sorted(hints.items(), key=lambda item: item[0] not in kind._required):
        yield (
            f"        {key}: {hint},"
            if key in kind._required
            else f"        {key}: {_optional(hint)} = None,"
        )
    yield "    ) -> None: ..."
    for key in hints:
        yield "    @property"
        yield f"    def {key}(self) -> Any: ..."
    yield ""


def _indented(text: str) -> str:
    lines = [
        part
        for line in text.splitlines()
        for part in textwrap.wrap(line, 108, subsequent_indent="    ", break_long_words=False)
        or [""]
    ]
    return "\n".join(f"    {line}".rstrip() for line in lines)


def _optional(hint: str) -> str:
    return hint if hint.endswith("None") else f"{hint} | None"


def _hint(node: Schema, key: str, words: dict[str, str]) -> str:
    """The type of what may stand at a key."""
    members = list(dict.fromkeys(_members(node, key, words)))
    if "float" in members and "int" in members:
        members.remove("int")
    if any(one.startswith(("Sequence[float", "Sequence[int")) for one in members):
        members.append("NDArray[Any]")
    members.sort(
        key=lambda one: [-place for place, name in enumerate(_ORDER, 1) if one.startswith(name)]
    )
    return " | ".join(members)


def _members(node: Schema, key: str, words: dict[str, str]) -> Iterator[str]:
    if "anyOf" in node:
        for one in node["anyOf"]:
            yield from _members(one, key, words)
    elif "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        yield name if name in CLASSES else "Mapping[str, Any]"
    elif "const" in node:
        yield f"Literal[{_quoted(node['const'])}]"
    elif "enum" in node:
        yield _words(node["enum"], key, words)
    elif node.get("type") == "array":
        yield f"Sequence[{_item(node, key, words)}]"
    elif node.get("type") == "object":
        yield "Form" if {*node.get("properties", ())} & {*FORMS, PHASE} else "Mapping[str, Any]"
    elif node.get("format") == "path":
        yield from ("str", "PathLike[str]")
    else:
        kinds = node.get("type", [])
        yield from (_PLAIN[kind] for kind in ([kinds] if isinstance(kinds, str) else kinds))


def _item(node: Schema, key: str, words: dict[str, str]) -> str:
    inner = [node["items"]] if "items" in node else node.get("prefixItems", [{"type": "number"}])
    return " | ".join(
        dict.fromkeys(one for part in inner for one in _hint(part, key, words).split(" | "))
    )


def _words(options: list[Any], key: str, words: dict[str, str]) -> str:
    """A type of these words; where they are many, by a name."""
    literal = f"Literal[{', '.join(map(_quoted, options))}]"
    if len(options) <= _FEW:
        return literal
    name = key.title().replace("_", "")
    return words.setdefault(literal, f"{name}Words" if name in words.values() else name)


def _quoted(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)
