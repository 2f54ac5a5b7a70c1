"""Flattens nested records, tuples, lists and dicts and rebuilds them, in JAX's order, without JAX.

`None` has no leaves. Dicts are ordered by their sorted keys. Every other value is a leaf.
"""

import dataclasses
import itertools
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any


def tree_leaves(tree: Any) -> list[Any]:
    """Return every number of a tree, in order."""
    branches = _branches(tree)
    if branches is None:
        return [tree]
    return [leaf for branch in branches.values() for leaf in tree_leaves(branch)]


def named_leaves(tree: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted path, number) for every number of a tree, in order."""
    branches = _branches(tree)
    if branches is None:
        yield above, tree
    else:
        for name, branch in branches.items():
            yield from named_leaves(branch, f"{above}.{name}" if above else f"{name}")


def map_leaves(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """Return a tree of the same structure, with `function` applied to each leaf.

    The arguments of `function` are the leaf and the corresponding leaves of `others`. Raise
    ValueError if one of `others` has a different structure.
    """
    branches = _branches(tree)
    if branches is None:
        return function(tree, *others)
    rows = [_branches(other) for other in others]
    if any(row is None or len(row) != len(branches) for row in rows):
        raise ValueError(f"trees have different structures: {tree!r} and {others!r}")
    columns = (row.values() for row in (branches, *rows))  # pyright: ignore[reportOptionalMemberAccess]
    return _joined(tree, [map_leaves(function, *items) for items in zip(*columns, strict=True)])


def fill_tree(tree: Any, numbers: list[Any]) -> Any:
    """Return a tree with the structure of `tree` and these leaves, in order.

    Raise ValueError if the number of leaves is wrong.
    """
    if len(numbers) != (wanted := len(tree_leaves(tree))):
        raise ValueError(f"got {len(numbers)} numbers for a tree of {wanted} leaves")
    return tree_filler(tree)(numbers)


def tree_filler(tree: Any) -> Callable[[Sequence[Any]], Any]:
    """Return a function that maps leaves to a tree with this structure; faster than `fill_tree`."""
    places = itertools.count()

    def of(node: Any) -> Callable[[Sequence[Any]], Any]:
        # Returns a function that builds a node again from the sequence of all numbers.
        branches = _branches(node)
        if branches is None:
            return operator.itemgetter(next(places))
        parts = [of(branch) for branch in branches.values()]
        return lambda numbers: _joined(node, [part(numbers) for part in parts])

    return of(tree)


def _branches(tree: Any) -> dict[Any, Any] | None:
    # Children of a node by name, in JAX's order of pytrees; None for a leaf.
    if tree is None:
        return {}
    if isinstance(tree, tuple | list):
        return dict(enumerate(tree))
    if isinstance(tree, dict):
        return {key: tree[key] for key in sorted(tree)}
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        return {field.name: getattr(tree, field.name) for field in dataclasses.fields(tree)}
    return None


def _joined(tree: Any, branches: list[Any]) -> Any:
    # Makes a node like `tree` with other children.
    if tree is None:
        return None
    if isinstance(tree, dict):
        return dict(zip(sorted(tree), branches, strict=True))
    if isinstance(tree, tuple | list) and not hasattr(tree, "_fields"):  # not a named tuple
        return type(tree)(branches)
    return type(tree)(*branches)
