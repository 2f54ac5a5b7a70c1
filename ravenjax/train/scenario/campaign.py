"""Converts a training scenario to a campaign, whose fault table lists the session's hazards.

The last row of the table is the operator's E-stop button. A hazard of the library has many rows:
one for each case, published value, start and duration. A session draws one row of each case, or N
rows if the scenario writes `times = N`. The draw depends only on the session's seed and the case's
name. Time 0 of a fault is the moment at which its hazard is armed. A fault with the trigger "pedal"
gets the trigger "time" instead, because a session arms a hazard only while the pedal is down.
"""

import dataclasses
import math
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.campaign.faults import design
from ravenjax.campaign.file import bounds, semantics
from ravenjax.campaign.file.config import CampaignConfig, config_class_of
from ravenjax.campaign.file.location import Complaint
from ravenjax.campaign.file.section import parse
from ravenjax.hazards import expansion, library
from ravenjax.train.robot import ROBOT, Arms
from ravenjax.train.scenario.config import INSTRUCTOR, MAX_FAULTS, Entry, Levels, Scenario
from ravenjax.vocabulary.effects import FIELDS

_RESPONSES = resources.read_tables(__file__, "responses.toml")

ENDLESS_MS = 5000
"""How long a fault without an end stays active, ms, unless the scenario sets a time."""
SETTLE_MS = 500  # A hazard stays armed this much longer than the time allowed for the response, ms
FAULT = "fault"  # Stands for the library id if the scenario declares the fault itself
BUTTONS = "buttons/estop"  # Group of the last row: the operator's E-stop button
Key = tuple[str | int, ...]
Tables = dict[str, Any]
"""Tables of a campaign or scenario file."""
_Row = dict[Any, Any]  # A row of a fault table, by column
_CLUTCHED = {"nominal.resync": 1.0}
"""The nominal model follows the robot while the pedal is up. Otherwise each clutching would leave
the model some tenths of a millimetre away from the robot.
"""
_OWN_KEYS = {
    "monitor.limit": "[harm] excursion_mm",
    "haptics.cues": "[cue] threshold_mm, kp_per_mm, kd_per_mm_s or cap",
}
"""Campaign parameters that a scenario sets by other keys: those on the right."""
_UNBOUNDED_S = 3600.0
"""Length of the campaign from which rows are drawn, s: longer than every start in the library."""


@dataclasses.dataclass(frozen=True)
class Armable:
    """One hazard of a session that can be armed."""

    number: int  # Index in the session's list of hazards, and row in the fault table
    # Id in the library; "fault" if the scenario declares the fault itself.
    hazard: str
    title: str
    group: str  # Name of the fault table's group
    run_id: str  # 16 hex digits
    # The arm on which the first fault acts; "" if it acts on no arm.
    arm: str
    right_response: tuple[str, ...]
    within_s: float
    lasts_ms: int  # how long the hazard stays armed at most
    # Earliest and latest time; None: the instructor arms the hazard.
    when_ms: tuple[float, float] | None
    layer: str  # Layer of the loop, as text; "" if the scenario declares the fault itself

    def header(self) -> Tables:
        """Return the hazard's entry in session.json."""
        hidden = ("arm", "lasts_ms", "when_ms")
        return {key: value for key, value in vars(self).items() if key not in hidden}


def right_responses(entry: Entry, hazard: library.Hazard | None) -> tuple[str, ...]:
    """Return the right responses of a scenario's entry: its own list, or else the responses that
    `responses.toml` lists for the library's hazard. hazard: of the library; None: the scenario
    declares the fault, which counts as a sudden jump. If the list is empty: "continue".
    """
    if entry.right_response is not None:
        return entry.right_response
    if hazard is None:
        names = ["sudden jump"]
    else:
        expected = _RESPONSES["expected"].items()
        applying = [name for word, name in expected if word in hazard.expected_class]
        # The first expected outcome that applies counts.
        names = hazard.scenarios or applying[:1]
    responses = [response for name in names for response in _RESPONSES["hazards"][name]]
    # A dict keeps each response once, in order.
    return tuple(dict.fromkeys(responses)) or ("continue",)


def session_campaign(scenario: Scenario, seed: int) -> CampaignConfig:
    """Return a session's campaign: one group for each hazard, then a group for the E-stop button.
    Of the rows of each case, `times` are drawn. Raises ValueError for an invalid scenario.
    """
    groups, entry_numbers = _groups(scenario, seed)
    all_cases = _config(scenario, seed, groups, _UNBOUNDED_S)
    rows = design.table_columns(all_cases).to_dict("records") if groups else []
    drawn_groups: list[Tables] = []
    for group, number in zip(groups, entry_numbers, strict=True):
        name, times = group["name"], scenario.hazard[number].times
        group_rows = [row for row in rows if row["group"] == name]
        order = _rng(seed, name).permutation(len(group_rows))
        for k in range(times):
            # If the case has fewer rows, rows repeat.
            faults = _faults(group_rows[order[k % len(group_rows)]])
            drawn_name = name if times == 1 else f"{name}#{k + 1}"
            drawn_groups.append({"name": drawn_name, "fault": faults})
    button = {"site": "buttons", "channel": "estop", "effect": "overwrite"}
    drawn_groups.append({"name": BUTTONS, "fault": [button | {"value": 1, "start_ms": 0}]})
    return _config(scenario, seed, drawn_groups, scenario.duration_s)


def armable_hazards(scenario: Scenario, table: pd.DataFrame) -> tuple[Armable, ...]:
    """Return the hazards of a session: all rows of its fault table but the E-stop button."""
    entries = {scenario.entry_name(h): entry for h, entry in enumerate(scenario.hazard)}
    return tuple(
        _armable(entries, number, row)
        for number, row in enumerate(table.to_dict("records"))
        if row["group"] != BUTTONS
    )


def find_scenario_errors(scenario: Scenario) -> Iterator[Complaint]:
    """Yield (key, message) for each error in a scenario whose shape is already valid."""
    names = [scenario.entry_name(h) for h in range(len(scenario.hazard))]
    for h, name in enumerate(names):
        if names.index(name) != h:
            message = f"got {name!r} twice, expected a different name for each hazard"
            yield ("hazard", h, "name"), message
    task, arms = scenario.task, list(scenario.arms)
    tasks: dict[Key, Arms] = {("task", "arms"): task.arms}
    if isinstance(task, Levels):
        tasks = {("task", "level", k, "arms"): level.arms for k, level in enumerate(task.level)}
    for key, task_arms in tasks.items():
        for arm in task_arms:
            if arm not in arms:
                yield key, f"arm {arm!r} is not in this session: expected some of {arms}"
    for h, entry in enumerate(scenario.hazard):
        if entry.arm is not None and entry.arm not in arms:
            message = f"got {entry.arm!r}, expected one of the session's arms {arms}"
            yield ("hazard", h, "arm"), message
            # The campaign of the other checks cannot be made with a wrong arm.
            return
        if entry.when != INSTRUCTOR and entry.when[0] * 1000.0 >= scenario.ticks:
            last = f"{scenario.duration_s:g} s"
            yield ("hazard", h, "when"), f"got {entry.when[0]:g}, but the session ends after {last}"
    try:
        groups, entry_numbers = _groups(scenario, scenario.seed)
    except expansion.WrongGroup as error:
        yield ("hazard", *error.key), error.message
        return
    tables = _tables(scenario, scenario.seed, groups, _UNBOUNDED_S)
    config, mistakes = parse(config_class_of(ROBOT), tables)
    if config is not None:
        mistakes = [*semantics.find_errors(config), *bounds.find_invalid_values(config)]
    for key, message in mistakes:
        yield _scenario_key(scenario, key, entry_numbers), _scenario_message(key, message)


def _scenario_message(key: Key, message: str) -> str:
    """Return a campaign's message for the author of a scenario. For a parameter that other keys of
    the scenario set, the message names these keys.
    """
    if key[:1] == ("parameters",) and len(key) > 1:
        path = f"{bounds.shorten_path(ROBOT, str(key[1]))}."
        for name, keys in _OWN_KEYS.items():
            if path.startswith(f"{name}."):
                return f"cannot be set: write {keys}"
    return message


def _scenario_key(scenario: Scenario, key: Key, entry_numbers: list[int]) -> Key:
    """Return the key in the scenario file for a key of the campaign. For example, the key
    ("group", 5, "fault", 0, "value") becomes ("hazard", 2, "value") if the third entry names a
    hazard of the library. entry_numbers: of each group of the campaign, the entry's number.
    """
    match key:
        case ("group", int(number), *rest) if number < len(entry_numbers):
            entry = entry_numbers[number]
            # Faults of the library are not in the scenario file, so "fault" and its number go.
            if rest[:1] == ["fault"] and not scenario.hazard[entry].fault:
                rest = rest[2:]
            return ("hazard", entry, *rest)
        case ("campaign", "tools" | "policy" | "level", *_):
            return ("robot", *key[1:])
        case ("campaign", *rest):
            return tuple(rest)
        case _:
            return key


def _groups(scenario: Scenario, seed: int) -> tuple[list[Tables], list[int]]:
    """Return a campaign's group for each case of each hazard, and the number of its entry."""
    groups: list[Tables] = []
    numbers = []
    for h, entry in enumerate(scenario.hazard):
        name = scenario.entry_name(h)
        value = {} if entry.value is None else {"value": entry.value.written()}
        try:
            hazards = expansion.select_hazards(list(entry.hazards)) if entry.hazards else []
            for hazard in hazards:
                arm_index = _rng(seed, f"{name}/{hazard.id}/arm").integers(len(scenario.arms))
                arm = entry.arm or scenario.arms[arm_index]
                group = {"name": name, "hazards": [hazard.id], "arm": arm, **value}
                groups += expansion.expand_group(group)
        except expansion.WrongGroup as error:
            raise expansion.WrongGroup((h, *error.key), error.message) from None
        if entry.fault:
            faults = [fault.model_dump(exclude_none=True) for fault in entry.fault]
            # A fault of an arm acts on the first arm, unless it names another.
            for fault in faults:
                site = ROBOT.sites.get(fault["site"])
                if site is not None and site.per_arm:
                    fault.setdefault("arm", scenario.arms[0])
            groups.append({"name": f"{name}/{FAULT}", "fault": faults})
        # Each group that was added for this entry gets its number.
        numbers += [h] * (len(groups) - len(numbers))
    return groups, numbers


def _config(
    scenario: Scenario, seed: int, groups: list[Tables], duration_s: float
) -> CampaignConfig:
    return config_class_of(ROBOT).model_validate(_tables(scenario, seed, groups, duration_s))


def _tables(scenario: Scenario, seed: int, groups: list[Tables], duration_s: float) -> Tables:
    # Returns a campaign whose hands are still; the session computes the operator's motion.
    robot, start = scenario.robot, scenario.robot.start
    # Each parameter has one value, the same for every hazard of the session.
    parameters = {}
    for path, axis in scenario.parameters.items():
        # From a random number, 0 to 1, to a value of the parameter's list or distribution.
        place = axis.places(_rng(seed, f"parameter {path}").random(1))
        parameters[path] = float(axis.at(place)[0])
    return {
        "campaign": {
            "name": scenario.name,
            "seed": seed,
            "duration_s": duration_s,
            "arms": scenario.arms,
            "software": scenario.software,
            "contact": scenario.contact.on,
            **robot.model_dump(exclude={"start"}, exclude_none=True),
        },
        "operator": {
            "motion": "still",
            "scale": scenario.scale,
            "start": start.model_dump(exclude_none=True),
        },
        "haptics": scenario.cue.model_dump(exclude={"on", "blinded"}),
        "parameters": _CLUTCHED | parameters,
        # A campaign needs a group, also without a hazard.
        "group": groups or [{"name": "none"}],
    }


def _slots(row: _Row) -> list[_Row]:
    # Returns the faults of a row of the fault table: their columns without the prefix "fault<k>_".
    slots = ({name: row.get(f"fault{k}_{name}") for name in FIELDS} for k in range(MAX_FAULTS))
    return [slot for slot in slots if slot["site"]]


def _faults(row: _Row) -> list[Tables]:
    """Return the faults of a row with the keys of a campaign file; the earliest starts at 0."""
    slots = _slots(row)
    first = min((int(slot["start_ms"]) for slot in slots), default=0)
    faults = []
    for slot in slots:
        fault = {name: int(x) if name.endswith("_ms") else x for name, x in slot.items()}
        # With "wraps", values are not checked again: they were checked for the fault table.
        fault |= {"start_ms": fault["start_ms"] - first, "wraps": True}
        # A table of numbers has -1 for a fault that lasts until the end.
        if fault["duration_ms"] < 0:
            fault["duration_ms"] = "end"
        # A session arms a hazard only while the pedal is down.
        if slot["trigger"] == "pedal":
            fault["trigger"] = "time"
        if not ROBOT.sites[slot["site"]].per_arm:
            del fault["arm"]
        value = float(fault.pop("value"))
        if not math.isnan(value):
            fault["value"] = int(value) if value.is_integer() else value
        faults.append(fault)
    return faults


def _armable(entries: dict[str, Entry], number: int, row: _Row) -> Armable:
    # Returns the hazard of one row of the fault table. entries: of the scenario, by name.
    # The group's name is ENTRY/ID-CASE#TIME; ids of the library have no hyphen.
    group = str(row["group"])
    name, _, rest = group.partition("/")
    hazard_id, _, case = rest.partition("#")[0].partition("-")
    entry = entries[name]
    library_hazard = None if entry.fault else library.find_hazard(hazard_id)
    title = name if library_hazard is None else library_hazard.title
    if case:
        title += f" ({case.replace('_', ' ')})"
    slots = _slots(row)
    if entry.lasts_s is not None:
        lasts_ms = round(entry.lasts_s * 1000.0)
    else:
        faults = pd.DataFrame(slots)
        ends = faults.start_ms + faults.duration_ms
        # A duration of -1 lasts until the end, and a recurring fault never ends.
        is_endless = (faults.duration_ms < 0) | (faults.every_ms > 0)
        # The hazard must last until the time for the response is up.
        shortest_ms = round(entry.within_s * 1000.0) + SETTLE_MS
        lasts_ms = max(shortest_ms, ENDLESS_MS if is_endless.any() else int(ends.max()))
    when = entry.when
    return Armable(
        number=number,
        hazard=hazard_id,
        title=entry.title or title,
        group=group,
        run_id=f"{int(row['run_id']):016x}",
        arm=next((str(slot["arm"]) for slot in slots if slot["arm"]), ""),
        right_response=right_responses(entry, library_hazard),
        within_s=entry.within_s,
        lasts_ms=lasts_ms,
        when_ms=None if when == INSTRUCTOR else (when[0] * 1000.0, when[1] * 1000.0),
        layer="" if library_hazard is None else library.library_layers()[library_hazard.layer],
    )


def _rng(seed: int, name: str) -> np.random.Generator:
    # Returns random numbers that depend only on the seed and the name of what is drawn.
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
