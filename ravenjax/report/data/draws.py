"""Finds the groups of a campaign whose faults are drawn at random.

All other groups enumerate fixed values. Nothing is sampled, so their rates have no interval.
"""

from collections.abc import Mapping
from typing import Any

from ravenjax.vocabulary.effects import RANDOM

SAMPLED = ("random", "lhs", "sobol")
"""Designs in which a list of values is sampled too, not enumerated."""


def drawn_groups(config: Mapping[str, Any]) -> frozenset[str] | None:
    """Return the names of the groups whose faults are drawn at random; None without groups.

    A fault is drawn if at least one of its values is drawn, such as its start, or if its effect
    draws random numbers. Drawn parameters of the robot or operator do not count, because they do
    not change the fault. config: campaign as stored in a manifest, with all hazards expanded.
    """
    if "group" not in config:
        return None
    return frozenset(str(group["name"]) for group in config["group"] if _has_drawn_fault(group))


def _has_drawn_fault(group: Mapping[str, Any]) -> bool:
    # Returns whether a value of a fault is drawn at random, or its effect draws random numbers.
    # Entries of [[group.run]] enumerate their faults.
    if group.get("run"):
        return False
    samples_lists = group.get("design") in SAMPLED
    for fault in group.get("fault", ()):
        effect = fault.get("effect", "")
        # A list of effects counts if all of them draw random numbers.
        if all(word in RANDOM for word in ([effect] if isinstance(effect, str) else effect)):
            return True
        if any(_is_drawn(value, samples_lists) for value in fault.values()):
            return True
    return False


def _is_drawn(value, samples_lists: bool) -> bool:
    # Returns whether runs draw this value of a key at random. samples_lists: the design draws one
    # value from each list; other designs use every value of a list in turn.
    if isinstance(value, Mapping):
        # { uniform = [0, 9] } is drawn in any design, { list = [1, 2] } only from sampled lists.
        return samples_lists or "list" not in value
    has_choice = isinstance(value, list | tuple) and len(value) > 1
    return samples_lists and (value == "all" or has_choice)
