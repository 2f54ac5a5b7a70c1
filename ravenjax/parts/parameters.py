"""Parameters of several parts, each by its part's name; they travel between processes with their
code.
"""

from __future__ import annotations

import collections
import functools
from typing import Any

from ravenjax.numbers import tree
from ravenjax.parts import part
from ravenjax.vocabulary.parts import OwnSource


def of(sources: tuple[OwnSource, ...]) -> Any:
    """A named tuple of the records that the files give, each None where its file has none.
    Raises UserError.
    """
    return _kind(sources)(*(part.params(part.loaded(source)) for source in sources))


def named(names: tuple[str, ...], numbers: Any) -> Any:
    """A named tuple of these numbers; it travels between processes."""
    return _named_kind(names)(*numbers)


@functools.lru_cache(maxsize=256)
def _named_kind(names: tuple[str, ...]) -> type[Any]:
    kind = collections.namedtuple("Named", names)
    kind.__reduce__ = lambda own: (named, (names, tuple(own)))  # type: ignore[method-assign]
    return kind


@functools.lru_cache(maxsize=256)
def _kind(sources: tuple[OwnSource, ...]) -> type[Any]:
    # Records of a file are classes that no other process has: there they come from its text, as
    # numbers do from here.
    kind = collections.namedtuple("Own", [source.name for source in sources])
    kind.__reduce__ = lambda own: (_restored, (sources, tree.leaves(own)))  # type: ignore[method-assign]
    return kind


def _restored(sources: tuple[OwnSource, ...], numbers: list[Any]) -> Any:
    return tree.filled(of(sources), numbers)
