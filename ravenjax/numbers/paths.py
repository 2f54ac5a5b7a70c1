"""Names for the numbers of a parameter record: `plant.friction_scale`,
`motor_control.green.kp.shoulder`.

A path walks attributes, of records and of named tuples; where a field holds one entry an arm, an
arm's name picks one and leaving it out means all of them; where it holds a number a joint or an
axis, the joint's or axis' name picks one and leaving it out means all.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterator
from typing import Any, NamedTuple

from ravenjax.numbers import tree
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, Vec

_AXES = ("x", "y", "z")


class _Step(NamedTuple):
    """One step of a path to a number."""

    name: str
    optional: bool  # whether a path may leave it out
    siblings: frozenset[str]  # the names of all entries beside it, its own among them


def _entries(node: Any, setup: Setup) -> tuple[dict[str, Any], bool] | None:
    """The entries of `node` by name, and whether their names may be left out; None for a number."""
    fields = getattr(node, "_fields", ())
    if dataclasses.is_dataclass(node):
        fields = [field.name for field in dataclasses.fields(node)]
    if fields:
        entries = {name: getattr(node, name) for name in fields}
        # None: not in this setup.
        return {name: item for name, item in entries.items() if item is not None}, False
    if not isinstance(node, tuple):
        return None
    names = tuple(map(str, range(len(node))))
    if isinstance(node, Vec):
        names = component_names(len(node), setup.joints, setup.leading_joints)
    elif len(node) == len(setup.arms) and all(
        dataclasses.is_dataclass(item) or isinstance(item, Vec) for item in node
    ):
        names = setup.arms
    return dict(zip(names, node, strict=True)), True


def _walk(
    node: Any, setup: Setup, above: tuple[_Step, ...] = ()
) -> Iterator[tuple[tuple[_Step, ...], Scalar]]:
    """The steps to each number of a record, and the number, in the order of `tree.leaves`."""
    found = _entries(node, setup)
    if found is None:
        yield above, node
        return
    entries, optional = found
    siblings = frozenset(entries)
    for name, item in entries.items():
        yield from _walk(item, setup, (*above, _Step(name, optional, siblings)))


def _leads_to(path: str, steps: tuple[_Step, ...]) -> bool:
    """Whether `path` names the number at the end of these steps."""
    names = path.split(".")
    for step in steps:
        if names and names[0] in step.siblings:
            if names.pop(0) != step.name:
                return False
        elif not step.optional:
            return False
    return not names


def _full(steps: tuple[_Step, ...]) -> str:
    return ".".join(step.name for step in steps)


def component_names(
    length: int, joints: tuple[str, ...], leading: tuple[int, ...]
) -> tuple[str, ...]:
    """Names of the numbers of a vector: of all joints, of an axis each, of the first joints, else
    their places.

    leading: lengths of vectors that are of the first joints only.
    """
    if length == len(joints):
        return joints
    if length == len(_AXES):
        return _AXES
    if length in leading:
        return joints[:length]
    return tuple(str(i) for i in range(length))


def leaves(node: Any, setup: Setup) -> Iterator[tuple[str, Scalar]]:
    """(full path, number) of each number of a record, in order."""
    for steps, number in _walk(node, setup):
        yield _full(steps), number


def named(node: Any, setup: Setup, path: str) -> dict[str, Scalar]:
    """Full path -> value of each number that `path` names, in order.

    Raises KeyError, with a suggestion, when it names none.
    """
    numbers = list(_walk(node, setup))
    found = {_full(steps): number for steps, number in numbers if _leads_to(path, steps)}
    if not found:
        names = sorted({shorten(_full(steps), setup.arms) for steps, _ in numbers})
        close = difflib.get_close_matches(path, names, n=1, cutoff=0.4)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise KeyError(f"no parameter is named {path!r}.{hint} `ravenjax parameters` lists them")
    return found


def assign(node: Any, setup: Setup, path: str, value: Scalar) -> Any:
    """A copy of the record with `value` at each number that `path` names. KeyError as `named`."""
    replaced = named(node, setup, path)
    numbers = leaves(node, setup)
    return tree.filled(node, [value if full in replaced else x for full, x in numbers])


def shorten(path: str, arms: tuple[str, ...]) -> str:
    """A full path without the name of an arm."""
    return ".".join(part for part in path.split(".") if part not in arms)


def components(joints: tuple[str, ...]) -> frozenset[str]:
    """Names of the numbers inside vectors of a robot with these joints."""
    return frozenset((*joints, *_AXES))


def plain(path: str, arms: tuple[str, ...], joints: tuple[str, ...]) -> str:
    """A parameter's path without arm, number of a set, joint or axis."""
    parts = [part for part in shorten(path, arms).split(".") if not part.isdecimal()]
    return ".".join(parts[:-1] if parts[-1:] and parts[-1] in components(joints) else parts)
