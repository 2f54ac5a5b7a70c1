"""Expands a group of a campaign file that names hazards into ordinary groups, one for each case.

    [[group]]
    name = "library"
    hazards = ["C09", "L7"]     # ids and layers, or "all": every hazard that can be simulated
    start_ms = 1200             # optional, as are arm, value, duration_ms: replaces the library's

Groups without `hazards` are left unchanged. The new groups are checked like any other group.

In a campaign with both arms, a hazard of the gold or the green arm acts on that arm. A hazard of
both arms acts on both in the same run. Any other hazard gets one group for each arm, with -gold or
-green at the end of its name. The key `arm` overrides this. Sites without an arm get one group.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax import resources, robots
from ravenjax.errors import UserError, describe_unknown_name, format_value, suggest_name
from ravenjax.hazards import library
from ravenjax.hazards.library import Case, Hazard, LibraryFault
from ravenjax.vocabulary.effects import EFFECTS
from ravenjax.vocabulary.robot import Robot

Table = dict[str, Any]
"""A group or a whole campaign, by key."""
KEY = "hazards"
ALL = "all"
_TABLES = resources.read_tables(__file__, "expansion.toml")
OVERRIDES, PASSED_ON = _TABLES["overrides"], _TABLES["passed_on"]
"""Keys of faults that a group may set for all its hazards, and keys that it passes on."""
KEYS: dict[str, str] = _TABLES["keys"] | OVERRIDES | PASSED_ON
"""Keys that a group with hazards may have."""
_CROSSED = ("value", "start_ms", "duration_ms", "every_ms")
"""Keys whose values are combined if several channels are faulty in the same run."""

LARGEST = 1e300
"""Largest magnitude of a value that is divided among channels."""


class WrongGroup(UserError):
    """Raised for a group with hazards that cannot be expanded.

    `key` is the wrong key of the group, or of the file if `expand_tables` raised the error.
    """

    def __init__(self, key: str | tuple[str | int, ...], message: str):
        self.key, self.message = (key,) if isinstance(key, str) else key, message
        super().__init__(f"{self.key[-1]}: {message}")


def expand_tables(raw: Mapping[str, Any], robot: Robot) -> tuple[Table, list[int]]:
    """Return a campaign's tables with only ordinary groups, and the index of each group's origin.
    Groups that are not a list of tables are left for later checks. Raise WrongGroup.
    """
    groups = raw.get("group")
    if not isinstance(groups, list) or not all(isinstance(group, Mapping) for group in groups):
        return dict(raw), []
    campaign = raw.get("campaign")
    arms = campaign.get("arms") if isinstance(campaign, Mapping) else None
    # Invalid arms are refused by later checks.
    listed_arms = arms if isinstance(arms, list | tuple) else ()
    valid_arms = listed_arms if all(arm in robot.arms for arm in listed_arms) else ()
    tables: list[Table] = []
    indices_in_file = []
    for number, group in enumerate(groups):
        try:
            expanded = expand_group(group, valid_arms, robot)
        except WrongGroup as error:
            raise WrongGroup(("group", number, *error.key), error.message) from None
        tables += expanded
        indices_in_file += [number] * len(expanded)
    return {**raw, "group": tables}, indices_in_file


def expand_group(
    group: Mapping[str, Any], arms: Sequence[str] = (), robot: Robot = robots.USUAL
) -> list[Table]:
    """Return the ordinary groups of a table [[group]] of a campaign file with these arms. Their
    names are GROUP/ID, or GROUP/ID-CASE if a hazard has several cases. If each arm has a separate
    group, the name ends in -ARM. arms: () for a campaign with one arm. Raise WrongGroup.
    """
    if KEY not in group:
        return [dict(group)]
    for key in group:
        if key not in KEYS:
            message = describe_unknown_name("key", key, KEYS)
            raise WrongGroup(key, f"a group that names hazards has an {message}")
    if not isinstance(group.get("name"), str):
        raise WrongGroup("name", "missing: name of the group in tables and in the report")
    return [
        table
        for hazard in select_hazards(group[KEY], robot)
        for case in hazard.case
        for table in _expand_case(group, hazard, case, arms)
    ]


def select_hazards(words: Any, robot: Robot = robots.USUAL) -> list[Hazard]:
    """Return the hazards that ids, layers and "all" name, in order. Raises WrongGroup."""
    listed = _as_list(words)
    if not listed or not all(isinstance(word, str) for word in listed):
        raise WrongGroup(
            KEY,
            f'got {format_value(words)}, expected ids and layers, such as ["C09", "L7"], or "all"',
        )
    if not library.all_hazards(robot):
        raise WrongGroup(KEY, f"robot {robot.name!r} has no hazard library; use the key 'fault'")
    ids = {row.id for word in listed for row in _hazards_named(word, robot)}
    return [row for row in library.all_hazards(robot) if row.id in ids]


def hazard_words(robot: Robot) -> list[str]:
    """Return the words that `hazards` may have: "all", layers, and ids that can be simulated."""
    rows = [row for row in library.all_hazards(robot) if row.runnable]
    return [ALL, *dict.fromkeys(row.layer for row in rows), *(row.id for row in rows)]


def _hazards_named(word: str, robot: Robot) -> list[Hazard]:
    # Returns the hazards that a word names and that can be simulated, or raises WrongGroup.
    named = [row for row in library.all_hazards(robot) if word in (ALL, row.id, row.layer)]
    if runnable := [row for row in named if row.runnable]:
        return runnable
    if named:
        title, reason = named[0].title, named[0].documented_only
        raise WrongGroup(KEY, f"{word} ({title}) cannot be simulated: {reason}")
    hint = suggest_name(word, hazard_words(robot))
    raise WrongGroup(KEY, f"unknown hazard {word!r}, expected an id, a layer or {ALL!r}{hint}")


def _expand_case(group: Mapping[str, Any], hazard: Hazard, case: Case, arms: Sequence[str]):
    # Yields the ordinary groups of a hazard's case, one for each choice of faulty arms.
    name = f"{hazard.id}-{case.name}" if case.name else hazard.id
    overrides = {key: group[key] for key in OVERRIDES if key in group}
    per_arm = any(fault.declared.per_arm for fault in case.fault)
    arm = overrides.pop("arm", None)
    choices = _arm_choices(hazard, arm, arms) if per_arm else [("", ())]
    for suffix, faulty_arms in choices:
        for key, message in _find_override_mistakes(case, overrides, faulty_arms):
            raise WrongGroup(key, f"{name} {message}")
        # A fault on several channels (`along`) or arms in a run has paired lists of values.
        is_paired = case.fault[0].along or len(faulty_arms) > 1
        slots = (_expand_fault(fault, overrides, faulty_arms) for fault in case.fault)
        table = {
            "name": f"{group['name']}/{name}{suffix}",
            "design": "zip" if is_paired else case.design,
            "fault": list(itertools.chain(*slots)),
        }
        runs = {} if case.runs is None else {"runs": case.runs}
        yield table | runs | {key: group[key] for key in PASSED_ON if key in group}


def _arm_choices(hazard: Hazard, arm, arms: Sequence[str]):
    """Return (suffix of the name, faulty arms) for each group of a case; () means the only arm.
    arm: the user's key `arm`, one arm or a list; None: the hazard determines the arms.
    """
    if arm is not None:
        # An empty list is kept as if it were an arm; `_find_override_mistakes` reports it.
        named = _as_list(arm) or [arm]
        return [(f"-{name}" if len(named) > 1 else "", (name,)) for name in named]
    if len(arms) < 2:
        return [("", ())]
    if hazard.arm in arms:
        return [("", (hazard.arm,))]
    if hazard.arm == "both":
        return [("", tuple(arms))]
    return [(f"-{name}", (name,)) for name in arms]


def _find_override_mistakes(case: Case, overrides: Mapping[str, Any], arms: Sequence[Any]):
    """Yield (key, message) for each override that a case does not permit. arms: faulty arms."""
    first, *more_faults = case.fault
    if "value" in overrides and more_faults:
        yield "value", f"has faults on {len(case.fault)} channels with different values"
    if "value" in overrides and not EFFECTS[first.effect].takes_value:
        yield "value", f"has effect {first.effect!r}, which has no value"
    # `_arm_choices` keeps an empty list as an arm.
    if [] in arms:
        yield "arm", "has an empty list, expected at least one value"
    # `along` divides the value of one fault among several channels.
    acts_on_several = more_faults or first.along or len(arms) > 1
    for key, value in overrides.items():
        got = format_value(value)
        if value == []:
            yield key, "has an empty list, expected at least one value"
        # A dict is a distribution, whose draws would differ between channels and between arms.
        if acts_on_several and isinstance(value, dict):
            what = "both arms" if len(arms) > 1 else "several channels"
            yield key, f"has faults on {what} in the same run, expected numbers, got {got}"
        if more_faults and isinstance(value, list):
            yield key, f"has faults on several channels, expected one number, got {got}"
        if key == "value" and first.along and not all(map(_is_number, _as_list(value))):
            yield key, f"divides its value among channels, expected finite numbers, got {got}"


def _expand_fault(fault: LibraryFault, overrides: Mapping[str, Any], arms: Sequence[Any]):
    """Yield a [[group.fault]] table for each channel and arm that are faulty in the same run.
    Without `fault.along` a run has one faulty channel, and a table may list channels of which each
    run uses one. With it, all channels of `along` are faulty, each with its share of the value.
    arms: those that are faulty in the same run.
    """
    dumped = fault.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    table = {key: dumped[key] for key in dumped if key not in ("along", "unit")} | {**overrides}
    if "value" in overrides:
        table.pop("wraps", None)  # `wraps` applies to the library's values only
    faulty_arms = arms if fault.declared.per_arm else ()
    if fault.along is None and len(faulty_arms) < 2:
        yield table | ({"arm": faulty_arms[0]} if faulty_arms else {})
        return
    keys = [key for key in _CROSSED if key in table]
    if fault.along is None:
        table["channel"] = list(fault.channels)
        keys = ["channel", *keys]
    # All combinations of the values, as one list per key; run n takes the n-th entry of each list.
    # Values (1, 2) and starts (5, 6) give value = [1, 1, 2, 2] and start_ms = [5, 6, 5, 6].
    combinations = itertools.product(*(_as_list(table[key]) for key in keys))
    columns = map(list, zip(*combinations, strict=True))
    crossed = dict(zip(keys, columns, strict=True))
    for arm in faulty_arms or (None,):
        slot = table | crossed | ({} if arm is None else {"arm": arm})
        if fault.along is None:
            yield slot
        for name, share in (fault.along or {}).items():
            values = [share * value for value in crossed["value"]]
            if fault.declared.channel(name).kind != "float":
                values = [int(value) for value in values]
            yield slot | {"channel": name, "value": values}


def _is_number(value) -> bool:
    return type(value) in (int, float) and -LARGEST <= value <= LARGEST


def _as_list(value) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]
