"""Defines how a key of a campaign file varies: one value, a list of values, or a distribution.

A list may also be written `{ list = [..] }`. Its items are then separate values, not one vector.
"""

import dataclasses
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeGuard

import numpy as np
from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from ravenjax import resources
from ravenjax.errors import describe_unknown_name, format_value, suggest_name

Kind = Literal["fixed", "list", "choice", "together", "uniform", "loguniform", "normal", "phase"]

_TABLES = resources.read_tables(__file__, "axis.toml")

DISTRIBUTIONS: dict[str, str] = _TABLES["distributions"]

LIST = "list"
"""Key of a table with a list of which each run has one value."""

FORMS = {**DISTRIBUTIONS, LIST: "[value, value, ..], the same as a plain list"}
"""Tables that may replace a value, with the form of their content."""

_PAIRS = ("uniform", "loguniform", "normal")

PHASE = "phase"
"""Key of a table for times: a random millisecond of a phase of the operation."""
SHARE = "share"

PHASE_FORMS: dict[str, str] = _TABLES["phase_forms"]
"""Tables with a phase that `start_ms` may have instead of a time, for the phase `fast`."""

LONGEST_MS = 1_000_000_000
"""Upper bound of all times of a fault. The longest run is 3 600 000 ms."""

END = "end"
UNTIL_END = -1
"""Value of `duration_ms` in the fault table if a fault lasts until the run ends. A file has END."""

TAIL = 7.04
"""Largest distance from the mean that is drawn, in standard deviations: the quantile of 1e-12."""


class Moment(NamedTuple):
    """A time, given as a share of the milliseconds of a phase."""

    phase: str
    share: float  # 0: the first millisecond, 1: the last

    def __repr__(self) -> str:
        return f'{{phase = "{self.phase}", share = {self.share:g}}}'


@dataclasses.dataclass(frozen=True)
class Axis:
    """The values of one key over the runs of a group. Kind `fixed` has one value. The values of
    `list` are enumerated by designs grid and zip, and drawn at random by random, lhs and sobol. All
    other kinds are distributions. The values of `phase` are the name of the phase, and later also
    (begin, end) of each stretch of the phase in ms: integers, ascending, without the end.
    """

    kind: Kind
    values: tuple[Any, ...]
    explicit: bool = False  # True if the file has { list = [..] }

    def written(self) -> Any:
        """Return what a campaign file has as the value of the key."""
        values = [value._asdict() if isinstance(value, Moment) else value for value in self.values]
        if self.kind == "fixed":
            return values[0]
        if self.kind == PHASE:
            return {PHASE: values[0]}
        # A list is written as [1, 2], or as { list = [1, 2] } if it is explicit.
        return values if self.kind == LIST and not self.explicit else {self.kind: values}

    @property
    def drawn(self) -> bool:
        """Whether the axis is a distribution."""
        return self.kind not in ("fixed", LIST)

    @property
    def listed(self) -> tuple[Any, ...]:
        """All possible values, if they are a list, else ()."""
        return () if self.kind in (*_PAIRS, PHASE) else self.values

    @property
    def extent(self) -> tuple[float, float]:
        """Smallest and largest number that a distribution of numbers may draw."""
        low, high = self.values
        return (low - TAIL * high, low + TAIL * high) if self.kind == "normal" else (low, high)

    @property
    def fits_whole_numbers(self) -> bool:
        """Whether a distribution can be rounded to whole numbers and never leave its range."""
        low, high = self.extent
        if self.kind == "uniform":
            return not (low % 1 or high % 1)
        return math.ceil(low) <= math.floor(high)

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases of the operation in the values, each once."""
        if self.kind == PHASE:
            return self.values[:1]
        return tuple(dict.fromkeys(v.phase for v in self.values if isinstance(v, Moment)))

    def places(self, quantiles: np.ndarray) -> np.ndarray:
        """Convert quantiles [n] in [0, 1) to positions for `at`: indices of listed values, each
        equally likely, or the quantiles themselves for a distribution of numbers.
        """
        if not self.listed:
            return quantiles
        # A quantile that was rounded to 1 would give the index after the last value.
        return np.minimum((quantiles * len(self.values)).astype(np.int64), len(self.values) - 1)

    def at(self, places: np.ndarray, whole: int = 0) -> np.ndarray:
        """Return the numbers at `places`, float64 of the same shape. places: indices of listed
        values, or quantiles [0, 1) of a distribution. whole: round numbers of a distribution to
        multiples of this number; 0: do not round. Listed values are never rounded.
        """
        if self.listed:
            numbers = [UNTIL_END if value == END else value for value in self.values]
            return np.asarray(numbers, np.float64)[places]
        if self.kind == PHASE:
            _, *stretches = self.values
            begins, ends = np.array(stretches, np.int64).T
            # The milliseconds of the phase are numbered. In stretches from 10 to 13 and from 20 to
            # 22, milliseconds 10, 11, 12, 20 and 21 have the numbers 0 to 4.
            counts = np.cumsum(ends - begins)
            number = np.minimum((places * counts[-1]).astype(np.int64), counts[-1] - 1)
            stretch = np.searchsorted(counts, number, side="right")
            first_number = counts - (ends - begins)
            return (begins[stretch] + number - first_number[stretch]).astype(np.float64)
        # Numbers are drawn in units of `whole`, rounded, and converted back.
        unit = max(whole, 1)
        low, high = (value / unit for value in self.values)
        if self.kind == "normal":
            # This import is slow.
            from scipy.special import ndtri

            mean, deviation = low, high
            # `ndtri` gives the quantiles of the normal distribution; those of 0 and 1 are infinite.
            numbers = mean + deviation * ndtri(np.clip(places, 1e-12, 1.0 - 1e-12))
        elif self.kind == "loguniform":
            numbers = np.exp(math.log(low) + places * (math.log(high) - math.log(low)))
        elif whole:
            # Each whole number from low to high is equally probable, both ends included.
            first = math.ceil(low)
            numbers = first + np.floor(places * (math.floor(high) - first + 1.0))
        else:
            numbers = low + places * (high - low)
        if not whole:
            return numbers
        least, largest = (end / unit for end in self.extent)
        return np.clip(np.rint(numbers), math.ceil(least), math.floor(largest)) * unit


def fixed_axis(value: Any) -> Axis:
    """Return the axis of a key with one value."""
    return Axis("fixed", (value,))


class KeyDefinition(NamedTuple):
    """Defines the possible values of a key, and which tables may replace a value."""

    expected: str  # the possible values as text, for messages
    parse: Callable[[Any], Any]  # returns the value; raises ValueError for an invalid value
    schema: dict[str, Any]  # JSON Schema
    forms: tuple[str, ...] = ("uniform", "loguniform", "normal", "choice", LIST)
    least: float = -math.inf
    largest: float = math.inf
    whole: bool = False  # whether values are whole numbers

    def parse_value(self, raw: Any) -> Any:
        """Return one value. Raise ValueError with what was expected for an invalid value."""
        value = self.parse(raw)
        if isinstance(value, int | float) and not self.least <= value <= self.largest:
            raise ValueError(f"got {format_value(raw)}, expected {self.expected}")
        return value

    def parse_axis(self, raw: Any) -> Axis:
        """Return the axis of a key. raw: a value, a list, or a table from a file, or an axis."""
        if isinstance(raw, Axis):
            return raw
        if not isinstance(raw, Mapping | list | tuple):
            return fixed_axis(self.parse_value(raw))
        kind, values = LIST, raw
        if isinstance(raw, Mapping):
            kind, values = next(iter(raw.items()), (None, ()))
            if len(raw) != 1 or kind not in self.forms:
                got = ", ".join(map(str, raw)) or "none"
                keys = f"a table needs exactly one of the keys {', '.join(self.forms)}"
                raise ValueError(f"{keys}, got {got}{suggest_name(kind, self.forms)}")
        if kind in _PAIRS:
            return self._parse_distribution(kind, values)
        if not isinstance(values, list | tuple) or not values:
            raise ValueError(
                f"{kind} needs a list with at least one value, got {values!r}; each value is"
                f" {self.expected}"
            )
        # True for { list = [..] }, False for [..].
        is_explicit = kind == LIST and values is not raw
        return Axis(kind, tuple(map(self.parse_value, values)), is_explicit)

    def _parse_distribution(self, kind, raw) -> Axis:
        # Parses a distribution, such as {uniform = [low, high]}, and checks its ends.
        if not isinstance(raw, list | tuple) or len(raw) != 2:
            raise ValueError(f"{kind} needs {DISTRIBUTIONS[kind]}, got {raw!r}")
        first, second = map(_require_number, raw)
        if kind == "normal" and second < 0:
            raise ValueError(
                f"normal: got standard deviation {second!r}, expected a number of at least 0"
            )
        if kind != "normal" and not first <= second:
            raise ValueError(
                f"{kind} = [low, high]: low must not exceed high, got [{first!r}, {second!r}]"
            )
        if kind == "loguniform" and first <= 0:
            raise ValueError(f"loguniform = [low, high]: both must be above 0, got {first!r}")
        axis = Axis(kind, (first, second))
        # A normal distribution may draw numbers below `least`, which later become `least`.
        lowest = -self.largest if kind == "normal" else self.least
        if not lowest <= axis.extent[0] <= axis.extent[1] <= self.largest:
            raise ValueError(f"got {kind} = {format_value(list(raw))}, expected {self.expected}")
        if self.whole and not axis.fits_whole_numbers:
            low, high = axis.extent
            raise ValueError(
                f"got {kind} = {format_value(list(raw))}, expected {self.expected}: write whole"
                f" numbers as limits, such as {math.floor(low)} and {math.ceil(high)}"
            )
        return axis

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the key."""
        values = {"type": "array", "items": self.schema, "minItems": 1}
        # FORMS has the content of a table by its key, such as "[low, high]" by "uniform".
        properties = {
            key: {"description": FORMS[key], **(_TABLES["pair"] if key in _PAIRS else values)}
            for key in self.forms
        }
        table = {**_TABLES["table"], "properties": properties}
        # Such as "{choice = [value, value, ..]}".
        examples = ", ".join(f"{{{key} = {FORMS[key]}}}" for key in self.forms)
        return {
            "description": f"{self.expected}, a list of these, or one of {examples}",
            "anyOf": [self.schema, values, table],
        }

    def annotation(self, parse: Callable[[Any], Axis] | None = None) -> Any:
        """Return the type annotation of a key with such values. parse: instead of `parse_axis`."""
        return Annotated[
            Any,
            BeforeValidator(parse or self.parse_axis),
            PlainSerializer(Axis.written),
            WithJsonSchema(self.json_schema()),
        ]


def _is_number(raw) -> TypeGuard[int | float]:
    return isinstance(raw, int | float) and not isinstance(raw, bool)


def _require_number(raw) -> int | float:
    # Returns a value from a file. Raises ValueError unless the value is a finite number.
    if not _is_number(raw) or not abs(raw) <= sys.float_info.max:
        raise ValueError(f"got {format_value(raw)}, expected a number that is finite")
    return raw


def time_axis(least: int, endless: bool = False) -> KeyDefinition:
    """Return the definition of times of at least `least` ms. endless: END is possible, too."""
    expected = f"a whole number of milliseconds from {least} to {LONGEST_MS}"
    schema: dict[str, Any] = {"type": "integer", "minimum": least, "maximum": LONGEST_MS}
    if endless:
        expected, schema = f'{expected}, or "{END}"', {"anyOf": [schema, {"const": END}]}

    def parse(raw) -> int | str:
        # Returns a time in ms, or END. A fault table has UNTIL_END in place of END.
        if endless and raw in (END, UNTIL_END):
            return END
        if not _is_number(raw) or raw % 1:
            raise ValueError(
                f"got {format_value(raw)}, expected {expected}, a list or a distribution"
            )
        return int(raw)

    return KeyDefinition(expected, parse, schema, least=least, largest=LONGEST_MS, whole=True)


def word_axis(what: str, known: Iterable[str] | None = None) -> KeyDefinition:
    """Return the definition of a key with names. what: kind of name. known: names; None: any."""
    expected = f"the name of {'an' if what[0] in 'aeiou' else 'a'} {what}"

    def parse(raw) -> str:
        # Returns a word, which must be one of the known words.
        if not isinstance(raw, str):
            forms = "a list of names or {choice = [..]}"
            raise ValueError(f"got {format_value(raw)}, expected {expected}, {forms}")
        if known is not None and raw not in known:
            raise ValueError(describe_unknown_name(what, raw, known))
        return raw

    schema = {"type": "string"} | ({} if known is None else {"enum": list(known)})
    return KeyDefinition(expected, parse, schema, ("choice", LIST))


NUMBER = KeyDefinition("a number", _require_number, {"type": "number"})
_ONSET = time_axis(0)
_MOMENTS = _ONSET._replace(
    parse=lambda raw: _parse_moment(raw) if _names_phase(raw) else _ONSET.parse(raw),
    schema={"anyOf": [_ONSET.schema, _TABLES["place"]]},
)


def _parse_start(raw) -> Axis:
    # Returns the axis of the start of a fault: times, or positions in a phase of the operation. The
    # module `moments` later converts phases to milliseconds, which depend on the operator's motion.
    if not _names_phase(raw):
        # Such as 500, [500, 700] or { uniform = [0, 900] }.
        return _MOMENTS.parse_axis(raw)
    if set(raw) == {PHASE} and isinstance(raw[PHASE], str):
        # { phase = "fast" } is a random millisecond of the phase.
        return Axis(PHASE, (raw[PHASE],))
    shares = raw.get(SHARE)
    if isinstance(shares, list | tuple) and shares:
        # { phase = "fast", share = [0.2, 0.8] }
        return Axis(LIST, tuple(_parse_moment({**raw, SHARE: share}) for share in shares))
    return fixed_axis(_parse_moment(raw))


def _names_phase(raw) -> bool:
    # Returns whether a value is a table with a phase or a share, perhaps an incomplete table.
    return isinstance(raw, Mapping) and bool(raw.keys() & {PHASE, SHARE})


def _parse_moment(raw: Mapping[str, Any]) -> Moment:
    # Returns the moment of a table such as { phase = "fast", share = 0.5 }. Raises ValueError.
    phase, share = raw.get(PHASE), raw.get(SHARE)
    has_share = len(raw) == 2 and _is_number(share) and 0.0 <= share <= 1.0
    if not isinstance(phase, str) or not has_share:
        raise ValueError(
            f"got {format_value(dict(raw))}, expected a table such as"
            f' {{{PHASE} = "fast", {SHARE} = 0.5}}, in which {SHARE} is a number from 0 to 1'
        )
    return Moment(phase, float(raw[SHARE]))


if TYPE_CHECKING:
    Number = Value = Onset = Axis
else:
    Number = NUMBER._replace(forms=(*DISTRIBUTIONS, LIST)).annotation()
    Value = NUMBER.annotation()
    Onset = _MOMENTS.annotation(_parse_start)
