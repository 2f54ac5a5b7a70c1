"""A part from its source: its functions, what a campaign may vary of it, and one millisecond of it,
checked.

The code runs as it is traced, so what is wrong with it is told as one error that names file and
line: whatever it raises, a branch on a value, an array where a single number belongs, a state that
changes its structure or types.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import linecache
import math
import re
import sys
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.errors import UserError, shown, suggestion
from ravenjax.numbers import quantity, tree
from ravenjax.numbers.lazy import lax
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.parts.reading import Reader
from ravenjax.vocabulary.parts import OwnSource

_KINDS = {"f": "float", "i": "int", "u": "int", "b": "bool"}
_BRANCHES = (
    "TracerBoolConversionError",
    "ConcretizationTypeError",
    "TracerIntegerConversionError",
    "TracerArrayConversionError",
)


class InPlace(NamedTuple):
    """What stands at a key that a part may give."""

    like: Any  # numbers in their structure, each of its kind
    words: str  # the same, for errors


class OwnPart(NamedTuple):
    """Functions of a part's file."""

    source: OwnSource
    params: Callable[[], Any]
    init: Callable[[Any], Any]
    step: Callable[[Any, Any, Any], tuple[Any, Scalar]]


def read(name: str, path: Path, what: str = "detector") -> OwnSource:
    """The source of the file at `path`, which is run once; what: kind of the part. Raises
    UserError, naming file and line."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise UserError(f"{path}: file of {what} {name!r} cannot be read ({reason})") from None
    source = OwnSource(name, str(path), text)
    module, contents = _run(source, None)
    whole = dataclasses.replace(source, files=tuple(sorted(contents.items())))
    _MODULES[whole] = module
    loaded(whole)
    return whole


def unchanged(source: OwnSource) -> bool:
    """Whether its file, and those that it takes from beside it, are what they were when it was
    read.
    """
    path = Path(source.path)
    try:
        return path.read_text(encoding="utf-8") == source.text and all(
            (path.parent / name).read_bytes() == content for name, content in source.files
        )
    except (OSError, UnicodeDecodeError):
        return False


def digest(source: OwnSource) -> str:
    """sha256 of the code, and of the files beside it that it loads or imports."""
    files = tuple((name, hashlib.sha256(content).hexdigest()) for name, content in source.files)
    return hashlib.sha256(repr((source.text, files)).encode()).hexdigest()


@functools.lru_cache(maxsize=256)
def loaded(source: OwnSource) -> OwnPart:
    """Its functions. Raises UserError where there is no `step`, or `params` is not as it should
    be.
    """
    module = _module(source)
    step: Callable[..., Any] | None = getattr(module, "step", None)
    if step is None or not callable(step):
        raise UserError(
            f"{source.path}: has no function step(params, state, view), which gives (state, score)"
        )
    own = OwnPart(
        source, getattr(module, "params", _nothing), getattr(module, "init", _nothing), step
    )
    _require_ranges(own)
    return own


def params(part: OwnPart) -> Any:
    """Its parameters at the values that the file gives. Raises UserError."""
    with _Blame(part.source, "params()"):
        return part.params()


def quantities(source: OwnSource) -> tuple[tuple[str, Quantity], ...]:
    """(path, what it may be) of every number that a campaign may vary of it."""
    record = params(loaded(source))
    return () if record is None else tuple(quantity.quantities(type(record)))


def init(part: OwnPart, params: Any, real: str) -> Any:
    """What it remembers before the first millisecond, each number of its kind: float of width
    `real`, int32, bool.
    """
    with _Blame(part.source, "init(params)"):
        return _numbers(part.source, "init(params)", part.init(params), real)


def step(part: OwnPart, params: Any, state: Any, view: Any, real: str) -> tuple[Any, Scalar]:
    """One millisecond of one arm: what it remembers, and its score as a float of width `real`.
    Raises UserError.
    """
    after, (score,) = _stepped(part, params, state, view, real, ("score",))
    return after, score


def limiting_step(
    part: OwnPart, params: Any, state: Any, view: Any, real: str, before: Vec
) -> tuple[Any, Scalar, Vec]:
    """As `step`, and what goes on in place of `before`: as many numbers, each of its kind.
    Raises UserError.
    """
    after, (score, values) = _stepped(
        part, params, state, view, real, ("score", ("values", before))
    )
    return after, score, values


def stage_step(
    part: OwnPart, params: Any, state: Any, view: Any, real: str, name: str, like: Any
) -> tuple[Any, Any]:
    """One millisecond of one arm of a stage: what it remembers, and what it gives, called `name`,
    in the structure of `like`, each number of its kind. Raises UserError."""
    after, (values,) = _stepped(part, params, state, view, real, ((name, like),))
    return after, values


def keyed_step(
    part: OwnPart,
    params: Any,
    state: Any,
    view: Any,
    real: str,
    name: str,
    like: Mapping[str, InPlace],
) -> tuple[Any, dict[str, Any]]:
    """One millisecond of a part that gives a dict, called `name`: what it remembers, and of each
    key that it has what it gives there, in the structure of `like`, each number of its kind. A key
    at which it gives the numbers of `like` back as they are counts as left out. Raises UserError.
    """
    after, (values,) = _stepped(part, params, state, view, real, ((name, like),))
    return after, values


def _stepped(
    part: OwnPart,
    params: Any,
    state: Any,
    view: Any,
    real: str,
    gives: tuple[str | tuple[str, Any], ...],
) -> tuple[Any, list[Any]]:
    """The state after `step`, and the other things that it gives: a score, or numbers like some
    that it is given.
    """
    with _Blame(part.source, STEP):
        result = part.step(params, state, view)
        names = ["state", *(one if isinstance(one, str) else one[0] for one in gives)]
        if not (
            isinstance(result, tuple) and not isinstance(result, Vec) and len(result) == len(names)
        ):
            raise _error(
                part.source,
                STEP,
                f"gives {shown(result)}, expected {_COUNTS[len(names)]} things:"
                f" ({', '.join(names)})",
            )
        after = _numbers(part.source, STEP, result[0], real)
        _require_alike(part.source, state, after)
        out: list[Any] = []
        for one, value in zip(gives, result[1:], strict=True):
            if isinstance(one, str):
                out.append(
                    lax.convert_element_type(_number(part.source, STEP, one, value, real), real)
                )
            elif isinstance(one[1], Mapping):
                out.append(_keyed(part.source, *one, value, real))
            else:
                out.append(_like(part.source, *one, value, real))
        return after, out


STEP = "step(params, state, view)"
"""The function of a part that is called in each millisecond."""

_COUNTS = {2: "two", 3: "three"}


def _keyed(
    source: OwnSource, name: str, like: Mapping[str, InPlace], values: Any, real: str
) -> dict[str, Any]:
    """Of each key of `values` the numbers there, as `like` has them; a key with the very numbers
    of `like` is none.
    """
    keys = ", ".join(like)
    if not isinstance(values, dict):
        raise _error(
            source,
            STEP,
            f"gives {shown(values)} for {name}, expected a dict with some of the keys {keys}",
        )
    for key in values:
        if key not in like:
            raise _error(
                source,
                STEP,
                f"gives the key {key!r} in {name}, expected some of {keys}{suggestion(key, like)}",
            )
    numbers = {
        key: _like(source, key, like[key].like, value, real, like[key].words)
        for key, value in values.items()
    }
    given_back = {
        key
        for key, value in values.items()
        if all(
            new is old
            for new, old in zip(tree.leaves(value), tree.leaves(like[key].like), strict=True)
        )
    }
    return {key: new for key, new in numbers.items() if key not in given_back}


def _like(source: OwnSource, name: str, like: Any, values: Any, real: str, words: str = "") -> Any:
    """Numbers that stand in the place of `like`: as many, each of its kind."""
    own, new = list(_named(like)), list(_named(values))
    if len(own) == 1 and not own[0][0]:
        own = [("", own[0][1])]
    if [place for place, _ in own] != [place for place, _ in new]:
        several = f"{len(own)} numbers, a Vec or a record as view has them"
        expected = words or ("one number" if len(own) == 1 else several)
        raise _error(source, STEP, f"gives {shown(values)} for {name}, expected {expected}")
    numbers = []
    for (place, wanted), (_, value) in zip(own, new, strict=True):
        what = f"{name}[{place}]" if place else name
        number, kind = _number(source, STEP, what, value, real), _kind(wanted)
        if _kind(number) != kind:
            raise _error(
                source,
                STEP,
                f"gives a {_kind(number)} for {what}, expected"
                f" {kind}{_CONVERSIONS.get(str(kind), '')}",
            )
        numbers.append(number)
    return tree.filled(like, numbers)


_CONVERSIONS = {"int": ": take to_int32(x), which truncates", "float": ": take jnp.float32(x)"}


def _nothing(*_: Any) -> None:
    """Stands for a function that a file does not have."""


# --- code ---

_MODULES: dict[OwnSource, types.ModuleType] = {}


def _module(source: OwnSource) -> types.ModuleType:
    """The module of a source, run once in a process."""
    if source not in _MODULES:
        _MODULES[source], _ = _run(source, dict(source.files))
    return _MODULES[source]


def _run(
    source: OwnSource, known: Mapping[str, bytes] | None
) -> tuple[types.ModuleType, dict[str, bytes]]:
    """The module of a source, and what it takes from its folder; known: as of `Reader`."""
    # so that a traceback shows the line also where the file has changed, or is on another machine
    lines = source.text.splitlines(keepends=True)
    linecache.cache[source.path] = (len(source.text), None, lines, source.path)
    path = Path(source.path)
    name = f"ravenjax_part_{hashlib.sha256(repr(source).encode()).hexdigest()[:16]}"
    reader = Reader(name, path.parent, known)
    with _Blame(source, "the file"):
        return reader.read(source.text, path), reader.taken


class _Blame:
    """Turns what a part's code raises into one UserError that names file and line; what it
    prints is no output.
    """

    def __init__(self, source: OwnSource, where: str) -> None:
        self._source, self._where = source, where
        self._aside = contextlib.redirect_stdout(sys.stderr)

    def __enter__(self) -> None:
        self._aside.__enter__()

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._aside.__exit__(kind, error, trace)
        if not isinstance(error, Exception) or isinstance(error, UserError):
            return
        if isinstance(error, SyntaxError) and self._is_own(error.filename):
            raise UserError(
                f"{error.filename}:{error.lineno}: is no Python ({error.msg})"
            ) from None
        frames = [frame for frame in traceback.extract_tb(trace) if self._is_own(frame.filename)]
        place = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else self._source.path
        if any(one.__name__ in _BRANCHES for one in type(error).__mro__):
            trouble = (
                "uses a value that is known only when the robot runs as if it were known now, in an"
                " if, a while, a comparison chain or a conversion; write jnp.where(condition, a,"
                " b), and & and | for and and or"
            )
        else:
            first = next(iter(str(error).strip().splitlines()), "")
            trouble = f"raises {type(error).__name__}: {first}"
        raise UserError(f"{place}: {self._where} {trouble}") from error

    def _is_own(self, file: str | None) -> bool:
        """Whether it is the part's file, or a module beside it."""
        return file is not None and Path(file).parent == Path(self._source.path).parent


# --- numbers ---


def _error(source: OwnSource, where: str, said: str) -> UserError:
    return UserError(f"{source.path}{_line(source, where)}: {where} {said}")


def _line(source: OwnSource, where: str) -> str:
    """`:7` for the function that `where` names; "" where it does not stand in the file as such."""
    head = re.compile(rf"def {re.escape(where.partition('(')[0])}\b")
    return next(
        (
            f":{number}"
            for number, line in enumerate(source.text.splitlines(), 1)
            if head.match(line)
        ),
        "",
    )


def _numbers(source: OwnSource, where: str, state: Any, real: str) -> Any:
    named = list(_named(state))
    numbers = [
        _number(source, where, f"the state's {name or 'number'}", value, real)
        for name, value in named
    ]
    return tree.filled(state, numbers)


def _number(source: OwnSource, where: str, what: str, value: Any, real: str) -> Scalar:
    """A single number: float of width `real`, int32 or bool."""
    try:
        shape, kind = np.shape(value), _kind(value)
    except (TypeError, ValueError):
        raise _error(source, where, f"gives {shown(value)} for {what}, expected a number") from None
    if shape:
        raise _error(
            source,
            where,
            f"gives an array of shape {shape} for {what}, expected a single number: take Vec for"
            " several",
        )
    if kind is None:
        raise _error(
            source,
            where,
            f"gives {np.dtype(value.dtype).name} for {what}, expected float, int or bool",
        )
    return lax.convert_element_type(value, {"float": real, "int": "int32", "bool": "bool"}[kind])


def _kind(value: Any) -> str | None:
    """float, int or bool; None for any other kind of number. TypeError for what is none."""
    if isinstance(value, bool | int | float):
        return type(value).__name__
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        raise TypeError(f"{value!r} is no number")
    return _KINDS.get(np.dtype(dtype).kind)


def _named(node: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """(name, number) of every number of a state, in the order of `tree.leaves`."""
    if node is None:
        return
    if dataclasses.is_dataclass(node) and not isinstance(node, type):
        entries = [(field.name, getattr(node, field.name)) for field in dataclasses.fields(node)]
    elif isinstance(node, dict):
        entries = [(str(key), node[key]) for key in sorted(node)]
    elif isinstance(node, tuple | list):
        entries = [(str(place), item) for place, item in enumerate(node)]
    else:
        yield above, node
        return
    for name, item in entries:
        yield from _named(item, f"{above}.{name}" if above else name)


def _require_alike(source: OwnSource, before: Any, after: Any) -> None:
    """UserError where a state has other numbers than before, or numbers of another kind."""
    own, new = list(_named(before)), list(_named(after))
    if [name for name, _ in own] != [name for name, _ in new] or type(before) is not type(after):
        gave, expected = (", ".join(name for name, _ in one) or "nothing" for one in (new, own))
        raise _error(source, STEP, f"gives a state of {gave}; init began with one of {expected}")
    for (name, old), (_, value) in zip(own, new, strict=True):
        kinds = [_kind(one) for one in (old, value)]
        if kinds[0] != kinds[1]:
            raise _error(
                source,
                STEP,
                f"makes the state's {name} a {kinds[1]}, it began as {kinds[0]}: write it so in"
                " init, or convert it",
            )


def _require_ranges(part: OwnPart) -> None:
    """UserError for a parameter without a Quantity, or outside of its own."""
    record = params(part)
    if record is None:
        return
    where = "params()"
    if not dataclasses.is_dataclass(record) or isinstance(record, type):
        raise _error(
            part.source,
            where,
            f"gives {shown(record)}, expected a record of numbers, made with @record",
        )
    ranges = dict(quantity.quantities(type(record)))
    for name, value in _named(record):
        path = ".".join(word for word in name.split(".") if not word.isdecimal())
        limits = ranges.get(path)
        if limits is None:
            raise _error(
                part.source,
                where,
                f"has {name} without a range: annotate it with Quantity(unit, low, high, meaning)",
            )
        if not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise _error(part.source, where, f"gives {shown(value)} for {name}, expected a number")
        if not limits.low <= float(value) <= limits.high:
            raise _error(part.source, where, f"gives {value:g} for {name}, expected {limits}")
