"""JAX, imported when it is first used: what needs none of it does without.

`from ravenjax.numbers.lazy import jax, jnp, lax` stands for `import jax`, `import jax.numpy as
jnp`, `from jax import lax`. Within `instead(...)` other functions stand for `jnp` and `lax`. Within
`at_once()` those of NumPy do: code of the tick then runs on plain numbers, without JAX.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ravenjax.numbers import plain

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
    from jax import lax

__all__ = ["at_once", "instead", "is_jax", "jax", "jnp", "lax", "when_loaded"]


class _Mode(threading.local):
    instead: Mapping[str, Any] = {}  # module of JAX's -> what stands for it


_MODE = _Mode()
_LOADING = threading.RLock()
_WAITING: list[Callable[[Any], Any]] = []


def when_loaded(action: Callable[[Any], Any]) -> None:
    """Call `action(jax)` before JAX is first used through this module; at once where JAX is
    imported already.
    """
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
def instead(numpy: Any, lax: Any) -> Iterator[None]:
    """Let `jnp` and `lax` be these objects in this thread."""
    before, _MODE.instead = _MODE.instead, {"jax.numpy": numpy, "jax.lax": lax}
    try:
        yield
    finally:
        _MODE.instead = before


def is_jax() -> bool:
    """Whether `jnp` and `lax` are JAX's own in this thread."""
    return not _MODE.instead


_NUMPY, _LAX = plain.Numpy(), plain.Lax()


def at_once() -> contextlib.AbstractContextManager[None]:
    """Let `jnp` and `lax` of this thread compute with NumPy, on NumPy and Python numbers."""
    return instead(_NUMPY, _LAX)


class _Late:
    """A module of JAX's, imported at the first look at one of its names; or what stands for it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(_MODE.instead.get(self._name) or _load(self._name), name)


if not TYPE_CHECKING:
    jax, jnp, lax = _Late("jax"), _Late("jax.numpy"), _Late("jax.lax")
