"""Finds the groups of a campaign that draw their faults.

The others enumerate fixed values: nothing is sampled there, and a rate has no sampling interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SAMPLED = ("random", "lhs", "sobol")
"""Designs that draw from lists, too."""
_LISTED = "list"
"""The form of a table of values that enumerates; every other is a distribution."""
_EVERY = "all"
"""A channel that stands for the list of all."""


def groups(config: Mapping[str, Any]) -> frozenset[str] | None:
    """Names of the groups each of whose faults has something that was drawn, be it the onset alone;
    config: as in a manifest, without groups that name hazards. None where it has no groups.

    Drawn parameters of the robot or the operator do not count: they make no other fault.
    """
    if "group" not in config:
        return None
    return frozenset(str(group["name"]) for group in config["group"] if _draws(group))


def _draws(group: Mapping[str, Any]) -> bool:
    if group.get("run"):  # each run has single values of its own
        return False
    sampled = group.get("design") in SAMPLED
    return any(
        _varies(value, sampled) for fault in group.get("fault", ()) for value in fault.values()
    )


def _varies(value: Any, sampled: bool) -> bool:
    """Whether a key's value was drawn; sampled: lists are drawn from, too."""
    if isinstance(value, Mapping):
        return sampled or _LISTED not in value
    return sampled and (value == _EVERY or (isinstance(value, list | tuple) and len(value) > 1))
