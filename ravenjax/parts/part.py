"""Runs a user's Python file in each tick: loads code, reads parameters, and checks steps.

The code runs while JAX traces it. Each mistake becomes one error that names file and line. Mistakes
are an exception in the file, a branch that depends on a value, an array in place of a single
number, and a state that changes its structure or types.
"""

from __future__ import annotations

import collections
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

from ravenjax.errors import UserError, format_value, suggest_name
from ravenjax.numbers import Scalar, lax, quantity, tree
from ravenjax.numbers.quantity import Quantity
from ravenjax.parts.reading import Reader
from ravenjax.vocabulary.parts import OwnSource

THRESHOLD = Quantity("of the score", 0, 1e6, "score above which the check trips")
"""The values that the threshold of a check may have."""

PARAMS, INIT, STEP = "params()", "init(params)", "step(params, state, view)"
"""Names of the functions of a user's file in error messages."""

SCORE = object()
"""Marks a result of `step` that is a single number. It is converted to a float."""

_KINDS = {"f": "float", "i": "int", "u": "int", "b": "bool"}
_CONVERSIONS = {"int": ": write to_int32(x), which truncates", "float": ": write jnp.float32(x)"}
_BRANCHES = {f"Tracer{what}ConversionError" for what in ("Bool", "Integer", "Array")}
_BRANCHES.add("ConcretizationTypeError")


class View:
    """The signals that a user's file can read at one point of the tick."""

    def __init__(self, at: str, numbers: Mapping[str, Any]):
        self.__dict__.update(numbers)
        self._at = at

    def __getattr__(self, name: str) -> Any:
        there = ", ".join(key for key in self.__dict__ if key != "_at")
        raise AttributeError(f"view has no {name} at {self.__dict__.get('_at')}; it has {there}")


class InPlace(NamedTuple):
    """A value that a user's file may return for a key."""

    like: Any  # numbers with the expected structure and types
    words: str  # the expected structure as text, for error messages


_MODULES: dict[OwnSource, types.ModuleType] = {}


def read_source(
    name: str,
    path: Path,
    what: str = "detector",
    require: Callable[[Path, bytes], None] = lambda *_: None,
) -> OwnSource:
    """Read a user's file, run it once, and return its source. what: "check" or "detector", for
    messages. require: function that raises UserError for code that must not run. Raise UserError
    with file and line if the file has a mistake.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise UserError(f"{path}: file of {what} {name!r} cannot be read ({reason})") from None
    source = OwnSource(name, str(path), text)
    module, contents = _run(source, None, require)
    source_with_imports = dataclasses.replace(source, files=tuple(sorted(contents.items())))
    _MODULES[source_with_imports] = module
    # This checks the functions of the file, so that a mistake is reported here.
    load_part(source_with_imports)
    return source_with_imports


def is_unchanged(source: OwnSource) -> bool:
    """Return whether the file, and the files of its folder that it loads, are unchanged."""
    path = Path(source.path)
    try:
        return path.read_text(encoding="utf-8") == source.text and all(
            (path.parent / name).read_bytes() == content for name, content in source.files
        )
    except (OSError, UnicodeDecodeError):
        return False


def hash_source(source: OwnSource) -> str:
    """Return the sha256 of the code and of the files in its folder that it loads or imports."""
    files = tuple((name, hashlib.sha256(content).hexdigest()) for name, content in source.files)
    return hashlib.sha256(repr((source.text, files)).encode()).hexdigest()


def _run(
    source: OwnSource,
    known: Mapping[str, bytes] | None,
    require: Callable[[Path, bytes], None] = lambda *_: None,
) -> tuple[types.ModuleType, dict[str, bytes]]:
    # Runs the user's file. Returns its module, and name -> content of the files that it reads.
    # known: these contents if the file ran before, else None. require: see `read_source`.
    # From `linecache`, a traceback shows the right line even if the file has changed since.
    lines = source.text.splitlines(keepends=True)
    linecache.cache[source.path] = (len(source.text), None, lines, source.path)
    path = Path(source.path)
    name = f"ravenjax_part_{hashlib.sha256(repr(source).encode()).hexdigest()[:16]}"
    reader = Reader(name, path.parent, known, require)
    with _blame(source, "the file"):
        return reader.read(source.text, path), reader.taken


@contextlib.contextmanager
def _blame(source: OwnSource, where: str) -> Iterator[None]:
    """Turn an exception in a file's code into a UserError that names file, line and `where`."""

    def is_own(file: str | None):
        # Files in the folder of the user's file are the user's, too.
        return file is not None and Path(file).parent == Path(source.path).parent

    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except UserError:
        raise
    except Exception as error:
        if isinstance(error, SyntaxError) and is_own(error.filename):
            location = f"{error.filename}:{error.lineno}"
            raise UserError(f"{location}: invalid Python ({error.msg})") from None
        frames = [f for f in traceback.extract_tb(error.__traceback__) if is_own(f.filename)]
        location = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else source.path
        if any(kind.__name__ in _BRANCHES for kind in type(error).__mro__):
            trouble = (
                "has an if, a while, a comparison chain or a conversion that depends on a value of"
                " the simulation. Write jnp.where(condition, a, b) instead of if, & instead of"
                " and, | instead of or"
            )
        else:
            first = next(iter(str(error).strip().splitlines()), "")
            trouble = f"raises {type(error).__name__}: {first}"
        raise UserError(f"{location}: {where} {trouble}") from error


@functools.lru_cache(maxsize=256)
def load_part(source: OwnSource) -> Part:
    """Load a user's file, or return it if it is already loaded. Raise UserError if the file has no
    `step`, or if its `params` is invalid.
    """
    if source not in _MODULES:
        _MODULES[source], _ = _run(source, dict(source.files))
    return Part(source, _MODULES[source])


class Part:
    """The functions of a user's file. All methods raise UserError."""

    def __init__(self, source: OwnSource, module: types.ModuleType):
        self.source = source
        self._functions = {name: getattr(module, name, None) for name in ("params", "init", "step")}
        if not callable(self._functions["step"]):
            expected = f"expected a function {STEP} that returns (state, score)"
            raise UserError(f"{source.path}: {expected}")
        self._require_ranges()

    def params(self) -> Any:
        """Return the parameters with the values of the file; None if it has no parameters."""
        with _blame(self.source, PARAMS):
            return self._call("params")

    def init(self, params: Any, float_type: str) -> Any:
        """Return the state before the first millisecond: floats of `float_type`, int32 and bool."""
        with _blame(self.source, INIT):
            state = self._call("init", params)
            numbers = []
            for name, value in tree.named_leaves(state):
                what = f"the state's {name or 'number'}"
                numbers.append(self._convert_number(INIT, what, value, float_type))
            return tree.fill_tree(state, numbers)

    def step(
        self, params: Any, state: Any, view: Any, float_type: str, **gives: Any
    ) -> tuple[Any, ...]:
        """Compute one millisecond. Return the state, then the other results in order.

        float_type: dtype name. gives: for each result, its expected form: SCORE for a score,
        numbers of the same structure and types, or a dict of InPlace for a dict with some of these
        keys. Keys whose numbers are the objects of `InPlace.like` itself are left out: the file
        did not change them.
        """
        with _blame(self.source, STEP):
            result = self._call("step", params, state, view)
            names_of_results = ("state", *gives)
            if type(result) is not tuple or len(result) != len(names_of_results):
                expected = ", ".join(names_of_results)
                raise self._error(STEP, f"returns {format_value(result)}, expected ({expected})")
            names = [name or "one number" for name, _ in tree.named_leaves(state)]
            expected = f"{', '.join(names) or 'nothing'}, as init returns"
            out = [self._check_structure("state", state, result[0], float_type, expected)]
            for (name, like), value in zip(gives.items(), result[1:], strict=True):
                if like is SCORE:
                    number = self._convert_number(STEP, name, value, float_type)
                    out.append(lax.convert_element_type(number, float_type))
                elif isinstance(like, dict):
                    out.append(self._check_keys(name, like, value, float_type))
                else:
                    out.append(self._check_structure(name, like, value, float_type))
            return tuple(out)

    def _call(self, name: str, *arguments) -> Any:
        # Calls a function of the file; None if the file does not define it.
        function = self._functions[name]
        return None if function is None else function(*arguments)

    def _check_keys(self, name: str, allowed: Mapping[str, InPlace], values, float_type: str):
        # Checks a dict of new numbers that the user's `step` returns for signals of `view`. Returns
        # those that are not the same objects as in `view`: the code is traced, so objects, not
        # values, show what changed. name: of this result of `step`. allowed: keys that it may have.
        keys = ", ".join(allowed)
        if not isinstance(values, dict):
            expected = f"expected a dict with some of the keys {keys}"
            raise self._error(STEP, f"returns {format_value(values)} for {name}, {expected}")
        numbers = {}
        for key, value in values.items():
            if key not in allowed:
                expected = f"expected some of {keys}{suggest_name(key, allowed)}"
                raise self._error(STEP, f"returns the key {key!r} in {name}, {expected}")
            declared = allowed[key]
            new = self._check_structure(key, declared.like, value, float_type, declared.words)
            pairs = zip(tree.tree_leaves(value), tree.tree_leaves(declared.like), strict=True)
            if not all(returned is current for returned, current in pairs):
                numbers[key] = new
        return numbers

    def _check_structure(self, name: str, like, values, float_type: str, words: str = "") -> Any:
        # Checks that values have the structure and types of `like`. Returns them in that structure.
        # name: of the result of `step`; words: its structure, "": made from `like`; for messages.
        wanted_leaves, given = list(tree.named_leaves(like)), list(tree.named_leaves(values))
        if [path for path, _ in wanted_leaves] != [path for path, _ in given]:
            count = len(wanted_leaves)
            several = f"a Vec or a record of {count} numbers, with the structure in view"
            words = words or ("one number" if count == 1 else several)
            raise self._error(STEP, f"returns {format_value(values)} for {name}, expected {words}")
        numbers = []
        for (path, wanted), (_, value) in zip(wanted_leaves, given, strict=True):
            what = f"{name}[{path}]" if path else name
            number, kind = self._convert_number(STEP, what, value, float_type), _kind(wanted)
            if _kind(number) != kind:
                expected = f"expected {kind}{_CONVERSIONS.get(str(kind), '')}"
                raise self._error(STEP, f"returns a {_kind(number)} for {what}, {expected}")
            numbers.append(number)
        return tree.fill_tree(like, numbers)

    def _convert_number(self, where: str, what: str, value, float_type: str) -> Scalar:
        # Checks a number that a user's file returned, and converts it to a JAX type.
        # where, what: function and number, for the message.
        if shape := getattr(value, "shape", ()):
            expected = "expected a single number: write a Vec for several numbers"
            raise self._error(where, f"returns an array of shape {shape} for {what}, {expected}")
        kind = _kind(value)
        if kind is None:
            expected = "expected a number: float, int or bool"
            raise self._error(where, f"returns {format_value(value)} for {what}, {expected}")
        dtype = {"float": float_type, "int": "int32", "bool": "bool"}[kind]
        return lax.convert_element_type(value, dtype)

    def _require_ranges(self):
        # Parameters of a user's file may be varied, so each needs a range.
        record = self.params()
        if record is None:
            return
        if not dataclasses.is_dataclass(record) or isinstance(record, type):
            expected = "expected a record of numbers, made with @record"
            raise self._error(PARAMS, f"returns {format_value(record)}, {expected}")
        ranges = dict(quantity.list_quantities(type(record)))
        for name, value in tree.named_leaves(record):
            # All entries of a tuple have one range, so the name has no numbers.
            words = [word for word in name.split(".") if not word.isdecimal()]
            limits = ranges.get(".".join(words))
            if limits is None:
                remedy = "annotate it with Quantity(unit, low, high, meaning)"
                trouble = f"has {name} without a range: {remedy}"
            elif not isinstance(value, int | float | np.number) or not math.isfinite(value):
                trouble = f"returns {format_value(value)} for {name}, expected a number"
            elif not limits.low <= float(value) <= limits.high:
                trouble = f"returns {value:g} for {name}, expected {limits}"
            else:
                continue
            raise self._error(PARAMS, trouble)

    def _error(self, where: str, said: str) -> UserError:
        # Returns an error with the line where the function `where` is defined. where: such as
        # "step(params, state, view)". said: what the function does wrong, a verb and its object.
        head = re.compile(rf"def {where.partition('(')[0]}\b")
        lines = enumerate(self.source.text.splitlines(), 1)
        line_suffix = next((f":{number}" for number, line in lines if head.match(line)), "")
        return UserError(f"{self.source.path}{line_suffix}: {where} {said}")


def _kind(value) -> str | None:
    # Returns "float", "int" or "bool" for a number of Python, NumPy or JAX, else None.
    if isinstance(value, bool | int | float):
        return type(value).__name__
    dtype = getattr(value, "dtype", None)
    return None if dtype is None else _KINDS.get(np.dtype(dtype).kind)


def part_quantities(source: OwnSource) -> tuple[tuple[str, Quantity], ...]:
    """Return (path, Quantity) of every number of the file that a campaign may vary."""
    record = load_part(source).params()
    return () if record is None else tuple(quantity.list_quantities(type(record)))


def part_parameters(sources: tuple[OwnSource, ...]) -> Any:
    """Return a named tuple of the files' records of parameters; None for a file without parameters.
    The tuple can be pickled, together with the code of the files. Raise UserError for mistakes.
    """
    records = (load_part(source).params() for source in sources)
    return _named_kind(tuple(source.name for source in sources), sources)(*records)


def named_parameters(names: tuple[str, ...], numbers: Any) -> Any:
    """Return a named tuple of these numbers, which can be pickled."""
    return _named_kind(names)(*numbers)


@functools.lru_cache(maxsize=256)
def _named_kind(names: tuple[str, ...], sources: tuple[OwnSource, ...] = ()) -> type[Any]:
    # Returns a class of named tuples with these fields. Record classes of a user's file exist only
    # in this process. So a pickle contains the text of the file and the numbers, and the other
    # process creates the classes again.
    kind = collections.namedtuple("Named", names)
    kind.__reduce__ = lambda named: (_restore_parameters, (names, sources, tree.tree_leaves(named)))  # type: ignore[method-assign]
    return kind


def _restore_parameters(
    names: tuple[str, ...], sources: tuple[OwnSource, ...], numbers: list[Any]
) -> Any:
    like = part_parameters(sources) if sources else named_parameters(names, numbers)
    return tree.fill_tree(like, numbers)
