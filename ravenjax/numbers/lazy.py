"""JAX, imported when it is first used: what a tick traced before needs none of it.

`from ravenjax.numbers.lazy import jax, jnp, lax` stands for `import jax`, `import jax.numpy as jnp`, `from jax import
lax`. Within `at_once()`, `jnp` and `lax` compute with NumPy: code of the tick then runs on plain numbers, without JAX.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ravenjax.numbers import plain

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
    from jax import lax

__all__ = ["at_once", "jax", "jnp", "lax", "when_loaded"]


class _Mode(threading.local):
    at_once = False


_MODE = _Mode()
_LOADING = threading.RLock()
_WAITING: list[Callable[[Any], Any]] = []


def when_loaded(action: Callable[[Any], Any]) -> None:
    """Call `action(jax)` before JAX is first used through this module; at once where JAX is imported already."""
    with _LOADING:
        _WAITING.append(action)
    if "jax" in sys.modules:
        _load("jax")


def _load(name: str) -> Any:
    if _WAITING:
        real = importlib.import_module("jax")
        with _LOADING:  # whoever comes second waits until all is done
            for action in _WAITING:
                action(real)
            _WAITING.clear()
    return importlib.import_module(name)


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Let `jnp` and `lax` of this thread compute with NumPy, on NumPy and Python numbers."""
    before, _MODE.at_once = _MODE.at_once, True
    try:
        yield
    finally:
        _MODE.at_once = before


class _Late:
    """A module of JAX's, imported at the first look at one of its names; with what stands for them in NumPy."""

    def __init__(self, name: str, numpy: Any = None) -> None:
        self._name, self._numpy = name, numpy

    def __getattr__(self, name: str) -> Any:
        if _MODE.at_once and self._numpy is not None:
            return getattr(self._numpy, name)
        return getattr(_load(self._name), name)


if not TYPE_CHECKING:
    jax, jnp, lax = _Late("jax"), _Late("jax.numpy", plain.Numpy()), _Late("jax.lax", plain.Lax())
