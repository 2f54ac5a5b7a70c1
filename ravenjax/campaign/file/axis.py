"""An axis of a campaign: one value, a list of values, or a distribution to draw from.

A list may be written `{ list = [..] }`, too: the same values, told apart from one value for each
number of a vector.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, WithJsonSchema, model_serializer

from ravenjax.errors import shown, suggestion

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


_LISTS = ("choice", "together", LIST)
_MILLISECONDS = "a whole number of milliseconds"

PHASE = "phase"
"""A distribution of times: one of the milliseconds of a phase of the operation."""
SHARE = "share"

PHASE_FORMS = {
    f'{{ {PHASE} = "fast" }}': "drawn: each millisecond of the phase is as likely",
    f'{{ {PHASE} = "fast", {SHARE} = 0.5 }}': (
        "the millisecond in the middle of the phase's; 0 is its first one, 1 its last"
    ),
    f'{{ {PHASE} = "fast", {SHARE} = [0, 0.5, 1] }}': "a list of such",
    f'[500, {{ {PHASE} = "slow", {SHARE} = 0.1 }}]': "a list of both; so is `{ choice = [..] }`",
}
"""What `start_ms` may be beside a time, with the phase `fast`."""


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


def _axis(raw: Any, value: Callable[[Any], Any], expected: str, drawn: bool = True) -> Axis:
    """value: what one value of the key becomes, ValueError where it is none; drawn: whether
    distributions of numbers fit.
    """
    if isinstance(raw, Axis):
        return raw
    kind, values = LIST, raw
    if isinstance(raw, Mapping):
        kind = next(iter(raw), None)
        if len(raw) != 1 or kind not in FORMS:
            got = ", ".join(map(str, raw)) or "none"
            expected_keys = f"a table has exactly one of the keys {', '.join(FORMS)}"
            raise ValueError(f"{expected_keys}, got {got}{suggestion(kind, FORMS)}")
        values = raw[kind]
        if kind not in _LISTS:
            if not drawn:
                raise ValueError(
                    f"{kind} draws numbers and this key takes {expected}; write {{choice = [..]}}"
                )
            return _distribution(kind, values)
        if not isinstance(values, list | tuple) or not values:
            raise ValueError(f"{kind} takes a list with at least one {expected}, got {values!r}")
    elif not isinstance(raw, list | tuple):
        return fixed(value(raw))
    elif not raw:
        raise ValueError(f"the list is empty; give at least one {expected}")
    return Axis(
        kind=kind, values=tuple(map(value, values)), explicit=kind == LIST and values is not raw
    )


def _distribution(kind: Any, raw: Any) -> Axis:
    if not isinstance(raw, list | tuple) or len(raw) != 2:
        raise ValueError(f"{kind} takes {DISTRIBUTIONS[kind]}, got {raw!r}")
    first, second = map(_as_number, raw)
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


def _as_number(raw: Any) -> int | float:
    if isinstance(raw, bool):
        return int(raw)
    if isinstance(raw, float) and not math.isfinite(raw):
        raise ValueError(f"got {raw}, expected a number that is finite")
    if isinstance(raw, int | float):
        return raw
    raise ValueError(f"got {raw!r}, expected a number, a list of them or a distribution")


def _as_milliseconds(raw: Any) -> int:
    if isinstance(raw, float) and raw.is_integer():
        return int(raw)
    if isinstance(raw, int) and not isinstance(raw, bool):
        return raw
    raise ValueError(f"got {raw!r}, expected {_MILLISECONDS}, a list of them or a distribution")


def _as_word(raw: Any) -> str:
    if isinstance(raw, str):
        return raw
    raise ValueError(f"got {raw!r}, expected a name, a list of them or a distribution")


def _as_onset(raw: Any) -> int | Moment:
    if not _is_place(raw):
        return _as_milliseconds(raw)
    phase, share = _phase(raw), raw.get(SHARE)
    if share is None:
        raise ValueError(
            f"got {{{PHASE} = {shown(phase)}}} in a list, which takes single values: add {SHARE} ="
            " 0.5 (0 is the first millisecond of the phase, 1 its last)"
        )
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 <= share <= 1.0:
        raise ValueError(
            f"{SHARE}: got {shown(share)}, expected a number from 0 to 1, or a list of them"
        )
    return Moment(phase, float(share))


def _onset(raw: Any) -> Axis:
    """When a fault begins: a time, or a place in a phase of the operation. Which milliseconds
    belong to a phase follows from the operator's motion, see `ravenjax.campaign.faults.moments`.
    """
    shares = raw.get(SHARE) if _is_place(raw) else ()
    if shares is None:
        return Axis(kind=PHASE, values=(_phase(raw),))
    if _is_place(raw) and isinstance(shares, list | tuple):
        if not shares:
            raise ValueError(f"{SHARE}: the list is empty; give at least one number from 0 to 1")
        return Axis(kind=LIST, values=tuple(_as_onset({**raw, SHARE: one}) for one in shares))
    return fixed(_as_onset(raw)) if _is_place(raw) else _axis(raw, _as_onset, _MILLISECONDS)


def _is_place(raw: Any) -> bool:
    """Whether it is a place in a phase."""
    return isinstance(raw, Mapping) and bool(raw.keys() & {PHASE, SHARE})


def _phase(raw: Mapping[str, Any]) -> str:
    for key in raw:
        if key not in (PHASE, SHARE):
            hint = suggestion(key, (PHASE, SHARE)) if key not in FORMS else ""
            raise ValueError(
                f"a table of a phase has the keys {PHASE} and {SHARE}, got {key}{hint}"
            )
    if PHASE not in raw:
        raise ValueError(
            f'{PHASE}: missing beside {SHARE}; write which, such as {{{PHASE} = "fast", {SHARE} ='
            " 0.5}"
        )
    if not isinstance(raw[PHASE], str):
        raise ValueError(f"{PHASE}: got {shown(raw[PHASE])}, expected the name of a phase")
    return raw[PHASE]


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


def _onset_schema() -> dict[str, Any]:
    """What a file may write."""
    share = {
        "description": "0: the phase's first millisecond, 1: its last",
        "type": "number",
        "minimum": 0,
        "maximum": 1,
    }
    shares = {"anyOf": [share, {"type": "array", "items": share, "minItems": 1}]}

    def table(of_share: dict[str, Any], required: list[str]) -> dict[str, Any]:
        keys = {
            PHASE: {"description": "a phase of the operation", "type": "string"},
            SHARE: of_share,
        }
        return {
            "type": "object",
            "properties": keys,
            "required": required,
            "additionalProperties": False,
        }

    value = {"anyOf": [{"type": "integer"}, table(share, [PHASE, SHARE])]}
    whole = forms_schema(f"{_MILLISECONDS}, a place in a phase", value)
    return {**whole, "anyOf": [*whole["anyOf"], table(shares, [PHASE])]}


def _form(
    value: Callable[[Any], Any], expected: str, schema: dict[str, Any], drawn: bool = True
) -> Any:
    """The annotation of a key that takes an axis of such values."""
    return Annotated[
        Axis,
        BeforeValidator(lambda raw: _axis(raw, value, expected, drawn)),
        WithJsonSchema(forms_schema(expected, schema, drawn)),
    ]


if TYPE_CHECKING:
    Number = Milliseconds = Word = Onset = Axis
else:
    Number = _form(_as_number, "a number", {"type": ["number", "boolean"]})
    Milliseconds = _form(_as_milliseconds, _MILLISECONDS, {"type": "integer"})
    Word = _form(_as_word, "a name", {"type": "string"}, drawn=False)
    Onset = Annotated[Axis, BeforeValidator(_onset), WithJsonSchema(_onset_schema())]
