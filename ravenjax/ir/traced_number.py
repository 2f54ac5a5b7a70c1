"""A number of a program that is being written: what is done with it is written down, in the types
that JAX would take.

With it, and with `traced_functions` for `jnp` and `lax`, code of a tick writes its program itself,
in a tenth of the time that it takes to import JAX, trace and lower. What is written is the same,
operation by operation. Types are those of JAX with 32-bit numbers. Whatever is not known here is
refused with `Untraceable`, and left to JAX.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ravenjax.ir import compounds, semantics
from ravenjax.ir.builder import Builder

BOOL, WEAK_INT, UINT, INT, WEAK_FLOAT, FLOAT = range(6)
"""Kinds of numbers, in JAX's order of promotion: of two, the result is of the later. A Python
number's is weak.
"""
DTYPES = ("bool", "int32", "uint32", "int32", "float32", "float32")
"""Types of the kinds."""
_FLOATS = (WEAK_FLOAT, FLOAT)
_KINDS = {
    "bool": BOOL,
    "int32": INT,
    "uint32": UINT,
    "float32": FLOAT,
    "int64": INT,
    "float64": FLOAT,
}
_LEAST, _MOST = -(2**31), 2**31 - 1


class Untraceable(NotImplementedError):
    """Something is done with a number that is not known here."""


def refused(what: str) -> Untraceable:
    """The error of something that is not known here."""
    return Untraceable(f"{what} is not known to the tracer without JAX")


def kind_of(dtype: Any) -> int:
    """The kind of a type that code names, wide ones being taken as narrow."""
    if dtype is None:  # a float's to NumPy, none to JAX
        raise refused("a type of None")
    try:
        name = dtype if type(dtype) is str else getattr(dtype, "name", None) or np.dtype(dtype).name
        return _KINDS[name]
    except (KeyError, TypeError):
        raise refused(f"type {dtype!r}") from None


class TracedNumber:
    """A number of the program that `builder` writes."""

    __slots__ = ("_index", "_value", "builder", "kind")
    __array_ufunc__ = None  # NumPy's numbers leave operators to this class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, builder: Builder, index: int | None, kind: int, value: Any = None) -> None:
        """index: its operation; None: it is the constant `value`, which is written where it is
        first used.
        """
        self.builder, self.kind, self._index, self._value = builder, kind, index, value

    @property
    def index(self) -> int:
        """Its operation."""
        if self._index is None:
            self._index = self.builder.constant(DTYPES[self.kind], self._value)
        return self._index

    @property
    def constant(self) -> Any:
        """The plain number that it is as long as it has not been written; None for any other."""
        return self._value if self._index is None else None

    @property
    def dtype(self) -> np.dtype:
        """Its type."""
        return np.dtype(DTYPES[self.kind])

    @property
    def shape(self) -> tuple[()]:
        """That of a single number."""
        return ()

    def astype(self, dtype: Any) -> TracedNumber:
        """As a number of that type."""
        return convert(self.builder, self, kind_of(dtype))

    def __add__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "add", self, other)

    def __radd__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "add", other, self)

    def __sub__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "sub", self, other)

    def __rsub__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "sub", other, self)

    def __mul__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "mul", self, other)

    def __rmul__(self, other: Any) -> TracedNumber:
        return arithmetic(self.builder, "mul", other, self)

    def __truediv__(self, other: Any) -> TracedNumber:
        return quotient(self.builder, self, other)

    def __rtruediv__(self, other: Any) -> TracedNumber:
        return quotient(self.builder, other, self)

    def __neg__(self) -> TracedNumber:
        return alone(self.builder, "neg", self)

    def __abs__(self) -> TracedNumber:
        return self if self.kind == UINT else alone(self.builder, "abs", self)

    def __invert__(self) -> TracedNumber:
        if self.kind in _FLOATS:
            raise refused("~ of a float")
        return TracedNumber(
            self.builder, self.builder.emit("not", DTYPES[self.kind], self.index), self.kind
        )

    def __and__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "and", self, other)

    def __rand__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "and", other, self)

    def __or__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "or", self, other)

    def __ror__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "or", other, self)

    def __xor__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "xor", self, other)

    def __rxor__(self, other: Any) -> TracedNumber:
        return bitwise(self.builder, "xor", other, self)

    def __lshift__(self, other: Any) -> TracedNumber:
        return shift(self.builder, "shl", "shl", self, other)

    def __rlshift__(self, other: Any) -> TracedNumber:
        return shift(self.builder, "shl", "shl", other, self)

    def __rshift__(self, other: Any) -> TracedNumber:
        return shift(self.builder, "sar", "shr", self, other)

    def __rrshift__(self, other: Any) -> TracedNumber:
        return shift(self.builder, "sar", "shr", other, self)

    def __eq__(self, other: Any) -> TracedNumber:  # type: ignore[override]
        return comparison(self.builder, "eq", self, other)

    def __ne__(self, other: Any) -> TracedNumber:  # type: ignore[override]
        return comparison(self.builder, "ne", self, other)

    def __lt__(self, other: Any) -> TracedNumber:
        return comparison(self.builder, "lt", self, other)

    def __le__(self, other: Any) -> TracedNumber:
        return comparison(self.builder, "le", self, other)

    def __gt__(self, other: Any) -> TracedNumber:
        return comparison(self.builder, "lt", self, other, turned=True)

    def __ge__(self, other: Any) -> TracedNumber:
        return comparison(self.builder, "le", self, other, turned=True)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what Python and NumPy look for on their own
            raise AttributeError(name)
        raise refused(f"a number's {name}")

    def _plain(self, *_: Any, **__: Any) -> Any:
        raise refused("a plain number made of one that is being traced")

    __bool__ = __int__ = __float__ = __index__ = __array__ = __len__ = __iter__ = __getitem__ = (
        _plain
    )
    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __pow__ = __rpow__ = __matmul__ = (
        __rmatmul__
    ) = __round__ = _plain


class TracedTable:
    """A table of a program: numbers in a row, of which single ones are looked up."""

    def __init__(self, builder: Builder, dtype: str, length: int) -> None:
        self._builder, self._kind, self._length = builder, kind_of(dtype), length
        self._table = builder.table(DTYPES[self._kind], length)
        self.shape = (length,)

    @property
    def at(self) -> _Entries:
        """As of a JAX array: `table.at[k].get(mode="clip", wrap_negative_indices=False)`."""
        return _Entries(self._look_up)

    def __getitem__(self, index: Any) -> TracedNumber:
        raise refused("a table's entry whose index may be beyond its ends")

    def _look_up(self, index: TracedNumber) -> TracedNumber:
        b, index = self._builder, operand(self._builder, index)
        read = compounds.nearest(b, self._length, lambda i: b.lookup(self._table, i), index.index)
        return TracedNumber(b, read, self._kind)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise refused(f"a table's {name}")


class _Entries:
    def __init__(self, look_up: Callable[[TracedNumber], TracedNumber]) -> None:
        self._look_up = look_up

    def __getitem__(self, index: Any) -> _Entry:
        if type(index) is not TracedNumber or index.kind not in (INT, WEAK_INT):
            raise refused(f"a table's entry {index!r}")
        return _Entry(self._look_up, index)


class _Entry:
    def __init__(
        self, look_up: Callable[[TracedNumber], TracedNumber], index: TracedNumber
    ) -> None:
        self._look_up, self._index = look_up, index

    def get(self, mode: str | None = None, wrap_negative_indices: bool = True) -> TracedNumber:
        """The number there, or at the nearest end."""
        if mode != "clip" or wrap_negative_indices:
            raise refused(f"a look-up of mode {mode!r}")
        return self._look_up(self._index)


# --- operands -------------------------------------------------------------------------------------
# --------------------


def operand(builder: Builder, x: Any) -> TracedNumber:
    """What stands in code as a number. Refused where it is one of another program: it means
    another operation there.
    """
    if type(x) is TracedNumber:
        if x.builder is not builder:
            raise refused("a number that was kept from another function")
        return x
    return TracedNumber(builder, None, plain_kind(x), x)


def written(builder: Builder, x: Any) -> TracedNumber:
    """The same as a number of the program, by now."""
    number = operand(builder, x)
    return TracedNumber(builder, number.index, number.kind)


def plain_kind(x: Any) -> int:
    """The kind of a number."""
    if isinstance(x, TracedNumber):
        return x.kind
    kind: type[Any] = type(x)
    if kind is float:
        return WEAK_FLOAT
    if kind is bool:
        return BOOL
    if isinstance(x, int | np.integer) and not _LEAST <= x <= _MOST:
        raise refused(f"the whole number {x} beyond 32 bits")
    if kind is int:
        return WEAK_INT
    if isinstance(x, np.generic | np.ndarray) and x.shape == ():
        return kind_of(x.dtype)
    raise refused(f"a number of type {kind.__name__}")


def convert(builder: Builder, x: Any, kind: int) -> TracedNumber:
    """A number as one of that kind."""
    x = operand(builder, x)
    source, dtype = DTYPES[x.kind], DTYPES[kind]
    if x.constant is not None:
        return TracedNumber(
            builder,
            None,
            kind,
            x.constant if source == dtype else _converted(x.constant, source, dtype),
        )
    return TracedNumber(
        builder, x.index if source == dtype else builder.emit("convert", dtype, x.index), kind
    )


def _converted(value: Any, source: str, dtype: str) -> Any:
    """A plain number in another type that holds it; others go by rules of Python, NumPy and JAX
    each.
    """
    if source == dtype:
        return value
    if source == "float32" and not _is_narrow(
        value
    ):  # JAX at times takes 2.9999999999 for an int as 2, at times as 3
        raise refused(f"the number {value} as {dtype}")
    if dtype in ("int32", "uint32") and not (0 if dtype == "uint32" else _LEAST) <= value <= _MOST:
        raise refused(f"the number {value} as {dtype}")
    return semantics.evaluate("convert", dtype, (np.asarray(value, source),))


def _is_narrow(value: Any) -> bool:
    """Whether a float is the same with 32 bits."""
    with np.errstate(over="ignore", under="ignore"):
        return value != value or float(np.float32(value)) == float(value)


def joined(builder: Builder, *numbers: Any) -> tuple[list[int], int]:
    """Operations of numbers in the kind that they share, and the kind."""
    operands = [operand(builder, x) for x in numbers]
    kind = max([x.kind for x in operands])
    return [x.index for x in [convert(builder, x, kind) for x in operands]], kind


# --- operations -----------------------------------------------------------------------------------
# --------------------


def arithmetic(builder: Builder, name: str, x: Any, y: Any) -> TracedNumber:
    """A sum, difference, product or extreme."""
    (i, j), kind = joined(builder, x, y)
    if kind == BOOL:
        raise refused(f"{name} of truth values")
    return TracedNumber(builder, builder.emit(name, DTYPES[kind], i, j), kind)


def quotient(builder: Builder, x: Any, y: Any) -> TracedNumber:
    """True division: a float, whatever is divided."""
    (i, j), kind = joined(builder, x, y)
    if kind not in _FLOATS:
        raise refused("true division of whole numbers")
    return TracedNumber(builder, builder.emit("div", "float32", i, j), kind)


def alone(builder: Builder, name: str, x: Any) -> TracedNumber:
    """An operation on one number that is not a truth value."""
    x = operand(builder, x)
    if x.kind == BOOL:
        raise refused(f"{name} of a truth value")
    return TracedNumber(builder, builder.emit(name, DTYPES[x.kind], x.index), x.kind)


def bitwise(builder: Builder, name: str, x: Any, y: Any) -> TracedNumber:
    """And, or, exclusive or."""
    (i, j), kind = joined(builder, x, y)
    if kind in _FLOATS:
        raise refused(f"{name} of floats")
    return TracedNumber(builder, builder.emit(name, DTYPES[kind], i, j), kind)


def shift(builder: Builder, signed: str, unsigned: str, x: Any, y: Any) -> TracedNumber:
    """A shift: the operation's name where numbers have a sign, and where they have none."""
    (i, j), kind = joined(builder, x, y)
    if kind not in (INT, WEAK_INT, UINT):
        raise refused("a shift of anything but whole numbers")
    return TracedNumber(
        builder, builder.emit(unsigned if kind == UINT else signed, DTYPES[kind], i, j), kind
    )


def comparison(builder: Builder, name: str, x: Any, y: Any, turned: bool = False) -> TracedNumber:
    """A comparison; turned: of y with x."""
    (i, j), _ = joined(builder, x, y)
    return TracedNumber(builder, builder.emit(name, "bool", *((j, i) if turned else (i, j))), BOOL)
