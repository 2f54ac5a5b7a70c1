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
    """Yield (dotted path, number) for every number of a tree, in order. above: path of `tree`
    itself, with which the paths begin.
    """
    branches = _branches(tree)
    if branches is None:
        yield above, tree
    else:
        for name, branch in branches.items():
            yield from named_leaves(branch, f"{above}.{name}" if above else f"{name}")


def map_leaves(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """Return a tree of the same structure, with `function` applied to each leaf. The arguments of
    `function` are the leaf and the corresponding leaves of `others`. Raise ValueError if one of
    `others` has a different structure.
    """
    branches = _branches(tree)
    if branches is None:
        return function(tree, *others)
    # For each tree, its children in order.
    columns = [list(branches.values())]
    for other in others:
        other_branches = _branches(other)
        if other_branches is None or len(other_branches) != len(branches):
            raise ValueError(f"trees have different structures: {tree!r} and {others!r}")
        columns.append(list(other_branches.values()))
    mapped = [map_leaves(function, *children) for children in zip(*columns, strict=True)]
    return _rebuild_node(tree, mapped)


def fill_tree(tree: Any, numbers: list[Any]) -> Any:
    """Return a tree with the structure of `tree`, whose leaves are `numbers` in order. Raise
    ValueError if the number of leaves is wrong.
    """
    leaf_count = len(tree_leaves(tree))
    if len(numbers) != leaf_count:
        raise ValueError(f"got {len(numbers)} numbers for a tree of {leaf_count} leaves")
    return tree_filler(tree)(numbers)


def tree_filler(tree: Any) -> Callable[[Sequence[Any]], Any]:
    """Return a function that takes a sequence of leaves, and returns a tree with these leaves and
    the structure of `tree`. To fill many trees, it is faster than `fill_tree`.
    """
    leaf_indices = itertools.count()

    def make_filler(node) -> Callable[[Sequence[Any]], Any]:
        # Returns a function that builds `node` again from the sequence of all leaves of the tree.
        branches = _branches(node)
        if branches is None:
            return operator.itemgetter(next(leaf_indices))
        fillers = [make_filler(branch) for branch in branches.values()]
        return lambda numbers: _rebuild_node(node, [filler(numbers) for filler in fillers])

    return make_filler(tree)


def _branches(tree) -> dict[Any, Any] | None:
    # Returns the children of a node by name, in JAX's order of pytrees; None for a leaf.
    if tree is None:
        return {}
    if isinstance(tree, tuple | list):
        return dict(enumerate(tree))
    if isinstance(tree, dict):
        return {key: tree[key] for key in sorted(tree)}
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        return {field.name: getattr(tree, field.name) for field in dataclasses.fields(tree)}
    return None


def _rebuild_node(node, children: list[Any]) -> Any:
    # Returns a node of the same type and names as `node`, with other children.
    if node is None:
        return None
    if isinstance(node, dict):
        return dict(zip(sorted(node), children, strict=True))
    # Named tuples and dataclasses take each child as an argument.
    if isinstance(node, tuple | list) and not hasattr(node, "_fields"):
        return type(node)(children)
    return type(node)(*children)
