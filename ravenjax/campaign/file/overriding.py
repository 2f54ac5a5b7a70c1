"""Changes values of a campaign file from the command line, as in `--set campaign.limit=100`."""

import tomllib
from collections.abc import Sequence
from typing import Any

from ravenjax.campaign.file.group import PATHS, flatten_table
from ravenjax.campaign.file.location import Key
from ravenjax.errors import UserError, format_value, suggest_name

MAX_PATH_KEYS = 24
"""Largest number of keys in the path of an override. Tables of a file are less deeply nested."""


def check_overrides(overrides: Sequence[str]) -> Sequence[str]:
    """Return the overrides. Raise UserError unless they are a list of texts."""
    if isinstance(overrides, str) or not all(isinstance(override, str) for override in overrides):
        raise UserError(
            f"overrides are {format_value(overrides)}, expected a list of texts such as"
            " ['campaign.seed=1']"
        )
    return overrides


def apply_overrides(
    raw: dict[str, Any], overrides: Sequence[str]
) -> tuple[dict[str, Any], list[Key]]:
    """Apply overrides `key.path=value` to the tables `raw`. Return the new tables, and the key of
    each override. A value is TOML or plain text. Entries of arrays have a number or a name. Raise
    UserError for an override that cannot be applied.
    """
    keys = []
    for override in check_overrides(overrides):
        path, equals, text = override.partition("=")
        parts = [part.strip() for part in path.strip().split(".")]
        if not equals or not all(parts) or len(parts) > MAX_PATH_KEYS:
            raise UserError(
                f"--set {override[:80]}: expected key.path=value with at most {MAX_PATH_KEYS} keys,"
                " such as campaign.duration_s=5 or group.0.runs=100"
            )
        try:
            value = tomllib.loads(f"x = {text}")["x"]
        except (ValueError, RecursionError):
            # A text without quotes is no TOML value, but is accepted here.
            value = text.strip()
        raw, key = _replace_value(raw, parts, value, override)
        keys.append(key)
    return raw, keys


def _replace_value(table, parts: list[str], value, override: str) -> tuple[Any, Key]:
    # Returns a copy of the table (or list) with `value` at the path `parts`, and this path as a
    # key, with indices of lists as numbers. override: the whole text, for messages.
    if not parts:
        return value, ()
    head, rest = parts[0], parts[1:]
    if isinstance(table, list):
        index = _find_entry(table, head, override)
        entry, key = _replace_value(table[index], rest, value, override)
        return [*table[:index], entry, *table[index + 1 :]], (index, *key)
    if not isinstance(table, dict):
        raise UserError(f"--set {override}: {format_value(table)} is a value without key {head!r}")
    # In a table of parameters, a whole path such as "plant.gold.friction" is one key.
    table = table | {name: flatten_table(table[name]) for name in PATHS if name in table}
    if head in PATHS and rest:
        rest = [".".join(rest)]
    entry, key = _replace_value(table.get(head, {}), rest, value, override)
    return {**table, head: entry}, (head, *key)


def _find_entry(table: list[Any], part: str, override: str) -> int:
    # Returns the index of an entry of a list. part: the entry's key `name`, or its index from 0.
    names = [entry.get("name") for entry in table if isinstance(entry, dict)]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(table):
        return int(part)
    # A name that is no text, which the check of the whole file refuses, is not suggested.
    texts = [name for name in names if isinstance(name, str)]
    others = f" or one of the names {', '.join(texts)}" if texts else ""
    hint = suggest_name(part, texts)
    expected = f"a number 0..{len(table) - 1}{others}{hint}"
    raise UserError(f"--set {override}: got {part!r}, expected {expected}")
