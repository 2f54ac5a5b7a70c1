"""Exceptions for errors that a user can correct, and functions that write their messages."""

from __future__ import annotations

import difflib
import json
import math
import os
import re
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from pydantic import BaseModel


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
    """Return `. Did you mean 'x'?` with the known name that is most similar to `word`. The name is
    one of those that share most parts between dots with `word`, if any name shares one. Return ""
    if no name is similar, or if `word` is not a string.
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
    numbers. The end of `key`, such as "_deg", states the unit that is expected.

    Return "" if a number would not lie between `low` and `high` in the other unit.
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
    low, high = (
        [float(text) for text in re.findall(rf'{end}imum": ([-+.\de]+)', schema, re.IGNORECASE)]
        for end in ("min", "max")
    )
    return min(low, default=-math.inf), max(high, default=math.inf)


def format_error(error: Any, model: type[BaseModel], hint: str = "") -> str:
    """Return ravenjax's message for an error that pydantic found in a table of this model. error:
    one of `ValidationError.errors()`. hint: text about the table to which an unknown key belongs;
    "": the message suggests the most similar key.
    """
    kind, key = error["type"], str(error["loc"][-1]) if error["loc"] else ""
    named = next((part for part in reversed(error["loc"]) if part in model.model_fields), "")
    if kind == "extra_forbidden":
        keys = list(model.model_fields)
        return f"unknown key, expected one of {', '.join(keys)}{hint or suggest_name(key, keys)}"
    if kind == "missing":
        field = model.model_fields.get(key)
        return f"missing: {field.description}" if field and field.description else "missing"
    text = error["msg"].removeprefix("Value error, ").replace("a valid boolean", "true or false")
    unit = named and suggest_unit(named, error["input"], *_allowed_range(model, named))
    # A validator of ravenjax raised this error, so its message is complete.
    if kind == "value_error":
        return text + unit
    expected = text.removeprefix("Input should be ").replace("String", "text")
    # Pydantic's messages about the length of a list do not say what is expected.
    if kind == "too_short":
        expected = f"a list of at least {error['ctx']['min_length']}"
    elif kind == "too_long":
        expected = f"a list of at most {error['ctx']['max_length']}"
    return f"got {format_value(error['input'])}, expected {expected}{unit}"


def model_at(model: type[BaseModel], key: Sequence[str | int]) -> type[BaseModel]:
    """Return the model of the table at `key`, a path of keys and indices inside a table of `model`.
    Parts that are no field of the current model, such as the indices of lists, are skipped.
    """
    for part in key:
        if isinstance(part, str) and part in model.model_fields:
            model = next(models_in(model.model_fields[part].annotation), model)
    return model


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models of tables that an annotation names."""
    if hasattr(annotation, "model_fields"):
        yield annotation
    for inner in get_args(annotation):
        yield from models_in(inner)
