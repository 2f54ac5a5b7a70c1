"""Names the numbers of a parameter record by paths, such as `motor_control.green.kp.shoulder`.

Each part of a path is a field of a record or named tuple. If a field has one entry per arm, the
next part may be the name of an arm; without this part the path means all arms. If a field has one
number per joint or axis, the next part may be the name of a joint or axis; without this part the
path means all of them.
"""

import dataclasses
import difflib
from collections.abc import Iterator
from typing import Any, NamedTuple

from ravenjax.numbers import tree
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, Vec

_AXES = ("x", "y", "z")


class _Step(NamedTuple):
    """One part of a full path: the name of a field, arm, joint, axis or number."""

    name: str
    optional: bool  # True if a path may leave out this step
    siblings: frozenset[str]  # names of all entries at this level, including this step


def _entries(node, setup: Setup) -> tuple[dict[str, Any], bool] | None:
    """Return the entries of a record or tuple by name, and whether a path may leave out the name:
    not that of a field, but that of an arm, joint or axis. Return None for a number.
    """
    fields = node._asdict() if hasattr(node, "_asdict") else {}
    if dataclasses.is_dataclass(node):
        fields = vars(node)
    if fields:
        entries = {}
        for name, item in fields.items():
            # Entries of a dict are named as if they were fields, in the order of `tree_leaves`.
            entries |= dict(sorted(item.items())) if isinstance(item, dict) else {name: item}
        # A field that this setup does not have is None.
        return {name: item for name, item in entries.items() if item is not None}, False
    if not isinstance(node, tuple):
        return None
    return dict(zip(_entry_names(node, setup), node, strict=True)), True


def _entry_names(node: tuple[Any, ...], setup: Setup) -> tuple[str, ...]:
    # Returns the names of a tuple's entries: joints, axes or arms, or else their numbers.
    if isinstance(node, Vec):
        if len(node) == len(setup.joints):
            return setup.joints
        if len(node) == len(_AXES):
            return _AXES
        if len(node) in setup.leading_joints:
            return setup.joints[: len(node)]
    # A tuple of numbers may by chance have the length of `arms`, so only other items are per arm.
    elif len(node) == len(setup.arms) and all(
        dataclasses.is_dataclass(item) or isinstance(item, Vec) for item in node
    ):
        return setup.arms
    return tuple(str(number) for number in range(len(node)))


def _walk(
    node, setup: Setup, above: tuple[_Step, ...] = ()
) -> Iterator[tuple[tuple[_Step, ...], Scalar]]:
    """Yield (steps, number) for each number of a record, in the order of `tree.tree_leaves`. Steps
    form the full path to the number. above: the steps to `node` itself.
    """
    named_entries = _entries(node, setup)
    if named_entries is None:
        yield above, node
        return
    entries, optional = named_entries
    siblings = frozenset(entries)
    for name, item in entries.items():
        yield from _walk(item, setup, (*above, _Step(name, optional, siblings)))


def _leads_to(path: str, steps: tuple[_Step, ...]) -> bool:
    """Return whether `path`, such as kp.shoulder, names the number at steps kp, gold, shoulder."""
    names = path.split(".")
    for step in steps:
        # A name that is none of this level's entries belongs to a later step: `shoulder` is no arm.
        # The path then has no name for this step, which is allowed only if the step is optional.
        if names and names[0] in step.siblings:
            if names.pop(0) != step.name:
                return False
        elif not step.optional:
            return False
    return not names


def _full_path(steps: tuple[_Step, ...]) -> str:
    return ".".join(step.name for step in steps)


def path_leaves(node: Any, setup: Setup) -> Iterator[tuple[str, Scalar]]:
    """Yield (full path, number) for each number of a record, in order."""
    for steps, number in _walk(node, setup):
        yield _full_path(steps), number


def named_numbers(node: Any, setup: Setup, path: str) -> dict[str, Scalar]:
    """Return all numbers of a record that `path` names, by full path and in order. Raise KeyError
    for an unknown path.
    """
    numbers = list(_walk(node, setup))
    named = {_full_path(steps): number for steps, number in numbers if _leads_to(path, steps)}
    if not named:
        names = sorted({without_arm(_full_path(steps), setup.arms) for steps, _ in numbers})
        close = difflib.get_close_matches(path, names, n=1, cutoff=0.4)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise KeyError(f"no parameter has the path {path!r}.{hint} See `ravenjax parameters`")
    return named


def assign_numbers(node: Any, setup: Setup, path: str, value: Scalar) -> Any:
    """Return the record with `value` at each number that `path` names. Raises KeyError."""
    replaced_paths = named_numbers(node, setup, path)
    leaves = path_leaves(node, setup)
    return tree.fill_tree(node, [value if p in replaced_paths else number for p, number in leaves])


def without_arm(path: str, arms: tuple[str, ...]) -> str:
    """Return a full path without the name of the arm."""
    return ".".join(part for part in path.split(".") if part not in arms)


def path_words(joints: tuple[str, ...]) -> frozenset[str]:
    """Return the names that numbers inside vectors can have: the joints, and x, y, z."""
    return frozenset((*joints, *_AXES))


def plain_path(path: str, arms: tuple[str, ...], joints: tuple[str, ...]) -> str:
    """Return a parameter's path without the arm, numbers, the joint and the axis: only fields."""
    # For example, plant.gold.stops.lower.shoulder gives plant.stops.lower.
    parts = [part for part in without_arm(path, arms).split(".") if not part.isdecimal()]
    # Only the last part can be a joint or an axis.
    if parts and parts[-1] in path_words(joints):
        parts = parts[:-1]
    return ".".join(parts)
