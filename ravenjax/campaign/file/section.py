"""Defines the base class of all tables of a campaign file, a pydantic model."""

import dataclasses
import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import core_schema

from ravenjax.campaign.file import location
from ravenjax.errors import describe_unknown_name, find_mistakes, format_value

Table = TypeVar("Table", bound=BaseModel)


class _SectionClass(type(BaseModel)):
    """Metaclass that accepts NumPy values from Python, and formats errors as those of a file."""

    if not TYPE_CHECKING:

        def __call__(cls, **keys: Any) -> Any:
            raw = toml_value(keys)
            try:
                return super().__call__(**raw)
            except ValidationError as error:
                raise location.Where(None, {}, []).error(
                    ((cls.__name__, *key), message)
                    for key, message in find_mistakes(error, cls, raw)
                ) from None


def _require_types(schema) -> Any:
    # Returns pydantic's core schema `schema`, changed so that it does not convert types. Pydantic
    # would accept "3" and true as numbers, and "yes" as true.
    if isinstance(schema, list | tuple):
        return type(schema)(map(_require_types, schema))
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "bool":
        return schema | {"strict": True}
    typed: Any = {key: _require_types(inner) for key, inner in schema.items()}
    if schema.get("type") not in ("int", "float"):
        return typed
    return core_schema.no_info_before_validator_function(_require_number, typed)


def _require_number(raw) -> Any:
    # Returns the value. Pydantic checks later that a value of another type is a number.
    if isinstance(raw, bool | str):
        raise ValueError(f"got {format_value(raw)}, expected a number")
    return raw


class Section(BaseModel, metaclass=_SectionClass):
    """A table of a file. It is immutable and refuses unknown keys."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Put the description of each key, a docstring of several lines, on one line."""
        for field in cls.model_fields.values():
            field.description = field.description and " ".join(field.description.split())

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return _require_types(handler(source))


def parse(model: type[Table], raw: Any) -> tuple[Table | None, list[location.Complaint]]:
    """Return the tables `raw` of a file as a `model`, or None and all mistakes."""
    try:
        return model.model_validate(raw), []
    except ValidationError as error:
        return None, list(find_mistakes(error, model, raw))
    except RecursionError:
        return None, [((), "the tables are nested too deeply to be read")]


def toml_value(value: Any) -> Any:
    """Convert a value to types of TOML: tables to dicts without the keys that are None; arrays,
    tuples, ranges to lists. A value of another type is returned; a later check may refuse it.
    """
    if isinstance(value, Section):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, Mapping):
        return {key: toml_value(item) for key, item in value.items() if item is not None}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    # Numbers and arrays of NumPy and pandas have this method.
    if hasattr(value, "tolist"):
        return toml_value(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray):
        return [toml_value(item) for item in value]
    return value


@dataclasses.dataclass(frozen=True, eq=False)
class OneOf:
    """Annotation of a text that must be one of these names."""

    what: str  # kind of name, for messages
    names: Collection[str]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_after_validator_function(self._require_known, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Any:
        return handler(schema) | {"enum": list(self.names)}

    def _require_known(self, word: str) -> str:
        if word not in self.names:
            raise ValueError(describe_unknown_name(self.what, word, self.names))
        return word
