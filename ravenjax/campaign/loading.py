"""Reads a campaign file: TOML, then overrides, then `CampaignConfig`, then `semantics`. Nothing is
compiled before.

All that is wrong is told at once, each complaint with file, line, key, what was got and what was
expected.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from ravenjax.campaign import lint, population
from ravenjax.campaign.faults import design
from ravenjax.campaign.file import bounds, location, overriding, semantics
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.config import CampaignConfig, config_class_of, robot_of
from ravenjax.campaign.file.section import model_at as _model
from ravenjax.campaign.file.section import models_in
from ravenjax.errors import UserError, shown, suggestion
from ravenjax.hazards import expansion
from ravenjax.vocabulary.robot import Robot


def load_campaign(
    campaign: str | Path | dict[str, Any], overrides: Sequence[str] = ()
) -> CampaignConfig:
    """A validated campaign from a TOML file, the name of a bundled one, or nested tables as TOML
    has them.

    overrides: `key.path=value`, as `--set` on the command line. Raises UserError that names what is
    wrong and where.
    """
    if isinstance(campaign, dict):
        return from_dict(campaign, overrides=overrides)
    return load(campaign, overrides)


def load(path: str | Path, overrides: Sequence[str] = ()) -> CampaignConfig:
    """The campaign of a TOML file, or of a bundled one by name, with `key.path=value` overrides.

    `.toml` may be left out. A recorded operator's path is taken from the campaign file's folder.
    Raises UserError.
    """
    file = location.find(path, "campaigns", "campaign", "ravenjax campaigns")
    raw, text = location.read(file)
    return from_dict(raw, source=file, text=text, overrides=overrides)


def from_dict(
    raw: dict[str, Any],
    source: Path | None = None,
    text: str = "",
    overrides: Sequence[str] = (),
    template: bool = False,
) -> CampaignConfig:
    """The campaign of nested tables as TOML has them, with overrides; `source` and `text` say where
    from.

    template: of a search, which draws from the distributions itself. Raises UserError.
    """
    raw, replaced = overriding.all_applied(raw, overrides)
    where = location.Where(source, location.lines(text), replaced)
    raw = population.with_population(raw, where, source)
    try:
        if isinstance(raw, dict):  # anything else is refused below
            groups = raw.get("group")
            raw, where.written = expansion.plain(raw)
            if where.written and isinstance(groups, list):
                where.groups, where.names = (
                    groups,
                    [_text(group.get("name")) for group in raw["group"]],
                )
    except expansion.WrongGroup as error:
        raise where.error([(error.key, error.message)]) from None
    try:
        robot = robot_of(raw)
    except UserError as error:
        raise where.error([(("campaign", "robot"), str(error))]) from None
    try:
        config = config_class_of(robot).model_validate(raw)
    except ValidationError as error:
        # a list is also called too short when its only entries are bad
        faults = [e for e in error.errors() if e["type"] != "too_short" or not e["input"]]
        raise where.error(
            _complaint(robot, e, raw) for e in faults if not _is_misspelt(e, faults)
        ) from None
    except RecursionError:
        raise UserError("the campaign's tables are nested too deeply to be read") from None
    config = config.with_files(Path.cwd()) if source is None else config.with_source(source)
    if (
        errors := list(semantics.complaints(config))
        or list(_wasted(config, template))
        or list(_too_many(config))
    ):
        raise where.error(errors)
    return config


def _is_misspelt(missing: Any, errors: Sequence[Any]) -> bool:
    """Whether a key is missing because another one was written for it, of which there is a
    complaint.
    """
    if missing["type"] != "missing":
        return False
    *table, key = missing["loc"]
    others = [
        e["loc"][-1]
        for e in errors
        if e["type"] == "extra_forbidden" and list(e["loc"][:-1]) == table
    ]
    return any(suggestion(other, (key,)) for other in others)


def _text(name: object) -> str:
    return name if isinstance(name, str) else shown(name)


def _wasted(config: CampaignConfig, template: bool) -> Iterator[location.Complaint]:
    yield from lint.complaints(config)
    if not template:
        yield from lint.drawn_once(config)


def _too_many(config: CampaignConfig) -> Iterable[location.Complaint]:
    if (runs := design.count(config)) > design.MOST_RUNS:
        yield ("group",), f"the groups make {shown(runs)} runs, expected at most {design.MOST_RUNS}"


def check_parameters(config: CampaignConfig, names: Iterable[str]) -> None:
    """UserError for a varied parameter whose path is not among `known`, or whose list reads like
    a vector.
    """
    if errors := list(semantics.unfit_parameters(config, names)):
        source = config.source
        text = source.read_text(encoding="utf-8") if source is not None and source.is_file() else ""
        raise location.Where(source, location.lines(text), []).error(errors)


def _complaint(robot: Robot, error: Any, raw: Any) -> location.Complaint:
    """A complaint of pydantic's. A table that is looked at as a whole names the key of what is
    wrong first.
    """
    key, message = _key(error["loc"], raw), _message(robot, error)
    name, colon, rest = message.partition(": ")
    if (
        error["type"] == "value_error"
        and colon
        and name in _model(config_class_of(robot), error["loc"]).model_fields
        and name not in key[-1:]
    ):
        return (*key, name), rest
    return key, message


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


def _message(robot: Robot, error: Any) -> str:
    model = config_class_of(robot)
    if error["type"] == "tuple_type":
        path = tuple(part for part in error["loc"] if isinstance(part, str))
        tables = isinstance(error["input"], dict) and path in dict(tables_of(model))
        what = (
            f"several: open each with [[{'.'.join(path)}]], in double brackets"
            if tables
            else "a list"
        )
        return f"got {'one table' if tables else shown(error['input'])}, expected {what}"
    table = error["loc"][:-1]
    hint = (
        _elsewhere(robot, str(error["loc"][-1]), table)
        if error["type"] == "extra_forbidden"
        else ""
    )
    return location.message(error, _model(model, table), hint)


def _elsewhere(robot: Robot, key: str, loc: Sequence[str | int]) -> str:
    """What to add for a key that is known in another table of the file; "" where there is none."""
    here = tuple(part for part in loc if isinstance(part, str))
    if _in_another_unit(key, _model(config_class_of(robot), loc).model_fields):
        return ""
    if not here and key == "search":
        return ". This is a search: start it with `ravenjax search`"
    if not here and key in {path.partition(".")[0] for path, _ in bounds.rows(robot)}:
        return f". Parameters stand in [parameters], as parameters.{key}..."
    tables = [
        path
        for path, table in tables_of(config_class_of(robot))
        if key in table.model_fields and path
    ]
    if not tables:
        return ""
    nearest = max(tables, key=lambda path: _shared(path, here))
    below = (
        f", above [[{'.'.join(here)}]]"
        if here[: len(nearest)] == nearest and here != nearest
        else ""
    )
    return f". {key} is a key of {header(nearest)}: write it there{below}"


def _in_another_unit(key: str, names: Iterable[str]) -> bool:
    """Whether `key` is one of the names but for its last word, as duration_s and duration_ms."""
    return any(name.rpartition("_")[0] in {key, key.rpartition("_")[0]} - {""} for name in names)


def _shared(one: Sequence[str], other: Sequence[str]) -> int:
    """How many first parts two paths share."""
    pairs = zip(one, other, strict=False)
    return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))


def tables_of(
    model: type[BaseModel], path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    """(path of the table, its model) of every table of a file, in order, the file itself first."""
    yield path, model
    own = [
        name for name in model.model_fields if not path and name not in CampaignConfig.model_fields
    ]
    # a robot's own tables stand where the file has them: after [campaign]
    for name in sorted(
        model.model_fields, key=lambda name: 0 if name == "campaign" else 1 if name in own else 2
    ):
        for inner in models_in(model.model_fields[name].annotation):
            if inner is not Axis:
                yield from tables_of(inner, (*path, name))


def header(path: tuple[str, ...]) -> str:
    """How a file opens the table at `path`: `[campaign]`, `[[group.fault]]`."""
    name = ".".join(path)
    return f"[[{name}]]" if path[0] in ARRAYS else f"[{name}]"


ARRAYS = ("group", "detector")
"""Tables that a file may have several of."""
