"""An axis of a campaign: one value, a list of values, or a distribution to draw from.

A list may be written `{ list = [..] }`, too: the same values, told apart from one value for each
number of a vector.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, WithJsonSchema, model_serializer

from ravenjax.errors import suggestion

Kind = Literal["fixed", "list", "choice", "together", "uniform", "loguniform", "normal", "phase"]

DISTRIBUTIONS = {
    "uniform": "[low, high]; whole numbers include both ends",
    "loguniform": "[low, high], both above 0",
    "normal": "[mean, standard deviation]",
    "choice": "[value, value, ..], each equally likely",
    "together": (
        "[value, value, ..], drawn in one with all parameters that say together: the n-th value of"
        " each"
    ),
}


LIST = "list"
"""A list that says of itself that it is one: each of its values is a run's."""

FORMS = {**DISTRIBUTIONS, LIST: "[value, value, ..], the same as a plain list"}
"""What a table may be in place of a value."""


PHASE = "phase"
"""A distribution of times: one of the milliseconds of a phase of the operation."""


class Moment(NamedTuple):
    """A time by its place among the milliseconds of a phase."""

    phase: str
    share: float  # 0: the first, 1: the last

    def __repr__(self) -> str:
        return f'{{phase = "{self.phase}", share = {self.share:g}}}'


class Axis(BaseModel):
    """Values of one field over the runs of a group.

    `fixed` holds one value; `list` is enumerated by grid and zip and drawn from by random, lhs and
    sobol; the others are always drawn from. `phase` holds the phase's name; where its motion is
    known, then (begin, end) of each stretch of its milliseconds, int, ascending, from begin to
    before end.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    kind: Kind
    values: tuple[Any, ...]
    explicit: bool = False  # a list that was written { list = [..] }

    @model_serializer
    def _plain(self) -> Any:
        """As it is written in a campaign file."""
        values = [value._asdict() if isinstance(value, Moment) else value for value in self.values]
        if self.kind == "fixed":
            return values[0]
        if self.kind == PHASE:
            return {PHASE: values[0]}
        return values if self.kind == LIST and not self.explicit else {self.kind: values}

    @property
    def drawn(self) -> bool:
        """Whether the axis is a distribution."""
        return self.kind not in ("fixed", "list")

    @property
    def listed(self) -> tuple[Any, ...]:
        """The values that it can take where they are countable, else ()."""
        return () if self.kind in ("uniform", "loguniform", "normal", PHASE) else self.values

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases that its values are places in, each once."""
        if self.kind == PHASE:
            return self.values[:1]
        return tuple(
            dict.fromkeys(value.phase for value in self.values if isinstance(value, Moment))
        )

    def places(self, unit: np.ndarray) -> np.ndarray:
        """The quantiles `unit` [n] in [0, 1) as `at` takes them: each listed value has an equal
        share of them.
        """
        if not self.listed:
            return unit
        return np.minimum((unit * len(self.values)).astype(np.int64), len(self.values) - 1)

    def at(self, places: np.ndarray, whole: bool = False) -> np.ndarray:
        """The numbers at `places`, float64 of the same shape: numbers of listed values, else
        quantiles in [0, 1).

        whole: drawn numbers are rounded to whole ones; listed ones stay as they were written.
        """
        if self.listed:
            return np.asarray(self.values, np.float64)[places]
        if self.kind == PHASE:
            begins, ends = np.array(self.values[1:], np.int64).T
            after = np.cumsum(ends - begins)
            place = np.minimum((places * after[-1]).astype(np.int64), after[-1] - 1)
            return ((ends - after)[np.searchsorted(after, place, side="right")] + place).astype(
                np.float64
            )
        low, high = (float(v) for v in self.values)
        if self.kind == "normal":
            from scipy.special import ndtri  # slow to import

            numbers = low + high * ndtri(np.clip(places, 1e-12, 1.0 - 1e-12))
        elif self.kind == "loguniform":
            numbers = np.exp(math.log(low) + places * (math.log(high) - math.log(low)))
        elif whole:
            numbers = np.minimum(
                np.floor(low) + np.floor(places * (math.floor(high) - math.floor(low) + 1.0)), high
            )
        else:
            numbers = low + places * (high - low)
        return np.rint(numbers) if whole else numbers


def fixed(value: Any) -> Axis:
    """The axis of one value."""
    return Axis(kind="fixed", values=(value,))


def _parse(raw: Any, types: tuple[type, ...], expected: str) -> Axis:
    if isinstance(raw, Axis):
        return raw
    if isinstance(raw, dict):
        kind = next(iter(raw), None)
        if len(raw) != 1 or kind not in FORMS:
            got = ", ".join(map(str, raw)) or "none"
            expected_keys = f"a table has exactly one of the keys {', '.join(FORMS)}"
            raise ValueError(f"{expected_keys}, got {got}{suggestion(kind, FORMS)}")
        if kind == LIST:
            return _list(raw[kind], types, expected)
        return _distribution(kind, raw[kind], types, expected)
    if isinstance(raw, list | tuple):
        if not raw:
            raise ValueError(f"the list is empty; give at least one {expected}")
        return Axis(kind="list", values=tuple(_value(v, types, expected) for v in raw))
    return fixed(_value(raw, types, expected))


def _list(raw: Any, types: tuple[type, ...], expected: str) -> Axis:
    if not isinstance(raw, list | tuple) or not raw:
        raise ValueError(f"list takes a list with at least one {expected}, got {raw!r}")
    return Axis(kind="list", values=tuple(_value(v, types, expected) for v in raw), explicit=True)


def _distribution(kind: Any, raw: Any, types: tuple[type, ...], expected: str) -> Axis:
    if kind in ("choice", "together"):
        if not isinstance(raw, list | tuple) or not raw:
            raise ValueError(f"{kind} takes a list with at least one {expected}, got {raw!r}")
        return Axis(kind=kind, values=tuple(_value(v, types, expected) for v in raw))
    if str in types and float not in types and int not in types:
        raise ValueError(
            f"{kind} draws numbers and this key takes {expected}; write {{choice = [..]}}"
        )
    if not isinstance(raw, list | tuple) or len(raw) != 2:
        raise ValueError(f"{kind} takes {DISTRIBUTIONS[kind]}, got {raw!r}")
    first, second = (_value(v, (int, float), "a number") for v in raw)
    if kind == "normal" and second < 0:
        raise ValueError(
            "normal = [mean, standard deviation]: the deviation must not be negative, got"
            f" {second!r}"
        )
    if kind != "normal" and not first <= second:
        raise ValueError(
            f"{kind} = [low, high]: low must not exceed high, got [{first!r}, {second!r}]"
        )
    if kind == "loguniform" and first <= 0:
        raise ValueError(f"loguniform = [low, high]: both must be above 0, got {first!r}")
    return Axis(kind=kind, values=(first, second))


def _value(raw: Any, types: tuple[type, ...], expected: str) -> Any:
    if isinstance(raw, bool) and (int in types or float in types):
        return int(raw)
    if isinstance(raw, float) and not math.isfinite(raw):
        raise ValueError(f"got {raw}, expected {expected} that is finite")
    if isinstance(raw, float) and int in types and float not in types and raw.is_integer():
        return int(raw)
    if float in types and isinstance(raw, int):
        return raw
    if not isinstance(raw, types):
        raise ValueError(f"got {raw!r}, expected {expected}, a list of them or a distribution")
    return raw


_LISTS = ("choice", "together", LIST)
_FORMS = ", ".join(f"{{{kind} = {form}}}" for kind, form in FORMS.items())


def forms_schema(expected: str, value: dict[str, Any], drawn: bool = True) -> dict[str, Any]:
    """JSON Schema of what a file may write, `value` being one value; drawn: whether
    distributions of numbers fit.
    """
    some = {"type": "array", "items": value, "minItems": 1}
    pair = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
    tables = [_table(kind, some if kind in _LISTS else pair) for kind in FORMS]
    forms = [value, some, *(table for table in tables if drawn or table["required"][0] in _LISTS)]
    return {"description": f"{expected}, a list of them, or one of {_FORMS}", "anyOf": forms}


def _table(kind: str, values: dict[str, Any]) -> dict[str, Any]:
    one = {"description": FORMS[kind], **values}
    return {
        "type": "object",
        "properties": {kind: one},
        "required": [kind],
        "additionalProperties": False,
    }


def _number(raw: Any) -> Axis:
    return _parse(raw, (int, float), "a number")


def milliseconds(raw: Any, *types: type) -> Axis:
    """The axis of whole numbers, or of values of `types`. Raises ValueError."""
    if isinstance(raw, bool) or (isinstance(raw, list) and any(isinstance(x, bool) for x in raw)):
        raise ValueError(f"got {raw!r}, expected a whole number of milliseconds")
    return _parse(raw, (int, *types), "a whole number of milliseconds")


def _word(raw: Any) -> Axis:
    return _parse(raw, (str,), "a name")


def _schema(expected: str, value: dict[str, Any], drawn: bool = True) -> WithJsonSchema:
    return WithJsonSchema(forms_schema(expected, value, drawn))


Number = Annotated[
    Axis, BeforeValidator(_number), _schema("a number", {"type": ["number", "boolean"]})
]
Milliseconds = Annotated[
    Axis,
    BeforeValidator(milliseconds),
    _schema("a whole number of milliseconds", {"type": "integer"}),
]
Word = Annotated[Axis, BeforeValidator(_word), _schema("a name", {"type": "string"}, drawn=False)]
