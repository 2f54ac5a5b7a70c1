"""Imports JAX at its first use, so that code that needs no JAX runs without it.

`from ravenjax.numbers.lazy import jax, jnp, lax` replaces `import jax`, `import jax.numpy as jnp`
and `from jax import lax`. Within `at_once()`, functions of NumPy take the place of `jnp` and `lax`.
Code of the tick then runs on plain numbers, without JAX.

NumPy's results have the types and the bits that XLA gives on a CPU. Sine and cosine are the
exception: they are those of `trigonometry`, the same on every host.
"""

import contextlib
import importlib
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
    """Functions of NumPy under the names of `jax.numpy`, for plain numbers or arrays of them."""

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

    @staticmethod
    def convert_element_type(x: Any, dtype: Any) -> Any:
        return np.asarray(x).astype(dtype)[()]

    @staticmethod
    def cond(condition: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
        """Return the result of `yes` or of `no`. Both are computed; their numbers may be arrays."""
        return tree.map_leaves(lambda a, b: np.where(condition, a, b)[()], yes(), no())


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
    """Call `action(jax)` before JAX is first used through this module, or now if it is there."""
    with _LOADING:
        _WAITING.append(action)
    if "jax" in sys.modules:
        _load("jax")


def _load(name: str) -> Any:
    if _WAITING:
        real = importlib.import_module("jax")
        with _LOADING:  # a second thread waits until all actions are done
            for action in _WAITING:
                action(real)
            _WAITING.clear()
    return importlib.import_module(name)


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Make `jnp` and `lax` compute with NumPy in this thread, on NumPy and Python numbers."""
    before, _MODE.instead = _MODE.instead, _WITH_NUMPY
    try:
        yield
    finally:
        _MODE.instead = before


class _Late:
    """A JAX module that is imported when a name is first looked up, or its replacement."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(_MODE.instead.get(self._name) or _load(self._name), name)


if not TYPE_CHECKING:
    jax, jnp, lax = _Late("jax"), _Late("jax.numpy"), _Late("jax.lax")
