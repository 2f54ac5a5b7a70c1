"""From the fault table to what an engine takes: the static `Injection`, and plain arrays with one row per run."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pandas as pd

from ravenjax.robot.sites import SITES
from ravenjax.stages.faults.vocabulary import EFFECT_CODES, NETWORK_EFFECTS, TRIGGER_CODES
from ravenjax.types import ARMS, Injection, SiteUse

FOREVER_TICKS = 2**30
"""Duration of a fault that lasts until the run ends."""

WORDS = ("site", "arm", "channel", "effect", "trigger")

Target = tuple[str, str, str]
"""Site, arm ("" where the site has none), channel."""


def slots(table: pd.DataFrame) -> int:
    """Fault slots that the table has columns for."""
    return sum(name.startswith("fault") and name.endswith("_site") for name in table.columns)


def injection(table: pd.DataFrame) -> Injection:
    """The fault machinery that the table needs, in canonical order: it does not depend on the order of the rows."""
    effects: dict[Target, set[str]] = {}
    triggers: set[str] = set()
    for slot in range(slots(table)):
        columns = [table[f"fault{slot}_{name}"] for name in WORDS]
        for site, arm, channel, effect, trigger in pd.concat(columns, axis=1).drop_duplicates().itertuples(index=False):
            if site:
                effects.setdefault((site, arm, channel), set()).add(NETWORK_EFFECTS.get(effect, ("", effect))[1])
                triggers.add(trigger)
    uses = []
    for name, site in SITES.items():
        arms = ARMS if site.per_arm else ("",)
        targets = [(arm, c.name) for arm in arms for c in site.channels if (name, arm, c.name) in effects]
        if targets:
            used = set().union(*(effects[name, *target] for target in targets))
            uses.append(SiteUse(name, tuple(targets), tuple(effect for effect in EFFECT_CODES if effect in used)))
    return Injection(slots(table), tuple(uses), tuple(trigger for trigger in TRIGGER_CODES if trigger in triggers))


def targets(injection: Injection) -> list[Target]:
    """The flattened channels of an injection; a fault's code is its place in here, from 1."""
    return [(use.site, arm, channel) for use in injection.sites for arm, channel in use.channels]


def arrays(table: pd.DataFrame, injection: Injection) -> dict[str, np.ndarray]:
    """The faults of each run, arrays [runs, injection.slots]; an empty slot has code 0.

    code, effect, trigger int32; value float32; start, duration, every, period int32 in ticks of 1 ms (start in packets
    with trigger "packet"); key uint32, the stream of random numbers of that run and slot.
    """
    codes = {target: code for code, target in enumerate(targets(injection), start=1)}
    rows = len(table)
    out: dict[str, np.ndarray] = {
        name: np.zeros((rows, injection.slots), np.int32) for name in ("code", "effect", "trigger")
    }
    out["value"] = np.zeros((rows, injection.slots), np.float32)
    ticks = {"start": "start_ms", "duration": "duration_ms", "every": "every_ms", "period": "period_ms"}
    out |= {name: np.zeros((rows, injection.slots), np.int32) for name in ticks}
    out["key"] = np.zeros((rows, injection.slots), np.uint32)
    for slot in range(min(injection.slots, slots(table))):
        column = {name: table[f"fault{slot}_{name}"].tolist() for name in WORDS}
        values = table[f"fault{slot}_value"].tolist()
        for row, site in enumerate(column["site"]):
            if not site:
                continue
            effect, value = column["effect"][row], values[row]
            if effect in NETWORK_EFFECTS:
                _, effect, constant = NETWORK_EFFECTS[effect]
                value = value if constant is None else constant
            out["code"][row, slot] = codes[site, column["arm"][row], column["channel"][row]]
            out["effect"][row, slot] = EFFECT_CODES[effect]
            out["trigger"][row, slot] = TRIGGER_CODES[column["trigger"][row]]
            out["value"][row, slot] = 0.0 if math.isnan(value) else value
        for name, source in ticks.items():
            out[name][:, slot] = table[f"fault{slot}_{source}"].to_numpy()
        out["duration"][:, slot] = np.where(out["duration"][:, slot] < 0, FOREVER_TICKS, out["duration"][:, slot])
        out["key"][:, slot] = [_key(run_id, slot) for run_id in table["run_id"]]
    return out


def _key(run_id: str, slot: int) -> int:
    return int.from_bytes(hashlib.sha256(f"{run_id}/{slot}".encode()).digest()[:4], "little")


def parameters(table: pd.DataFrame) -> dict[str, np.ndarray]:
    """The varied parameters by path, float64 [runs]; NaN stands for the robot's own value."""
    return {
        name.removeprefix("param:"): table[name].to_numpy(np.float64)
        for name in table.columns
        if name.startswith("param:")
    }
