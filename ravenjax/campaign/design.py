"""Expands a campaign into its fault table: one row per run, every input of the run in columns.

Deterministic: a group's draws depend on the campaign's seed, the group's name and design alone, not on other groups, on
chunk size or on the order in which pandas keeps anything. `run_id` hashes the content of the row and of all that the
campaign fixes, so the same run has the same id wherever it stands.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign.axis import Axis, fixed
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.group import SAMPLED, UNTIL_END, Fault, Group
from ravenjax.campaign.semantics import ALL, WITHOUT_VALUE, value_complaint
from ravenjax.errors import UserError
from ravenjax.robot.sites import SITES
from ravenjax.stages.faults.vocabulary import NETWORK_EFFECTS

FAULT_FIELDS = (
    "site",
    "arm",
    "channel",
    "effect",
    "value",
    "trigger",
    "start_ms",
    "duration_ms",
    "every_ms",
    "period_ms",
)
"""Columns of one fault slot, each prefixed with fault0_, fault1_, ..."""

NO_FAULT: dict[str, Any] = {
    "site": "",
    "arm": "",
    "channel": "",
    "effect": "",
    "value": math.nan,
    "trigger": "",
    "start_ms": 0,
    "duration_ms": 0,
    "every_ms": 0,
    "period_ms": 0,
}
"""What an empty slot holds."""

_LEAST = {"start_ms": 0, "duration_ms": 1, "every_ms": 0, "period_ms": 1}

Key = tuple[int, str]
"""Fault slot, or -1 for a parameter; field or parameter path."""


class Planned(NamedTuple):
    """One run before it has an index and an id."""

    group: str
    faults: tuple[dict[str, Any], ...]
    parameters: dict[str, float]
    repeat: int


def expand(config: CampaignConfig) -> pd.DataFrame:
    """The fault table, columns as in `ravenjax.store.schema`.

    A parameter that a group leaves alone is NaN in its rows: the robot's own value. Raises UserError for drawn values
    that the channel cannot take.
    """
    plan = [planned for group in config.group for planned in _group(config, group)][: config.campaign.limit]
    paths = list(dict.fromkeys(path for planned in plan for path in planned.parameters))
    common = _common(config)
    copies: dict[str, int] = {}
    rows = []
    for index, planned in enumerate(plan):
        seed = (config.campaign.seed + planned.repeat) % 2**31
        content = {**common, "faults": planned.faults, "parameters": planned.parameters, "seed": seed}
        plain = _hash(content)
        copy = copies[plain] = copies.get(plain, -1) + 1
        row: dict[str, Any] = {
            "run_id": _hash({**content, "copy": copy}) if copy else plain,
            "index": index,
            "group": planned.group,
            "seed": seed,
            "operator": config.operator.label,
        }
        slots = itertools.zip_longest(range(config.slots), planned.faults, fillvalue=NO_FAULT)
        for slot, fault in slots:
            row |= {f"fault{slot}_{name}": fault[name] for name in FAULT_FIELDS}  # type: ignore[index]
        row |= {f"param:{path}": planned.parameters.get(path, math.nan) for path in paths}
        rows.append(row)
    return _typed(pd.DataFrame(rows), config.slots)


def count(config: CampaignConfig) -> int:
    """Number of runs, without expanding them."""
    total = sum(_base_count(config, group) * group.repeats for group in config.group)
    return total if config.campaign.limit is None else min(total, config.campaign.limit)


def _typed(table: pd.DataFrame, slots: int) -> pd.DataFrame:
    types: dict[str, str] = {"index": "int32", "seed": "int64"}
    for slot in range(slots):
        types[f"fault{slot}_value"] = "float64"
        types |= {f"fault{slot}_{name}": "int32" for name in _LEAST}
    types |= {name: "float64" for name in table.columns if name.startswith("param:")}
    return table.astype(types)


def _common(config: CampaignConfig) -> dict[str, Any]:
    """What decides the outcome of every run alike."""
    campaign = config.campaign.model_dump(mode="json", exclude={"name", "description", "seed", "limit", "chunk"})
    operator = config.operator.model_dump(mode="json", exclude={"file"})
    if config.operator.file is not None:
        operator["file"] = _file_hash(config.operator.file)
    return {
        "campaign": {**campaign, "tools": config.tools},
        "operator": operator,
        "limits": config.limits.si(),
        "cues": config.haptics.cues(),
        "outcomes": config.outcomes.model_dump(),
    }


def _file_hash(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"{path}: operator.file cannot be read ({error.strerror})") from None


def _hash(content: Any) -> str:
    """16 hex digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


# --- one group --------------------------------------------------------------------------------------------------------


def _group(config: CampaignConfig, group: Group) -> Iterator[Planned]:
    rng = np.random.default_rng([config.campaign.seed, zlib.crc32(group.name.encode())])
    faults_of_run = [group.faults_of(run) for run in group.run] or [group.fault]
    for r, faults in enumerate(faults_of_run):
        own = group.run[r].parameters if group.run else {}
        axes = _axes(config, faults, {**config.parameters, **group.parameters, **own})
        for repeat, cell in _cells(group, axes, rng):
            yield Planned(
                group=group.name,
                faults=tuple(_fault(group.name, f, fault, axes, cell) for f, fault in enumerate(faults)),
                parameters={path: float(_take(cell[-1, path])) for slot, path in axes if slot == -1},
                repeat=repeat,
            )


def _axes(config: CampaignConfig, faults: tuple[Fault, ...], parameters: dict[str, Axis]) -> dict[Key, Axis]:
    """Every axis of a group in its order: slot by slot, field by field, then the parameters."""
    axes: dict[Key, Axis] = {}
    for f, fault in enumerate(faults):
        site = SITES[fault.site]
        names = tuple(channel.name for channel in site.channels)
        sole = fixed(names[0]) if len(names) == 1 else fixed("")
        every = Axis(kind="list", values=names)
        resolved = {
            "arm": fault.arm or fixed(config.campaign.arms[0] if site.per_arm else ""),
            "channel": sole if fault.channel is None else every if fault.channel.listed == (ALL,) else fault.channel,
            "value": fault.value or fixed(math.nan),
        }
        for name in FAULT_FIELDS[1:]:
            axes[f, name] = resolved.get(name) or getattr(fault, name)
    return axes | {(-1, path): axis for path, axis in parameters.items()}


class _Drawn(NamedTuple):
    """A drawn value, as a real number and as a whole one: the channel of the same run says which is meant."""

    real: Any
    whole: Any


def _take(value: Any, whole: bool = False) -> Any:
    return (value.whole if whole else value.real) if isinstance(value, _Drawn) else value


def _base_count(config: CampaignConfig, group: Group) -> int:
    if group.design in SAMPLED:
        return group.runs or 0
    total = 0
    for r, faults in enumerate([group.faults_of(run) for run in group.run] or [group.fault]):
        own = group.run[r].parameters if group.run else {}
        axes = _axes(config, faults, {**config.parameters, **group.parameters, **own})
        lengths = [len(axis.values) for axis in axes.values() if axis.kind == "list"]
        total += max(lengths, default=1) if group.design == "zip" else math.prod(lengths)
    return total


def _cells(group: Group, axes: dict[Key, Axis], rng: np.random.Generator) -> Iterator[tuple[int, dict[Key, Any]]]:
    """(repeat, value of each axis) of each run; repeats vary fastest, then the last list."""
    constant = {key: axis.values[0] for key, axis in axes.items() if axis.kind == "fixed"}
    listed = {key: axis for key, axis in axes.items() if axis.kind == "list"}
    if group.design in SAMPLED:
        drawn = {key: axis for key, axis in axes.items() if axis.kind != "fixed"}
        sample = _unit(group.design, group.runs or 0, len(drawn), rng)
        columns = [_draw(axis, sample[:, i]) for i, axis in enumerate(drawn.values())]
        for row in range(group.runs or 0):
            cell = constant | {key: column[row] for key, column in zip(drawn, columns, strict=True)}
            yield from ((repeat, cell) for repeat in range(group.repeats))
        return
    if group.design == "zip":
        longest = max((len(axis.values) for axis in listed.values()), default=1)
        lists = [axis.values * longest if len(axis.values) == 1 else axis.values for axis in listed.values()]
        combinations = list(zip(*lists, strict=True)) if lists else [()]
    else:
        combinations = list(itertools.product(*(axis.values for axis in listed.values())))
    drawn = {key: axis for key, axis in axes.items() if axis.drawn}
    sample = _unit("random", len(combinations) * group.repeats, len(drawn), rng)
    columns = [_draw(axis, sample[:, i]) for i, axis in enumerate(drawn.values())]
    for row, (values, repeat) in enumerate(itertools.product(combinations, range(group.repeats))):
        cell = constant | dict(zip(listed, values, strict=True))
        yield repeat, cell | {key: column[row] for key, column in zip(drawn, columns, strict=True)}


def _unit(design: str, rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    """[rows, dimensions] points in the unit cube."""
    if design == "random" or dimensions == 0:
        return rng.random((rows, dimensions))
    from scipy.stats import qmc  # slow to import

    sampler = qmc.LatinHypercube(dimensions, rng=rng) if design == "lhs" else qmc.Sobol(dimensions, rng=rng)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # balance properties of counts that are no power of two
        return sampler.random(rows)


def _draw(axis: Axis, unit: np.ndarray) -> list[Any]:
    if axis.listed:
        return axis.draw(unit)
    return [_Drawn(*pair) for pair in zip(axis.draw(unit), axis.draw(unit, whole=True), strict=True)]


def _fault(group: str, slot: int, fault: Fault, axes: dict[Key, Axis], cell: dict[Key, Any]) -> dict[str, Any]:
    """One slot of one run, in canonical form: what an effect does not use is NaN or 0, so equal faults hash alike."""
    out: dict[str, Any] = {"site": fault.site}
    for name in FAULT_FIELDS[1:]:
        out[name] = _take(cell[slot, name], whole=name in _LEAST)
    for name, least in _LEAST.items():
        endless = name == "duration_ms" and out[name] == UNTIL_END and UNTIL_END in axes[slot, name].listed
        if not endless:
            out[name] = max(int(out[name]), least if out["effect"] == "periodic" or name != "period_ms" else 0)
    effect = out["effect"]
    if effect in NETWORK_EFFECTS:
        out["channel"] = NETWORK_EFFECTS[effect][0]
    if effect != "periodic":
        out["period_ms"] = 0
    if effect in WITHOUT_VALUE:
        out["value"] = math.nan
        return out
    channel = SITES[fault.site].channel(out["channel"])
    counted = effect in ("bit_flip", "delay")
    integer = channel.kind != "float" and effect in ("overwrite", "toggle", "offset", "latch_offset")
    out["value"] = float(_take(cell[slot, "value"], whole=counted or integer))
    if complaint := value_complaint(channel, effect, out["value"]):
        raise UserError(f"group {group!r}, fault[{slot}].value: {complaint}")
    return out
