"""Reads a campaign file: TOML, then overrides, then `CampaignConfig`, then `semantics`. Nothing is compiled before.

All that is wrong is told at once, each complaint with file, line, key, what was got and what was expected.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from ravenjax import resources
from ravenjax.campaign import design, location, semantics
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.group import flatten_parameters
from ravenjax.errors import UserError, shown, suggestion
from ravenjax.hazards import expansion

MOST_COMPLAINTS = 12
"""Complaints printed before the rest is only counted."""

MOST_RUNS = 100_000_000
"""Rows of a fault table."""

SUFFIX = ".toml"


def load(path: str | Path, overrides: Sequence[str] = ()) -> CampaignConfig:
    """The campaign of a TOML file, or of a bundled one by name, with `key.path=value` overrides.

    `.toml` may be left out. A recorded operator's path is taken from the campaign file's folder. Raises UserError.
    """
    found = _found(path)
    try:
        text = found.read_text(encoding="utf-8-sig")  # some editors put a byte order mark first
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{found}: cannot be read: {error}. Expected a TOML file in UTF-8") from None
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError also where a number has thousands of digits
        raise UserError(f"{found}: not valid TOML: {error}") from None
    return from_dict(raw, source=found, text=text, overrides=overrides)


def _found(path: str | Path) -> Path:
    """The file that `path` names: as it is, in ./campaigns, or a bundled one; .toml may be left out."""
    if not isinstance(path, str | os.PathLike) or not str(path):
        raise UserError(f"got {shown(path)}, expected the path of a campaign file or the name of a bundled campaign")
    name = Path(path)
    for candidate in (name, name.with_name(name.name + SUFFIX)) if name.name else ():
        try:
            return resources.campaign(candidate)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise UserError(f"{shown(str(path))}: cannot be read ({error.strerror})") from None
    bundled = [file.stem for file in resources.bundled("campaigns", f"*{SUFFIX}")]
    problem = "is a folder, expected a campaign file" if name.is_dir() else "no such campaign file"
    near = suggestion(name.name.removesuffix(SUFFIX), bundled)
    raise UserError(f"{path}: {problem}; `ravenjax campaigns` lists the bundled ones{near}")


def from_dict(
    raw: dict[str, Any], source: Path | None = None, text: str = "", overrides: Sequence[str] = ()
) -> CampaignConfig:
    """The campaign of nested tables as TOML has them, with overrides; `source` and `text` say where from.

    Raises UserError.
    """
    replaced = []
    for override in _listed(overrides):
        raw, key = _override(raw, override)
        replaced.append(key)
    where = _Where(source, location.lines(text), replaced)
    try:
        if isinstance(raw, dict):  # anything else is refused below
            raw, where.written = expansion.plain(raw)
    except expansion.WrongGroup as error:
        raise where.error([(error.key, error.message)]) from None
    try:
        config = CampaignConfig.model_validate(raw)
    except ValidationError as error:
        # a list is also called too short when its only entries are bad
        faults = [e for e in error.errors() if e["type"] != "too_short" or not e["input"]]
        raise where.error((_key(e["loc"], raw), _message(e)) for e in faults) from None
    except RecursionError:
        raise UserError("the campaign's tables are nested too deeply to be read") from None
    if wrong := list(semantics.complaints(config)) or list(_too_many(config)):
        raise where.error(wrong)
    return config if source is None else config.with_source(source)


def _listed(overrides: Sequence[str]) -> Sequence[str]:
    if isinstance(overrides, str) or not all(isinstance(override, str) for override in overrides):
        raise UserError(f"overrides are {shown(overrides)}, expected a list of texts such as ['campaign.seed=1']")
    return overrides


def _too_many(config: CampaignConfig) -> Iterable[semantics.Complaint]:
    whole = config.model_copy(update={"campaign": config.campaign.model_copy(update={"limit": None})})
    if (runs := design.count(whole)) > MOST_RUNS:
        yield ("group",), f"the groups make {shown(runs)} runs, expected at most {MOST_RUNS}"


def check_parameters(config: CampaignConfig, known: Iterable[str]) -> None:
    """UserError for a varied parameter whose path is not among `known`."""
    if wrong := list(semantics.unknown_parameters(config, known)):
        source = config.source
        text = source.read_text(encoding="utf-8") if source is not None and source.is_file() else ""
        raise _Where(source, location.lines(text), []).error(wrong)


class _Where:
    """Turns (key, message) into a line of an error."""

    def __init__(self, source: Path | None, lines: dict[str, int], replaced: Sequence[location.Key]) -> None:
        self.source, self.lines, self.replaced = source, lines, [location.dotted(key) for key in replaced]
        self.written: list[int] = []  # of each group, the number of the one in the file that it comes from

    def error(self, complaints: Iterable[semantics.Complaint]) -> UserError:
        found = dict.fromkeys((self._in_file(key), message) for key, message in complaints)
        in_order = sorted(found, key=lambda complaint: location.nearest(self.lines, complaint[0]) or 0)
        rows = [f"{self._place(key)}{location.dotted(key) or 'the file'}: {message}" for key, message in in_order]
        more = f"\n.. and {len(rows) - MOST_COMPLAINTS} more" if len(rows) > MOST_COMPLAINTS else ""
        return UserError("\n".join(rows[:MOST_COMPLAINTS]) + more)

    def _in_file(self, key: location.Key) -> location.Key:
        if len(key) > 1 and key[0] == "group" and isinstance(key[1], int) and key[1] < len(self.written):
            return ("group", self.written[key[1]], *key[2:])
        return key

    def _place(self, key: location.Key) -> str:
        if any(location.dotted(key).startswith(replaced) for replaced in self.replaced):
            return "--set: "
        if self.source is None:
            return ""
        line = location.nearest(self.lines, key)
        return f"{self.source}:{line}: " if line else f"{self.source}: "


def _key(loc: tuple[str | int, ...], raw: Any) -> location.Key:
    """The part of pydantic's `loc` that stands in the file."""
    key: location.Key = ()
    for part in loc:
        if isinstance(raw, dict):
            raw = raw.get(part)
        elif isinstance(raw, list | tuple) and isinstance(part, int):
            raw = raw[part] if part < len(raw) else None
        else:
            break
        key = (*key, part)
    return key


def _message(error: Any) -> str:
    if error["type"] == "extra_forbidden":
        known = _keys(error["loc"][:-1])
        return f"unknown key, expected one of {', '.join(known)}{suggestion(str(error['loc'][-1]), known)}"
    if error["type"] == "missing":
        field = _model(error["loc"][:-1]).model_fields.get(str(error["loc"][-1]))
        return "missing" + (f": {field.description}" if field is not None and field.description else "")
    text = error["msg"].removeprefix("Value error, ")
    if error["type"] == "value_error":
        return text
    return f"got {shown(error['input'])}, expected {text.removeprefix('Input should be ').replace('String', 'text')}"


def _model(loc: Sequence[str | int]) -> type[BaseModel]:
    """The model of the table at `loc`."""
    model: type[BaseModel] = CampaignConfig
    for part in loc:
        if isinstance(part, str) and part in model.model_fields:
            model = next(iter(_models(model.model_fields[part].annotation)), model)
    return model


def _keys(loc: Sequence[str | int]) -> list[str]:
    return list(_model(loc).model_fields)


def _models(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


# --- overrides --------------------------------------------------------------------------------------------------------


def _override(raw: dict[str, Any], override: str) -> tuple[dict[str, Any], location.Key]:
    """`raw` with `key.path=value` entered, and its key; the value is TOML, or text. Entries of arrays go by number or
    name."""
    path, equals, text = override.partition("=")
    parts = [part.strip() for part in path.strip().split(".")]
    if not equals or not all(parts):
        raise UserError(f"--set {override}: expected key.path=value, such as campaign.duration_s=5 or group.0.runs=100")
    try:
        value = tomllib.loads(f"x = {text}")["x"]
    except (ValueError, RecursionError):
        value = text.strip()
    return _entered(raw, parts, value, override)


def _entered(table: Any, parts: list[str], value: Any, override: str) -> tuple[Any, location.Key]:
    if not parts:
        return value, ()
    head, rest = parts[0], parts[1:]
    if isinstance(table, list):
        index = _index(table, head, override)
        entry, key = _entered(table[index], rest, value, override)
        return [*table[:index], entry, *table[index + 1 :]], (index, *key)
    if not isinstance(table, dict):
        raise UserError(f"--set {override}: {head!r} is no key of the value {shown(table)}")
    table = flatten_parameters(table)
    if head == "parameters" and rest:  # paths of parameters hold dots
        rest = [".".join(rest)]
    entry, key = _entered(table.get(head, {}), rest, value, override)
    return {**table, head: entry}, (head, *key)


def _index(table: list[Any], part: str, override: str) -> int:
    names = [entry.get("name") for entry in table if isinstance(entry, dict)]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(table):
        return int(part)
    expected = f"a number 0..{len(table) - 1}" + (f" or a name of {', '.join(map(str, names))}" if any(names) else "")
    raise UserError(f"--set {override}: got {part!r}, expected {expected}{suggestion(part, [str(n) for n in names])}")
