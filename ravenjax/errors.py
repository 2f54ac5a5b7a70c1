"""Exceptions for errors that a user can correct, and functions that write their messages."""

from __future__ import annotations

import difflib
import inspect
import json
import math
import os
import re
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeGuard, get_args, get_origin

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


class UserError(ValueError):
    """Raised for an error in the user's input. The message names the file, key or value, the
    expected values, and what to write instead.

    The command line prints the message without a traceback and exits with code 2.
    """


class StoreError(Exception):
    """Raised for a result folder or file that cannot be used. The message states what to do."""


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 80, 80, 40


def format_value(value: object) -> str:
    """Return the repr of a value for an error message, shortened if it is long."""
    try:
        return _SHORT.repr(value)
    # A repr may raise anything. The caller still needs the error message.
    except Exception:
        return f"<{type(value).__name__}>"


def is_table(value: object) -> TypeGuard[dict[str, Any]]:
    """Return whether a value of a file is a table, whose keys are texts."""
    return isinstance(value, dict)


def require_utf8(*names: str) -> None:
    """Raise UserError for an argument, or a path, that is not valid UTF-8."""
    for name in names:
        # The two codings differ only for bytes that are not UTF-8 (lone surrogates in `name`).
        if name.encode(errors="replace") != os.fsencode(name):
            raise UserError(f"{name!r}: the name is not UTF-8; rename the file or folder")


def list_lines(lines: Sequence[str], most: int = 8) -> str:
    """Return a text with the first `most` lines, indented, and the number of omitted lines."""
    shown = list(lines[:most])
    if len(lines) > most:
        shown.append(f"and {len(lines) - most} more")
    return "\n".join(f"  {line}" for line in shown)


def suggest_name(word: object, names: Iterable[str]) -> str:
    """Return `. Did you mean 'x'?` with the known name that is most similar to `word`. Names with
    dots, such as paths, are compared by the number of parts that they have in common with `word`,
    then by letters. Return "" if no name is similar, or if `word` is not a string.
    """
    if not isinstance(word, str):
        return ""
    names = list(names)
    parts = set(word.lower().split("."))
    shared_counts = {name: len(parts.intersection(name.lower().split("."))) for name in names}
    largest = max(shared_counts.values(), default=0)
    if largest > 0:
        candidates = [name for name in names if shared_counts[name] == largest]
        matches = difflib.get_close_matches(word, candidates, n=1, cutoff=0.0)
    else:
        matches = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f". Did you mean {matches[0]!r}?" if matches else ""


def describe_unknown_name(what: str, word: str, names: Iterable[str]) -> str:
    """Return the error message for an unknown word. what: kind of name, such as "engine"."""
    names = list(names)
    return f"unknown {what} {word!r}, expected one of {', '.join(names)}{suggest_name(word, names)}"


# The unit that a value may have by mistake, and the factor from that unit, by the end of a key.
_UNITS = {
    "deg": ("radians", 180.0 / math.pi),
    "mm": ("metres", 1e3),
    "m": ("millimetres", 1e-3),
    "ms": ("seconds", 1e3),
    "s": ("milliseconds", 1e-3),
}


def suggest_unit(key: str, value: Any, low: float = -math.inf, high: float = math.inf) -> str:
    """Return a hint such as `. If this is in radians, write 57.3`. value: a number or a list of
    numbers. The end of `key`, such as "_deg", states the unit that is expected. Return "" if a
    number would not lie between `low` and `high` in the other unit.
    """
    unit, factor = _UNITS.get(key.rpartition("_")[2], ("", 0.0))
    several = isinstance(value, list | tuple)
    numbers: list[Any] = [*value] if several else [value]
    # A truth value is no number. Larger whole numbers may not fit into a float.
    plausible = (
        type(x) in (int, float) and abs(x) < 1e12 and low <= x * factor <= high for x in numbers
    )
    if not unit or not all(plausible):
        return ""
    meant = [float(f"{x * factor:.4g}") for x in numbers]
    return f". If this is in {unit}, write {meant if several else f'{meant[0]:g}'}"


def _allowed_range(model: type[BaseModel], key: str) -> tuple[float, float]:
    # Returns the smallest and the largest number that a table permits for a key.
    schema = json.dumps(model.model_json_schema()["properties"].get(key))
    # The pattern finds the numbers of "minimum" and "exclusiveMinimum", and of the maxima. A key of
    # several types may have several bounds. A number within any of them may be permitted.
    minima, maxima = (
        [float(text) for text in re.findall(rf'{end}imum": ([-+.\de]+)', schema, re.IGNORECASE)]
        for end in ("min", "max")
    )
    return min(minima, default=-math.inf), max(maxima, default=math.inf)


def find_mistakes(
    error: ValidationError, model: type[BaseModel], raw: Any
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield (key, message) of each mistake that pydantic found in the tables `raw` of a `model`."""
    # If all entries of a list are invalid, pydantic also reports that it is too short.
    mistakes: list[Any] = [
        found for found in error.errors() if found["type"] != "too_short" or not found["input"]
    ]
    for mistake in mistakes:
        if _is_explained_by_misspelling(mistake, mistakes):
            continue
        kind, loc, message = mistake["type"], mistake["loc"], _describe_mistake(mistake, model)
        key = _key_in_file(loc, raw)
        if kind.startswith("union_tag"):
            # Pydantic reports the table, but the mistake is in its key `kind`.
            key = (*key, "kind")
        elif kind == "value_error":
            # A validator of a table may begin its message with the key that is wrong: "key: ..".
            # This key becomes the end of the path, unless the path already ends with it.
            name, colon, rest = message.partition(": ")
            names_key = colon and name in _model_at(model, loc).model_fields
            if names_key and name not in key[-1:]:
                key, message = (*key, name), rest
        yield key, message


def _is_explained_by_misspelling(missing: Any, errors: Sequence[Any]) -> bool:
    # Returns whether an error is about a missing key that another error reports as misspelt. This
    # is so if an unknown key of the same table is similar to the missing key.
    *table, key = missing["loc"] or ("",)
    return missing["type"] == "missing" and any(
        suggest_name(other["loc"][-1], (str(key),))
        for other in errors
        if other["type"] == "extra_forbidden" and list(other["loc"][:-1]) == table
    )


def _key_in_file(loc: tuple[str | int, ...], raw: Any) -> tuple[str | int, ...]:
    # Returns the key in the file for pydantic's location of an error. The location also names
    # members of unions: the kind or the class of a table, or, at the end, the types of a value. So
    # ("group", 0, "runs", "int") becomes ("group", 0, "runs"). raw: the tables of the file.
    key: tuple[str | int, ...] = ()
    for index, part in enumerate(loc, start=1):
        # The name of a union's member is skipped. Any other last part is a key that is missing.
        is_table, is_list = isinstance(raw, dict), isinstance(raw, list | tuple)
        if is_table and part not in raw and (part == raw.get("kind") or index < len(loc)):
            continue
        if is_table:
            raw = raw.get(part)
        elif is_list and isinstance(part, int):
            raw = raw[part] if part < len(raw) else None
        else:
            break
        key = (*key, part)
    return key


def _describe_mistake(error: Any, model: type[BaseModel]) -> str:
    # Returns ravenjax's message for an error that pydantic found in tables of this model.
    kind, loc, got = error["type"], error["loc"], error["input"]
    table, key = _model_at(model, loc[:-1]), str(loc[-1]) if loc else ""
    if kind == "extra_forbidden":
        keys = list(table.model_fields)
        here = [header for _, header, other in tables_of(model) if other is table]
        headers = dict.fromkeys(
            header
            for path, header, other in tables_of(model)
            if path and key in other.model_fields and header not in here
        )
        hint = f". It is a key of {' and '.join(headers)}" if headers else ""
        return f"unknown key, expected one of {', '.join(keys)}{suggest_name(key, keys) or hint}"
    if kind == "missing":
        field = table.model_fields.get(key)
        return f"missing: {field.description}" if field and field.description else "missing"
    if kind.startswith("union_tag"):
        kinds = [_kind(one) for one in models_in(table.model_fields[key].annotation)]
        text = f"got {format_value(got['kind'])}, " if "kind" in got else "missing: "
        return f"{text}expected one of {', '.join(kinds)}{suggest_name(got.get('kind'), kinds)}"
    if kind == "tuple_type" and isinstance(error["input"], dict):
        for path, header, _ in tables_of(model):
            if path == tuple(part for part in loc if isinstance(part, str)):
                return (
                    f"got one table, expected a list of tables: begin each table with {header}, in"
                    " double brackets"
                )
    text = error["msg"].removeprefix("Value error, ").replace("a valid boolean", "true or false")
    named = next((part for part in reversed(loc) if part in table.model_fields), "")
    unit = named and suggest_unit(str(named), got, *_allowed_range(table, str(named)))
    # A validator of ravenjax raised this error, so its message is complete.
    if kind == "value_error":
        return text + unit
    expected = text.removeprefix("Input should be ").replace("String", "text")
    # Pydantic's messages about lists and tables do not say what is expected in words of TOML.
    match kind:
        case "tuple_type":
            expected = "a list"
        case "model_type" | "model_attributes_type":
            expected = "a table"
        case "too_short":
            expected = f"a list of at least {error['ctx']['min_length']}"
        case "too_long":
            expected = f"a list of at most {error['ctx']['max_length']}"
        case "literal_error":
            # The text of the expected names is like: 'a', 'b' or 'c'.
            expected += suggest_name(got, expected.split("'")[1::2])
        case _:
            pass
    return f"got {format_value(got)}, expected {expected}{unit}"


def _model_at(model: type[BaseModel], key: Sequence[str | int]) -> type[BaseModel]:
    # Returns the model of the table at `key`, a path of keys and indices inside a table of `model`.
    # After the key of a union of tables, the path has the kind of the table. Other parts that are
    # no field of the current model, such as the indices of lists, are skipped.
    members: list[type[BaseModel]] = []
    for part in key:
        if isinstance(part, str) and part in model.model_fields:
            members = list(models_in(model.model_fields[part].annotation))
            model = next(iter(members), model)
        else:
            model = next((member for member in members if _kind(member) == part), model)
    return model


def _kind(model: type[BaseModel]) -> str:
    # Returns the word that the key `kind` has in a table of this model; "" without this key.
    field = model.model_fields.get("kind")
    return next(iter(get_args(field.annotation)), "") if field else ""


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models of tables that an annotation names."""
    if hasattr(annotation, "model_fields"):
        yield annotation
    for inner in get_args(annotation):
        yield from models_in(inner)


def tables_of(
    model: type[BaseModel], path: tuple[str, ...] = (), header: str = ""
) -> Iterator[tuple[tuple[str, ...], str, type[BaseModel]]]:
    """Yield (path, header, model) of every table of a file, in order, such as (("group", "fault"),
    "[[group.fault]]", Fault). The whole file is the first: ().
    """
    yield path, header, model
    # The keys that the class itself declares come before inherited keys. Thus the tables that only
    # one robot has come first.
    declared = inspect.get_annotations(model)
    for name in sorted(model.model_fields, key=lambda name: name not in declared):
        annotation = model.model_fields[name].annotation
        is_list = tuple in (get_origin(annotation), *map(get_origin, get_args(annotation)))
        text = ".".join((*path, name))
        for inner in models_in(annotation):
            yield from tables_of(inner, (*path, name), f"[[{text}]]" if is_list else f"[{text}]")
