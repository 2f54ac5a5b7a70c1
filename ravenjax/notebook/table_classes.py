"""The tables of a campaign file as classes, one for each model that a file is checked with:
`Group`, `Fault`, ..

What keys there are, what they mean and which may be left out is read from the models, so that there
is one definition. `tables` has the classes by name.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from ravenjax import robots
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import Group as GroupModel
from ravenjax.campaign.loading import header, models_in, tables_of
from ravenjax.campaign.population import KEY as FROM
from ravenjax.hazards import expansion
from ravenjax.notebook.file_table import FileTable, rooted

SECTION = "campaign"
"""The table whose keys are a campaign's own."""
HOME = "ravenjax.notebook.tables"
"""Where the classes are found by name."""


def names(model: type[BaseModel]) -> dict[str, str]:
    """Keys of a table and what they mean; of a group also those with which it names hazards."""
    own = {
        key: field.description or _inner_sentence(field.annotation)
        for key, field in model.model_fields.items()
    }
    if not issubclass(model, GroupModel):
        return own
    named = {
        key: f"of a group that names hazards: {text}"
        for key, text in expansion.KEYS.items()
        if key not in own
    }
    return own | named


def docstring(title: str, keys: dict[str, str]) -> str:
    """Of the class of a table."""
    return "\n".join([title, "", *(f"{key}: {meaning}" for key, meaning in keys.items())])


def _inner_sentence(annotation: Any) -> str:
    """What a table inside a table is: the beginning of its own text."""
    for inner in models_in(annotation):
        return (inspect.getdoc(inner) or "").partition("\n")[0]
    return ""


def _names_files(annotation: Any) -> bool:
    return annotation is Path or any(map(_names_files, get_args(annotation)))


def _signature(keys: dict[str, str], required: frozenset[str]) -> inspect.Signature:
    """For completion while a notebook runs: required keys first."""
    defaults = {key: inspect.Parameter.empty if key in required else None for key in keys}
    order = sorted(keys, key=lambda key: key not in required)
    return inspect.Signature(
        [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=defaults[key])
            for key in order
        ]
    )


def _class(
    name: str,
    title: str,
    keys: dict[str, str],
    models: list[type[BaseModel]],
    base: type[FileTable] = FileTable,
) -> type[FileTable]:
    """A class of tables whose keys are those of these models."""
    fields = {
        key: field for model in models for key, field in model.model_fields.items() if key in keys
    }
    required = frozenset(key for key, field in fields.items() if field.is_required())
    inner = {
        key: CLASSES[table.__name__]
        for key, field in fields.items()
        for table in models_in(field.annotation)
        if table.__name__ in CLASSES
    }
    content = {
        "__doc__": docstring(title, keys),
        "__module__": HOME,
        "__signature__": _signature(keys, required),
        "_names": keys,
        "_required": required,
        "_inner": inner,
        "_files": tuple(key for key, field in fields.items() if _names_files(field.annotation)),
    }
    return type(name, (base,), content)


class _CampaignBase(FileTable):
    """A whole file: the keys of [campaign] beside its other tables."""

    def _rooted(self, key: str, value: Any, folder: Path) -> Any:
        if key == "parameters" and isinstance(value, dict) and FROM in value:
            return {**value, FROM: rooted(value[FROM], folder)}
        return super()._rooted(key, value, folder)


_WHOLE = config_class_of(robots.find(robots.DEFAULT))
CLASSES: dict[str, type[FileTable]] = {}
"""Name of a model -> its class: of every table of a file of the usual robot but [campaign],
inner ones first.
"""


def tables() -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    """(path, model) of each table that has a class of its own, in the order of the file."""
    yield from ((path, model) for path, model in tables_of(_WHOLE) if path and path != (SECTION,))


def campaign_keys() -> dict[str, str]:
    """Keys of a campaign and what they mean: those of [campaign], then the other tables."""
    section = next(models_in(_WHOLE.model_fields[SECTION].annotation))
    return names(section) | {key: text for key, text in names(_WHOLE).items() if key != SECTION}


for _path, _model in sorted(tables(), key=lambda table: -len(table[0])):
    CLASSES[_model.__name__] = _class(
        _model.__name__, f"A table {header(_path)} of a campaign.", names(_model), [_model]
    )

CampaignTable = _class(
    "CampaignTable",
    "A whole campaign file: the keys of [campaign], and its other tables.",
    campaign_keys(),
    [next(models_in(_WHOLE.model_fields[SECTION].annotation)), _WHOLE],
    _CampaignBase,
)
