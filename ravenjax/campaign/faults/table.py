"""Converts a table of faults to arrays for an engine, with one row per run."""

import math

import numpy as np
import pandas as pd

from ravenjax.campaign.faults import run_id
from ravenjax.numbers.setup import Injection, SiteUse
from ravenjax.vocabulary.effects import EFFECT_CODES, NETWORK_EFFECTS, TRIGGER_CODES
from ravenjax.vocabulary.robot import Robot

FOREVER_TICKS = 2**30
"""Duration, in ticks, of a fault that lasts until the run ends."""

WORDS = ("site", "arm", "channel", "effect", "trigger")

_INTEGERS = ("code", "effect", "trigger", "start", "duration", "every", "period")
ARRAYS = dict.fromkeys(_INTEGERS, np.int32) | {"value": np.float32, "key": np.uint32}
"""The numbers of a fault, as in `faults.fault.FaultSlot`."""

SHARED = "shared_id"
"""Column with the id of the first run that differs only in crossed parameters, if there are any."""

Target = tuple[str, str, str]
"""(site, arm, channel); arm is "" if the site has none."""


def count_slots(table: pd.DataFrame) -> int:
    """Return the number of fault slots of the table."""
    return sum(name.startswith("fault") and name.endswith("_site") for name in table)


def table_injection(table: pd.DataFrame, robot: Robot) -> Injection:
    """Return the sites, channels, effects and triggers in the table, in the robot's order. The
    program of the tick injects only these. Network effects are replaced by plain effects.
    """
    effects: dict[Target, set[str]] = {}
    triggers = set()
    for slot in range(count_slots(table)):
        _, combinations = _word_groups(table, slot)
        for site, arm, channel, effect, trigger in combinations:
            # An empty slot has the site "".
            if site:
                network = NETWORK_EFFECTS.get(effect)
                plain_effect = network.effect if network else effect
                effects.setdefault((site, arm, channel), set()).add(plain_effect)
                triggers.add(trigger)
    uses = []
    for name, site in robot.sites.items():
        arms = robot.arms if site.per_arm else ("",)
        targets = [
            (arm, c.name) for arm in arms for c in site.channels if (name, arm, c.name) in effects
        ]
        if targets:
            at_site = set().union(*(effects[name, *target] for target in targets))
            ordered = tuple(effect for effect in EFFECT_CODES if effect in at_site)
            uses.append(SiteUse(name, tuple(targets), ordered))
    used_triggers = tuple(trigger for trigger in TRIGGER_CODES if trigger in triggers)
    return Injection(count_slots(table), tuple(uses), used_triggers)


def fault_arrays(
    table: pd.DataFrame, injection: Injection, tick_ms: int = 1
) -> dict[str, np.ndarray]:
    """Return the faults of each run as arrays [runs, injection.slots]. An empty slot has code 0.
    code, effect and trigger are int32; value is float32. start, duration, every and period are
    int32 in ticks of `tick_ms`; with trigger "packet", all but the period are numbers of packets
    instead. key is uint32: the random-number stream of that run and slot.
    """
    code_of = {target: code for code, target in enumerate(injection.channels, start=1)}
    out = {name: np.zeros((len(table), injection.slots), dtype) for name, dtype in ARRAYS.items()}
    for slot in range(min(injection.slots, count_slots(table))):
        combination_of_run, combinations = _word_groups(table, slot)
        # Code, effect, trigger and value of each combination; NaN: the value is in the table.
        codes_of_combination = np.zeros((len(combinations), 4))
        for number, (site, arm, channel, effect, trigger) in enumerate(combinations):
            # An empty slot has the site "". A network effect may determine the value.
            if site:
                _, plain, value = NETWORK_EFFECTS.get(effect, ("", effect, None))
                codes_of_combination[number] = (
                    code_of[site, arm, channel],
                    EFFECT_CODES[plain],
                    TRIGGER_CODES[trigger],
                    math.nan if value is None else value,
                )
        *codes, fixed_value = codes_of_combination[combination_of_run].T
        for name, code in zip(("code", "effect", "trigger"), codes, strict=True):
            out[name][:, slot] = code
        value = np.where(np.isnan(fixed_value), table[f"fault{slot}_value"].to_numpy(), fixed_value)
        # The value of a drift is the change in a millisecond. It becomes the change in a tick.
        value = value * np.where(out["effect"][:, slot] == EFFECT_CODES["drift"], tick_ms, 1)
        out["value"][:, slot] = np.where(np.isnan(value), 0.0, value)
        unit = np.where(out["trigger"][:, slot] == TRIGGER_CODES["packet"], 1, tick_ms)
        for name in ("start", "duration", "every", "period"):
            times = table[f"fault{slot}_{name}_ms"].to_numpy()
            out[name][:, slot] = times // (tick_ms if name == "period" else unit)
        duration = out["duration"][:, slot]
        duration[duration < 0] = FOREVER_TICKS
        out["key"][:, slot] = run_id.stream_keys(shared_ids(table), f"slot {slot}")
    return out


def shared_ids(table: pd.DataFrame) -> np.ndarray:
    """Return the id from which each run's random numbers follow, uint64 [rows]. It is the run's id,
    or the id of the first run that differs only in crossed parameters.
    """
    return table[SHARED if SHARED in table else "run_id"].to_numpy()


def _word_groups(
    table: pd.DataFrame, slot: int
) -> tuple[np.ndarray, list[tuple[str, str, str, str, str]]]:
    """Return for each row the index of its combination of words, and the list of combinations, such
    as ("usb_out", "gold", "shoulder", "offset", "time"): the columns WORDS of a slot.
    """
    groups = table.groupby([f"fault{slot}_{name}" for name in WORDS], observed=True)
    return groups.ngroup().to_numpy(), groups.size().index.to_list()


def varied_parameters(table: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the varied parameters by path, float64 [runs]. NaN means the robot's value."""
    return {
        name.removeprefix("param:"): table[name].to_numpy().astype(np.float64, copy=False)
        for name in table
        if name.startswith("param:")
    }
