"""A scenario as a campaign: each hazard that can be armed is one row of its fault table, the E-stop
button the last.

A hazard of the library stands for many rows: a case for each way of running it, and in a case every
value, start and duration that was published. Of each case a session takes one row, drawn by the
session's seed, the case's name and nothing else; with `times = N` N different ones. So the table of
`hazards = "all"` has about a hundred rows.

In the table every hazard starts at 0 and what waits for the pedal in a campaign counts time
instead: a session arms a row when it is due, and then the pedal is down.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import ValidationError

from ravenjax.campaign.faults import design
from ravenjax.campaign.faults.fault_table import FaultTable
from ravenjax.campaign.file import bounds, semantics
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.config import CampaignConfig, validated
from ravenjax.campaign.file.location import Complaint
from ravenjax.hazards import expansion
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.sites import SITES
from ravenjax.train.scenario import hazard
from ravenjax.train.scenario.config import INSTRUCTOR, Entry, Levels, Scenario
from ravenjax.train.scenario.hazard import FAULT, Armable

BUTTONS = "buttons/estop"
"""Group of the last row: the operator's E-stop button."""

_Row = dict[Any, Any]
"""A row of a fault table, by columns."""

_CLUTCHED = {"nominal.resync": 1.0}
"""People clutch: each lift of the pedal would leave the model some tenths of a millimetre beside
the robot.
"""

_OWN_KEYS = {
    "monitor.limit": "[harm] excursion_mm",
    "haptics.cues": "[cue] threshold_mm, kp_per_mm, kd_per_mm_s or cap",
}
"""Parameters that have a key of their own in a scenario."""

_UNBOUNDED_S = 3600.0
"""Length of the campaign that rows are drawn from: the library's starts all lie within it."""


def campaign(scenario: Scenario, seed: int) -> CampaignConfig:
    """The campaign of a session. Raises ValueError for what `complaints` tells of."""
    groups, _ = _groups(scenario, seed)
    rows = design.rows(_config(scenario, seed, groups, _UNBOUNDED_S)).records() if groups else []
    faults_of: dict[str, list[dict[str, Any]]] = {}
    for h, entry in enumerate(scenario.hazard):
        prefix = f"{scenario.entry_name(h)}/"
        for group in (group["name"] for group in groups if group["name"].startswith(prefix)):
            mine = [row for row in rows if row["group"] == group]
            order = _rng(seed, group).permutation(len(mine))
            for k in range(entry.times):
                row = mine[order[k % len(mine)]]
                faults_of[group if entry.times == 1 else f"{group}#{k + 1}"] = _faults(row)
    fixed: list[dict[str, Any]] = [
        {"name": name, "fault": faults} for name, faults in faults_of.items()
    ]
    button = {
        "site": "buttons",
        "channel": "estop",
        "effect": "overwrite",
        "value": 1,
        "start_ms": 0,
    }
    return _config(
        scenario, seed, [*fixed, {"name": BUTTONS, "fault": [button]}], scenario.duration_s
    )


def armable(scenario: Scenario, table: FaultTable) -> tuple[Armable, ...]:
    """The hazards of a session's list: the rows of `table`, its campaign's fault table, but the
    button's.
    """
    entries = {scenario.entry_name(h): entry for h, entry in enumerate(scenario.hazard)}
    return tuple(
        _armable(entries, number, row)
        for number, row in enumerate(table.records())
        if row["group"] != BUTTONS
    )


def complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Every (key, message) that is wrong with the words of a scenario of valid shape."""
    names = [scenario.entry_name(h) for h in range(len(scenario.hazard))]
    for h, name in enumerate(names):
        if names.index(name) != h:
            yield (
                ("hazard", h, "name"),
                f"got {name!r} twice, expected a name of its own for each hazard",
            )
    task = scenario.task
    parts = enumerate(task.level) if isinstance(task, Levels) else [(None, task)]
    for k, one in parts:
        for arm in one.arms:
            if arm not in scenario.arms:
                key = ("task", "arms") if k is None else ("task", "level", k, "arms")
                yield (
                    key,
                    f"arm {arm!r} is not in this session: expected some of {list(scenario.arms)}",
                )
    for h, entry in enumerate(scenario.hazard):
        if entry.arm is not None and entry.arm not in scenario.arms:
            yield (
                ("hazard", h, "arm"),
                f"got {entry.arm!r}, expected one of the session's arms {list(scenario.arms)}",
            )
            return
        if entry.when != INSTRUCTOR and entry.when[0] * 1000.0 >= scenario.ticks:
            last = f"{scenario.duration_s:g} s"
            yield ("hazard", h, "when"), f"got {entry.when[0]:g}, but the session ends after {last}"
    try:
        groups, written = _groups(scenario, scenario.seed)
        config = _config(scenario, scenario.seed, groups or [{"name": "none"}], _UNBOUNDED_S)
    except expansion.WrongGroup as error:
        yield ("hazard", *error.key), error.message
        return
    except ValidationError as error:
        for one in error.errors():
            yield _of_file(scenario, one["loc"], []), one["msg"].removeprefix("Value error, ")
        return
    for key, message in semantics.complaints(config):
        yield _of_file(scenario, key, written), _of_scenario(key, message)


def _of_scenario(key: tuple[str | int, ...], message: str) -> str:
    """A campaign's message with the scenario's keys in place of the campaign's."""
    match key:
        case ("parameters", str(path), *_):
            kind = bounds.plain(ROBOT, path)
            own = (
                keys
                for name, keys in _OWN_KEYS.items()
                if kind == name or kind.startswith(f"{name}.")
            )
            return next((f"cannot be set: write {keys}" for keys in own), message)
        case _:
            return message


def _of_file(
    scenario: Scenario, key: tuple[str | int, ...], written: list[int]
) -> tuple[str | int, ...]:
    """The scenario's key of a campaign's."""
    match key:
        case ("group", int(number), *rest) if number < len(written):
            own = bool(
                scenario.hazard[written[number]].fault
            )  # else the fault is the library's, and not in the file
            return (
                "hazard",
                written[number],
                *(rest if own or rest[:1] != ["fault"] else rest[2:]),
            )
        case ("campaign", "tools" | "policy" | "level", *_):
            return ("robot", *key[1:])
        case ("campaign", *rest):
            return tuple(rest)
        case _:
            return key


def _groups(scenario: Scenario, seed: int) -> tuple[list[dict[str, Any]], list[int]]:
    """The groups as a campaign file would have them, one a case, and the number of the entry
    that each is of.
    """
    result: list[dict[str, Any]] = []
    written: list[int] = []
    for h, entry in enumerate(scenario.hazard):
        name = scenario.entry_name(h)
        try:
            groups = (
                _of_library(entry, name, scenario, seed)
                if entry.hazards
                else [_of_faults(entry, name, scenario)]
            )
        except expansion.WrongGroup as error:
            raise expansion.WrongGroup((h, *error.key), error.message) from None
        result += groups
        written += [h] * len(groups)
    return result, written


def _of_library(entry: Entry, name: str, scenario: Scenario, seed: int) -> list[dict[str, Any]]:
    value = {} if entry.value is None else {"value": entry.value.model_dump()}
    groups = []
    for row in expansion.named(list(entry.hazards)):
        arm = (
            entry.arm
            or scenario.arms[_rng(seed, f"{name}/{row.id}/arm").integers(len(scenario.arms))]
        )
        groups += expansion.expand({"name": name, "hazards": [row.id], "arm": arm, **value})
    return groups


def _of_faults(entry: Entry, name: str, scenario: Scenario) -> dict[str, Any]:
    faults = [fault.model_dump(exclude_none=True) for fault in entry.fault]
    for fault in faults:
        site = SITES.get(fault["site"])
        if site is not None and site.per_arm:
            fault.setdefault("arm", scenario.arms[0])
    return {"name": f"{name}/{FAULT}", "fault": faults}


def _config(
    scenario: Scenario, seed: int, groups: list[dict[str, Any]], duration_s: float
) -> CampaignConfig:
    robot = scenario.robot.model_dump(exclude={"start"}, exclude_none=True)
    cue = scenario.cue.model_dump(exclude={"on", "blinded"})
    campaign = {
        "name": scenario.name,
        "seed": seed,
        "duration_s": duration_s,
        "arms": scenario.arms,
        "software": scenario.software,
        "contact": scenario.contact.on,
        **robot,
    }
    return validated(
        {
            "campaign": campaign,
            "operator": {
                "motion": "still",
                "scale": scenario.scale,
                "start": scenario.robot.start.model_dump(exclude_none=True),
            },
            "haptics": cue,
            "parameters": (
                _CLUTCHED
                | {path: _drawn(axis, seed, path) for path, axis in scenario.parameters.items()}
            ),
            "group": groups,
        }
    )


def _drawn(axis: Axis, seed: int, path: str) -> float:
    """One value of a parameter, the same for every hazard of the session."""
    unit = _rng(seed, f"parameter {path}").random(1)
    return float(axis.at(axis.places(unit))[0])


def _faults(row: _Row) -> list[dict[str, Any]]:
    """The row's faults as a campaign file has them, the earliest starting at 0."""
    slots = [s for s in range(8) if row.get(f"fault{s}_site", "")]
    first = min((int(row[f"fault{s}_start_ms"]) for s in slots), default=0)
    faults = []
    for s in slots:
        site, value = SITES[row[f"fault{s}_site"]], float(row[f"fault{s}_value"])
        channel, duration = row[f"fault{s}_channel"], int(row[f"fault{s}_duration_ms"])
        trigger = row[f"fault{s}_trigger"]
        fault: dict[str, Any] = {
            "site": site.name,
            "channel": channel,
            "effect": row[f"fault{s}_effect"],
            "trigger": "time" if trigger == "pedal" else trigger,
            "start_ms": int(row[f"fault{s}_start_ms"]) - first,
            "duration_ms": "end" if duration < 0 else duration,
            "every_ms": int(row[f"fault{s}_every_ms"]),
            "period_ms": int(row[f"fault{s}_period_ms"]),
            "wraps": True,  # the values were looked at when the fault table was made
        }
        if site.per_arm:
            fault["arm"] = row[f"fault{s}_arm"]
        if not math.isnan(value):
            fault["value"] = int(value) if value.is_integer() else value
        faults.append(fault)
    return faults


def _armable(entries: dict[str, Entry], number: int, row: _Row) -> Armable:
    group = str(row["group"])
    name, identity, case = hazard.named(group)
    entry, library_hazard = entries[name], hazard.of_library(identity)
    title = entry.title or (library_hazard.title if library_hazard is not None else name)
    slots = [s for s in range(8) if row.get(f"fault{s}_site", "")]
    ends = [_end_ms(row, s) for s in slots]
    duration = None if None in ends else max(end for end in ends if end is not None)
    return Armable(
        number=number,
        hazard=identity,
        title=f"{title} ({case.replace('_', ' ')})" if case and not entry.title else title,
        group=group,
        run_id=f"{int(row['run_id']):016x}",
        row=number,
        arm=next((str(row[f"fault{s}_arm"]) for s in slots if row[f"fault{s}_arm"]), ""),
        right_response=hazard.responses(entry, library_hazard),
        within_s=entry.within_s,
        duration_ms=duration,
        lasts_ms=hazard.lasts_ms(entry, duration),
        when_ms=(
            None if entry.when == INSTRUCTOR else (entry.when[0] * 1000.0, entry.when[1] * 1000.0)
        ),
    )


def _end_ms(row: _Row, slot: int) -> int | None:
    duration, every = int(row[f"fault{slot}_duration_ms"]), int(row[f"fault{slot}_every_ms"])
    return None if duration < 0 or every > 0 else int(row[f"fault{slot}_start_ms"]) + duration


def _rng(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
