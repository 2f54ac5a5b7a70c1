"""Imports JAX at its first use, so that code that needs no JAX runs without it.

`from ravenjax.numbers.lazy import jax, jnp, lax` replaces `import jax`, `import jax.numpy as jnp`
and `from jax import lax`. Within `run_eagerly()`, without an argument, `jnp` and `lax` call
functions of NumPy. The code of the tick then computes plain numbers, without JAX. Within
`run_eagerly(array)` they call functions of the library of that array, NumPy or JAX.

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
        return _apply_in_float64(trigonometry.sin, x)

    @staticmethod
    def cos(x: Any) -> Any:
        return _apply_in_float64(trigonometry.cos, x)

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        # [()] makes a plain number of an array without axes.
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
        """Return a tree with the numbers of `yes()` where `condition` is true, else of `no()`. Both
        functions are called. Numbers and the condition may be arrays.
        """
        return tree.map_leaves(lambda a, b: np.where(condition, a, b)[()], yes(), no())


def _modulo(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    # Makes an operation of two integers an operation of two Uint32.
    return lambda x, y: Uint32(operation(x.number, y.number))


class Uint32:
    """Whole numbers modulo 2^32, stored as int64, because torch cannot compute with uint32."""

    def __init__(self, number: Any):
        self.number = number & 0xFFFFFFFF

    __add__ = _modulo(operator.add)
    __mul__ = _modulo(operator.mul)
    __xor__ = _modulo(operator.xor)
    __rshift__ = _modulo(operator.rshift)


class Arrays:
    """Functions of `jax.numpy` and `jax.lax` that fault injection uses, from another library. The
    library must follow the array API standard. Bit flips need a method `view`.
    """

    uint32 = Uint32

    def __init__(self, library: Any, array: Any):
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
        # This equals `lax.rem` if neither number is negative, as in fault injection.
        return x % y

    def bitcast_convert_type(self, x: Any, dtype: Any) -> Any:
        return x.view(dtype)


def _apply_in_float64(function: Callable[[Any], Any], x) -> Any:
    # Returns function(x), computed in float64 and rounded to the type of x, a number or an array.
    if np.ndim(x):
        return function(x.astype(np.float64)).astype(x.dtype)
    result_type = type(x) if isinstance(x, np.floating) else float
    return result_type(function(float(x)))


__all__ = ["call_when_jax_loads", "jax", "jnp", "lax", "run_eagerly"]


class _Replacements(threading.local):
    """The objects that replace JAX modules in this thread, by the name of the module."""

    by_module: Mapping[str, Any] = {}


_REPLACEMENTS = _Replacements()
_NUMPY_BY_MODULE = {"jax.numpy": Numpy(), "jax.lax": Lax()}
_LOADING = threading.RLock()
_PENDING_ACTIONS: list[Callable[[Any], Any]] = []
"""Actions to call when JAX is imported."""


def call_when_jax_loads(action: Callable[[Any], Any]) -> None:
    """Call `action(jax)` before this module first uses JAX, or now if JAX is already imported."""
    with _LOADING:
        _PENDING_ACTIONS.append(action)
    if "jax" in sys.modules:
        _import_module("jax")


def _import_module(name: str) -> Any:
    # Imports a module of JAX, and calls the actions of `call_when_jax_loads` first.
    if _PENDING_ACTIONS:
        jax_module = importlib.import_module("jax")
        # Another thread waits until all actions are done.
        with _LOADING:
            for action in _PENDING_ACTIONS:
                action(jax_module)
            _PENDING_ACTIONS.clear()
    return importlib.import_module(name)


@contextlib.contextmanager
def run_eagerly(array: Any = None) -> Iterator[Any]:
    """Context in which functions of `jnp` and `lax` return results immediately, because they
    compute with NumPy or with the library of `array`. Only the current thread is affected. array:
    an array of NumPy, JAX, torch or another library of the array API standard, or numbers, which
    become a NumPy array. Yield the array.
    """
    # The library of the array, by the array API standard; NumPy for numbers.
    library = getattr(array, "__array_namespace__", lambda: np)()
    # Arrays of torch do not name their library as the standard requires.
    if type(array).__module__.startswith("torch"):
        library = sys.modules["torch"]
    replacements: Mapping[str, Any] = _NUMPY_BY_MODULE
    if library is np:
        array = np.asarray(array)
    # JAX itself computes with its arrays.
    elif library.__name__ == "jax.numpy":
        replacements = {}
    else:
        replacements = dict.fromkeys(_NUMPY_BY_MODULE, Arrays(library, array))
    # A context may be inside another one.
    outer_replacements = _REPLACEMENTS.by_module
    _REPLACEMENTS.by_module = replacements
    try:
        yield array
    finally:
        _REPLACEMENTS.by_module = outer_replacements


class _LazyModule:
    """A JAX module that is imported at the first use of one of its names, or its replacement."""

    def __init__(self, name: str):
        self._name = name

    def __getattr__(self, name: str) -> Any:
        module = _REPLACEMENTS.by_module.get(self._name) or _import_module(self._name)
        return getattr(module, name)


if not TYPE_CHECKING:
    jax, jnp, lax = _LazyModule("jax"), _LazyModule("jax.numpy"), _LazyModule("jax.lax")
