"""Imports JAX at its first use, so that code that needs no JAX runs without it.

`from ravenjax.numbers.lazy import jax, jnp, lax` replaces `import jax`, `import jax.numpy as jnp`
and `from jax import lax`. Within `at_once()`, `jnp` and `lax` call functions of NumPy. The code of
the tick then computes plain numbers, without JAX. `at_once(array)` uses the library of that array.

NumPy's results have the types and the bits that XLA gives on a CPU. Only sine and cosine differ:
they are those of `trigonometry`, with the same bits on every machine.
"""

import contextlib
import importlib
import operator
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
    from jax import lax


import numpy as np

from ravenjax.numbers import tree, trigonometry


class Numpy:
    """Functions of NumPy with the names of `jax.numpy`, for plain numbers and arrays."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    @staticmethod
    def sin(x: Any) -> Any:
        return _as(x, trigonometry.sin)

    @staticmethod
    def cos(x: Any) -> Any:
        return _as(x, trigonometry.cos)

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        return np.where(condition, yes, no)[()]


class Lax:
    """The functions of `jax.lax` that a tick uses, for plain numbers."""

    rem = np.fmod

    @staticmethod
    def convert_element_type(x: Any, dtype: Any) -> Any:
        return np.asarray(x).astype(dtype)[()]

    @staticmethod
    def bitcast_convert_type(x: Any, dtype: Any) -> Any:
        return np.asarray(x).view(dtype)[()]

    @staticmethod
    def cond(condition: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
        """Return the result of `yes` or of `no`. Both are computed. Numbers may be arrays."""
        return tree.map_leaves(lambda a, b: np.where(condition, a, b)[()], yes(), no())


def _modulo(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda x, y: Uint32(operation(x.number, y.number))


class Uint32:
    """Whole numbers modulo 2^32, stored as int64, because torch cannot compute with uint32."""

    def __init__(self, number: Any) -> None:
        self.number = number & 0xFFFFFFFF

    __add__ = _modulo(operator.add)
    __mul__ = _modulo(operator.mul)
    __xor__ = _modulo(operator.xor)
    __rshift__ = _modulo(operator.rshift)


class Arrays:
    """Functions of `jax.numpy` and `jax.lax` that fault injection uses, from another library.

    The library must follow the array API standard. Bit flips need a method `view`.
    """

    uint32 = Uint32

    def __init__(self, library: Any, array: Any) -> None:
        self._library, self._array = library, array

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)

    def asarray(self, x: Any, dtype: Any) -> Any:
        if dtype is Uint32:
            return Uint32(self.asarray(x, self._library.int64))
        return self._library.asarray(x, dtype=dtype, device=self._array.device)

    def arange(self, stop: int) -> Any:
        return self._library.arange(stop, device=self._array.device)

    def maximum(self, x: Any, y: Any) -> Any:
        return self._library.where(x > y, x, y)

    def convert_element_type(self, x: Any, dtype: Any) -> Any:
        return self.asarray(x.number if isinstance(x, Uint32) else x, dtype)

    def rem(self, x: Any, y: Any) -> Any:
        return x % y  # which is `lax.rem` if neither is negative

    def bitcast_convert_type(self, x: Any, dtype: Any) -> Any:
        return x.view(dtype)


def _as(x: Any, function: Callable[[Any], Any]) -> Any:
    if np.ndim(x):
        return function(x.astype(np.float64)).astype(x.dtype)
    return (type(x) if isinstance(x, np.floating) else float)(function(float(x)))


__all__ = ["at_once", "jax", "jnp", "lax", "when_loaded"]


class _Mode(threading.local):
    instead: Mapping[str, Any] = {}  # name of a JAX module -> its replacement


_MODE = _Mode()
_WITH_NUMPY = {"jax.numpy": Numpy(), "jax.lax": Lax()}
_LOADING = threading.RLock()
_WAITING: list[Callable[[Any], Any]] = []


def when_loaded(action: Callable[[Any], Any]) -> None:
    """Call `action(jax)` before JAX is first used, or now if JAX is already imported."""
    with _LOADING:
        _WAITING.append(action)
    if "jax" in sys.modules:
        _load("jax")


def _load(name: str) -> Any:
    # Imports a module of JAX. The first import also runs the actions that wait for JAX.
    if _WAITING:
        real = importlib.import_module("jax")
        # Another thread waits until all actions are done.
        with _LOADING:
            for action in _WAITING:
                action(real)
            _WAITING.clear()
    return importlib.import_module(name)


@contextlib.contextmanager
def at_once(array: Any = None) -> Iterator[Any]:
    """Within this block, `jnp` and `lax` compute with NumPy, in this thread.

    array: an array of JAX, torch or another library of the array API standard; its library is then
    used instead of NumPy. Yield the array; other types are converted to NumPy arrays.
    """
    library = getattr(array, "__array_namespace__", lambda: np)()
    if type(array).__module__.startswith("torch"):
        library = sys.modules["torch"]
    array = np.asarray(array) if library is np else array
    before, _MODE.instead = _MODE.instead, _WITH_NUMPY
    if library is not np:
        names = () if library.__name__ == "jax.numpy" else _WITH_NUMPY
        _MODE.instead = dict.fromkeys(names, Arrays(library, array))
    try:
        yield array
    finally:
        _MODE.instead = before


class _Late:
    """A JAX module that is imported at the first use of one of its names, or its replacement."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(_MODE.instead.get(self._name) or _load(self._name), name)


if not TYPE_CHECKING:
    jax, jnp, lax = _Late("jax"), _Late("jax.numpy"), _Late("jax.lax")
