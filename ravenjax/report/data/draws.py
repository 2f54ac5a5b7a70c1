"""Finds the groups of a campaign whose faults are drawn at random.

All other groups enumerate fixed values. Their rates have no confidence interval, because nothing is
sampled.
"""

from collections.abc import Mapping
from typing import Any

from ravenjax.vocabulary.effects import RANDOM

SAMPLED = ("random", "lhs", "sobol")
"""Designs in which a list of values is sampled too, not enumerated."""


def drawn_groups(config: Mapping[str, Any]) -> frozenset[str] | None:
    """Return the names of groups in which every fault has at least one drawn value, even if only
    its onset is drawn, or an effect that draws numbers itself.

    `config` has the form stored in a manifest, in which no group names hazards. Return None if it
    has no groups. Drawn parameters of the robot or operator do not count, because they do not
    change the fault.
    """
    if "group" not in config:
        return None
    return frozenset(str(group["name"]) for group in config["group"] if _draws(group))


def _draws(group: Mapping[str, Any]) -> bool:
    # A group with explicit runs sets each value individually.
    if group.get("run"):
        return False
    sampled = group.get("design") in SAMPLED
    return any(
        _is_random(fault.get("effect", ""))
        or any(_varies(value, sampled) for value in fault.values())
        for fault in group.get("fault", ())
    )


def _is_random(effect: Any) -> bool:
    """Return whether the effect, or each of a list, draws random numbers in each run."""
    return all(word in RANDOM for word in ([effect] if isinstance(effect, str) else effect))


def _varies(value: Any, sampled: bool) -> bool:
    if isinstance(value, Mapping):
        # A list is the only form of a value table that enumerates.
        return sampled or "list" not in value
    return sampled and (value == "all" or (isinstance(value, list | tuple) and len(value) > 1))
