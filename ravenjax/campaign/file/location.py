"""Reads TOML files, and finds the line of a key, which tomllib does not report."""

import dataclasses
import os
import re
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ravenjax import resources
from ravenjax.errors import UserError, format_value, suggest_name

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(
    r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*="""
)
_PART = re.compile(r""""([^"]*)"|'([^']*)'|([A-Za-z0-9_-]+)""")

SUFFIX = ".toml"
Key = tuple[str | int, ...]
Complaint = tuple[Key, str]
"""A key of a file, and a message about a mistake."""

MAX_PRINTED_MISTAKES = 12
"""Number of mistakes that are printed; further mistakes are only counted."""


def find_campaign_file(path: str | Path, folder: str, what: str, listing: str = "") -> Path:
    """Return the file that `path` names: a path, a file in ./`folder`, or a bundled file. The
    ending `.toml` may be left out. what: kind of file, such as "campaign". listing: command that
    lists the bundled files; if "", the error lists them. Raise UserError if there is no file.
    """
    name = require_path(what, path, f"a {what} file or the name of a bundled {what}")
    # A path such as "." has no last part, so no ending can be added.
    candidates = [name, name.with_name(name.name + SUFFIX)] if name.name else []
    for candidate in candidates:
        try:
            return resources.find_resource(folder, candidate)
        except FileNotFoundError:
            continue
        except OSError as error:
            reason = error.strerror
            raise UserError(f"{format_value(str(path))}: cannot be read ({reason})") from None
    names = [file.stem for file in resources.list_resources(folder, f"*{SUFFIX}")]
    problem = f"is a folder, expected a {what} file" if name.is_dir() else f"no such {what} file"
    others = f"bundled files are {', '.join(names) or 'none'}"
    if listing:
        others = f"`{listing}` lists the bundled files"
    hint = suggest_name(name.name.removesuffix(SUFFIX), names)
    raise UserError(f"{path}: {problem}; {others}{hint}")


def require_path(name: str, value: Any, kind: str) -> Path:
    """Return the value of argument `name` as a path. kind: kind of file, for the message. Raise
    UserError for a value that is no path.
    """
    if not isinstance(value, str | os.PathLike) or not str(value):
        raise UserError(f"{name} is {format_value(value)}, expected the path of {kind}")
    return Path(value)


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return the tables of a TOML file, and its text. Raise UserError if it is not valid."""
    try:
        # Some editors write a byte order mark at the beginning.
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {error}. Expected a TOML file in UTF-8") from None
    return parse_toml(text, str(path)), text


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML text. name: its file, for the message of UserError."""
    try:
        return tomllib.loads(text)
    # tomllib also raises ValueError for a number with thousands of digits.
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name}: not valid TOML: {error}") from None


def format_key(key: Key) -> str:
    """Return a key as text: ("group", 0, "fault", 1, "site") as `group[0].fault[1].site`. Dots may
    also come from a part that contains dots, such as the path of a parameter.
    """
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        # Pydantic's keys may contain a type, such as list[str], which is no key of the file.
        elif "[" not in part:
            text += f".{part}" if text else part
    return text


def key_lines(text: str) -> dict[str, int]:
    """Return the line number, from 1, of each table header and key of a TOML text. Keys have the
    form of `format_key`. Keys inside inline tables and multi-line strings have no line; use
    `nearest_line` for these.
    """
    numbers = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _key_of_header(_split_key(header[2]), header[1] == "[[", counts)
            numbers.setdefault(format_key(table), number)
            # The array as a whole has the line of its first entry.
            if header[1] == "[[":
                numbers.setdefault(format_key(table[:-1]), number)
        elif key := _KEY.match(line):
            numbers.setdefault(format_key((*table, *_split_key(key[1]))), number)
    return numbers


def nearest_line(found: dict[str, int], key: Key) -> int | None:
    """Return the line of `key`, or of the innermost table or key that contains it."""
    names = (format_key(key[:length]) for length in range(len(key), 0, -1))
    return next((found[name] for name in names if name in found), None)


def _split_key(dotted: str) -> Key:
    # Splits a dotted key at its dots, except those in quotes, and removes the quotes.
    return tuple(match[match.lastindex or 0] for match in _PART.finditer(dotted))


def _key_of_header(parts: Key, is_array: bool, counts: dict[Key, int]) -> Key:
    # Returns the key of the table whose header has these parts. A part that names an array means
    # its last entry so far. is_array: the header [[..]] begins a new entry. counts: index of the
    # last entry of each array, which is updated.
    key: Key = ()
    for i, part in enumerate(parts):
        key = (*key, part)
        if is_array and i == len(parts) - 1:
            counts[key] = counts.get(key, -1) + 1
        if key in counts:
            key = (*key, counts[key])
    return key


@dataclasses.dataclass
class Where:
    """Makes error messages that name the file and the line, or the override `--set`."""

    source: Path | None  # the campaign file
    lines: dict[str, int]  # line of each key, from `key_lines`
    replaced: Sequence[Key]  # keys of overrides
    # For each group after the expansion of hazards, the number of its group in the file.
    number_in_file: Sequence[int] = ()
    names: Sequence[str] = ()  # name of each group after the expansion
    groups: Sequence[Any] = ()  # the groups of the file

    def error(self, complaints: Iterable[Complaint]) -> UserError:
        """Return one error with all messages, in the order of the file, without repetitions."""
        unique = dict.fromkeys(self._locate_in_file(key, message) for key, message in complaints)
        in_order = sorted(unique, key=lambda complaint: nearest_line(self.lines, complaint[0]) or 0)
        rows = [
            f"{self._describe_place(key)}{format_key(key) or 'the file'}: {message}"
            for key, message in in_order
        ]
        text = "\n".join(rows[:MAX_PRINTED_MISTAKES])
        if len(rows) > MAX_PRINTED_MISTAKES:
            text += f"\n.. and {len(rows) - MAX_PRINTED_MISTAKES} more"
        return UserError(text)

    def _locate_in_file(self, key: Key, message: str) -> Complaint:
        # Returns a complaint with a key that is in the file. In `key`, `names` and `number_in_file`
        # a group that names hazards is already replaced by a group for each case. For a fault of
        # the hazard library, the new key is one of the group that names the hazard.
        match key:
            case ("group", int(number), *rest) if number < len(self.number_in_file):
                number_in_file = self.number_in_file[number]
            case _:
                return key, message
        group = self.groups[number_in_file]
        if "hazards" not in group or rest[:1] != ["fault"]:
            return ("group", number_in_file, *rest), message
        # The group may replace a key of the hazard's fault.
        if rest[-1] in group:
            return ("group", number_in_file, rest[-1]), message
        hazard = self.names[number].rpartition("/")[2]
        message = f"{hazard}, {format_key(tuple(rest))}: {message}"
        return ("group", number_in_file, "hazards"), message

    def _describe_place(self, key: Key) -> str:
        # Returns where a key was written: `--set`, or file and line; "" for tables from Python.
        text, override_keys = format_key(key), [format_key(key) for key in self.replaced]
        is_in_override = any(text.startswith(other) for other in override_keys)
        # An override of an inner key may create a table that the file does not have.
        inner_keys = (f"{text}.", f"{text}[")
        is_created = any(other.startswith(inner_keys) for other in override_keys)
        if is_in_override or (is_created and text not in self.lines):
            return "--set: "
        if self.source is None:
            return ""
        line = nearest_line(self.lines, key)
        return f"{self.source}:{line}: " if line else f"{self.source}: "
