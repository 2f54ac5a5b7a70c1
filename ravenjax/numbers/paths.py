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
from typing import Any, cast

from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, Vec

_AXES = ("x", "y", "z")


def _entries(node: Any, setup: Setup) -> dict[str, tuple[Any, bool]] | None:
    """Name of each entry of `node` -> (entry, may the name be left out); None for a number."""
    if dataclasses.is_dataclass(node):
        fields = {f.name: getattr(node, f.name) for f in dataclasses.fields(node)}
        return {
            name: (value, False) for name, value in fields.items() if value is not None
        }  # None: not in this setup
    if isinstance(node, Vec):
        names = component_names(len(node), setup.joints, setup.leading_joints)
        return {name: (item, True) for name, item in zip(names, node, strict=True)}
    if fields := getattr(node, "_fields", ()):
        return {
            name: (item, False) for name, item in zip(fields, node, strict=True) if item is not None
        }
    if isinstance(node, tuple):
        per_arm = len(node) == len(setup.arms) and all(
            dataclasses.is_dataclass(n) or isinstance(n, Vec) for n in node
        )
        names = setup.arms if per_arm else tuple(str(i) for i in range(len(node)))
        return {name: (item, True) for name, item in zip(names, node, strict=True)}
    return None


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


def _rebuild(node: Any, entries: dict[str, tuple[Any, bool]], changed: dict[str, Any]) -> Any:
    if dataclasses.is_dataclass(node) and not isinstance(node, type):
        return dataclasses.replace(node, **changed)
    if hasattr(node, "_fields"):
        return cast(Any, node)._replace(**changed)
    items = [changed.get(name, item) for name, (item, _) in entries.items()]
    return Vec(items) if isinstance(node, Vec) else tuple(items)


def leaves(node: Any, setup: Setup, prefix: str = "") -> Iterator[tuple[str, Scalar]]:
    """(full path, number) of each number of a record, in order."""
    entries = _entries(node, setup)
    if entries is None:
        yield prefix, node
        return
    for name, (item, _) in entries.items():
        yield from leaves(item, setup, f"{prefix}.{name}" if prefix else name)


def assign(node: Any, setup: Setup, path: str, value: Scalar) -> Any:
    """A copy of the record with `value` at each number that `path` names.

    Raises KeyError, with a suggestion, when it names none.
    """
    new, hits = _assign(node, setup, path.split("."), value)
    if not hits:
        names = sorted({shorten(full, setup.arms) for full, _ in leaves(node, setup)})
        close = difflib.get_close_matches(path, names, n=1, cutoff=0.4)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise KeyError(f"no parameter is named {path!r}.{hint} `ravenjax parameters` lists them")
    return new


def _assign(node: Any, setup: Setup, path: list[str], value: Scalar) -> tuple[Any, int]:
    entries = _entries(node, setup)
    if entries is None:
        return (value, 1) if not path else (node, 0)
    if path and path[0] in entries:
        new, hits = _assign(entries[path[0]][0], setup, path[1:], value)
        return (_rebuild(node, entries, {path[0]: new}), hits) if hits else (node, 0)
    changed, hits = {}, 0
    for name, (item, optional) in entries.items():
        if optional:
            new, n = _assign(item, setup, path, value)
            changed[name], hits = new, hits + n
    return (_rebuild(node, entries, changed), hits) if hits else (node, 0)


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


def named(node: Any, setup: Setup, path: str) -> dict[str, Scalar]:
    """Full path -> value of each number that `path` names, in order. KeyError if it names none."""
    marked = leaves(assign(node, setup, path, _Mark()), setup)
    own = dict(leaves(node, setup))
    return {full: own[full] for full, value in marked if isinstance(value, _Mark)}


class _Mark:
    """Stands where a path leads."""
