"""Reads a campaign file: TOML, then overrides, then `CampaignConfig`, then `semantics`. Nothing is compiled before.

All that is wrong is told at once, each complaint with file, line, key, what was got and what was expected.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from ravenjax import resources
from ravenjax.campaign import design, location, overriding, semantics
from ravenjax.campaign.config import CampaignConfig
from ravenjax.errors import UserError, shown, suggestion
from ravenjax.hazards import expansion

MOST_RUNS = 100_000_000
"""Rows of a fault table."""

SUFFIX = ".toml"


def load(path: str | Path, overrides: Sequence[str] = ()) -> CampaignConfig:
    """The campaign of a TOML file, or of a bundled one by name, with `key.path=value` overrides.

    `.toml` may be left out. A recorded operator's path is taken from the campaign file's folder. Raises UserError.
    """
    found = _found(path)
    raw, text = location.read(found)
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
    for override in overriding.listed(overrides):
        raw, key = overriding.applied(raw, override)
        replaced.append(key)
    where = location.Where(source, location.lines(text), replaced)
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


def _too_many(config: CampaignConfig) -> Iterable[location.Complaint]:
    whole = config.model_copy(update={"campaign": config.campaign.model_copy(update={"limit": None})})
    if (runs := design.count(whole)) > MOST_RUNS:
        yield ("group",), f"the groups make {shown(runs)} runs, expected at most {MOST_RUNS}"


def check_parameters(config: CampaignConfig, known: Iterable[str]) -> None:
    """UserError for a varied parameter whose path is not among `known`."""
    if wrong := list(semantics.unknown_parameters(config, known)):
        source = config.source
        text = source.read_text(encoding="utf-8") if source is not None and source.is_file() else ""
        raise location.Where(source, location.lines(text), []).error(wrong)


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
