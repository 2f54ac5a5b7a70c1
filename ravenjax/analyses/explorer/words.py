"""Describes a campaign and the runs of a result folder as JSON, for the explorer's page."""

import contextlib
import itertools
import json
import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
import tomlkit

from ravenjax.analyses.explorer import program
from ravenjax.analyses.explorer.program import WORDS
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.outcomes import verdict
from ravenjax.report.data.facts import OUTCOMES
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.store import schema
from ravenjax.store.folder import Results
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary.effects import EFFECTS
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import Channel, ChannelRange, Site

NOT_OFFERED = ("periodic", "random", "lose")
"""Effects that the page does not offer. The random numbers of two depend on the row of a run."""


def describe_campaign(config: CampaignConfig) -> dict[str, Any]:
    """Return JSON of a campaign: sites, effects, checks, ranges, limits and the campaign file."""
    robot, arms, cues = config.robot, config.campaign.arms, config.haptics.cues()
    return {
        "name": config.campaign.name,
        "description": config.campaign.description,
        "robot": robot.title,
        "arms": arms,
        "joints": robot.joints,
        "linear": robot.linear,
        "duration_ms": config.campaign.duration_ms,
        "limit_mm": config.outcomes.limit_mm,
        "harm": config.rules.harm if config.rules.harms else "",
        "halt_ms": verdict.HALT_MS,
        "cue": config.outcomes.cue,
        "cues": {
            "threshold_mm": [round(cue.threshold_m * 1e3, 9) for cue in cues],
            "kp_per_mm": [round(cue.kp / 1e3, 9) for cue in cues],
            "kd_per_mm_s": [round(cue.kd / 1e3, 9) for cue in cues],
            "cap": [cue.cap for cue in cues],
        },
        "sites": [
            _describe_site(robot, site, arms) for site in robot.sites.values() if site.channels
        ],
        "effects": {
            name: {
                "words": WORDS["effects"][name],
                "meaning": effect.meaning,
                "value": effect.value,
            }
            for name, effect in EFFECTS.items()
        },
        "checks": {
            name: {"meaning": check.meaning, "does": check.does, "unit": check.unit}
            for name, check in robot.checks.items()
        },
        "unasked": NOT_OFFERED,
        "outcomes": OUTCOMES,
        "values": _value_ranges(config),
        "toml": _campaign_file(config),
        "varied": _varied_paths(config),
    }


def _describe_site(robot: Robot, site: Site, arms: Iterable[str]) -> dict[str, Any]:
    # Returns a fault site for the page. The normal ranges of its channels are of the first arm.
    return {
        "site": site.name,
        "layer": robot.layers[site.layer],
        "words": WORDS["sites"].get(site.name, site.where),
        "where": site.where,
        "per_arm": site.per_arm,
        "channels": [
            _describe_channel(
                channel, robot.normal_range(site.name, channel.name, next(iter(arms)))
            )
            for channel in site.channels
        ],
    }


def _describe_channel(channel: Channel, normal: ChannelRange | None) -> dict[str, Any]:
    # Returns a channel's unit, whether its numbers are whole, its limits and its normal range.
    low, high = channel.extent
    return {
        "name": channel.name,
        "unit": WORDS["units"].get(channel.unit, channel.unit),
        "whole": channel.kind != "float",
        "bits": channel.bits,
        "low": low,
        "high": high,
        "usual": [normal.low_permille, normal.high_permille] if normal else None,
    }


def _value_ranges(config: CampaignConfig) -> dict[str, list[float]]:
    # Returns the smallest and largest value of each "site/effect", for the page's slider.
    values = defaultdict[str, list[float]](list)
    for group in config.group:
        # A group with listed runs has faults for each run.
        fault_lists = [group.faults_of(run) for run in group.run] if group.run else [group.fault]
        for fault in itertools.chain.from_iterable(fault_lists):
            if fault.value is None:
                continue
            # Listed values, or both ends of a distribution.
            numbers = fault.value.listed or fault.value.extent
            for effect in fault.effect.listed:
                values[f"{fault.site}/{effect}"] += map(float, numbers)
    return {name: [min(numbers), max(numbers)] for name, numbers in values.items()}


def _varied_paths(config: CampaignConfig) -> list[str]:
    # Returns the paths of parameters with several values, then of crossed parameters.
    varied = [path for path, axis in config.parameters.items() if axis.kind != "fixed"]
    return [*varied, *config.cross]


def _campaign_file(config: CampaignConfig) -> str:
    """Return the campaign's file without cues, groups and varied parameters, which the page adds.
    Paths become file names. A motion that the page can change comes first in [operator].
    """
    excluded = {"group", "stop", "haptics", "cross"}
    content = config.model_dump(exclude_defaults=True, exclude=excluded)
    # Paths of files are the only values that JSON cannot express.
    tables = json.loads(json.dumps(content, default=lambda path: path.name))
    parameters = tables.setdefault("parameters", {})
    for path in _varied_paths(config):
        parameters.pop(path, None)
    motion = program.motion_name(config)
    if motion is not None:
        tables["operator"] = {"motion": motion} | tables.get("operator", {})
    return tomlkit.dumps({name: table for name, table in tables.items() if table})


# --- the table of a result folder ---

MAX_ROWS = 20_000
"""Largest number of table rows in a page: the first rows of the table."""
_CHECKED_COLUMNS = r"fault0_(trigger|every_ms)|fault[1-9]\d*_site"
FAULT_COLUMNS = ("site", "arm", "channel", "effect", "value", "start_ms", "duration_ms")


def list_runs(folder: Path, record: Manifest) -> dict[str, Any]:
    """Return JSON of a result table for a page.

    Keys: folder (its name), cue (number of the set of the verdict), runs (of the table), rows (runs
    in the page, at most MAX_ROWS), columns (name -> list), evading (rate of faults that evade).
    Runs that a page cannot compute are left out (see `_is_computable`).
    """
    cue, names = record.verdict_cue, [column.name for column in schema.table_columns(record.shape)]
    columns = {
        "run_id": "run_id",
        "index": "index",
        "group": "group",
        **{name: f"fault0_{name}" for name in FAULT_COLUMNS},
        **{name: name for name in WORDS["measures"]},
        "cue_ms": f"cue{cue}_first_ms",
        **{name: name for name in names if name.startswith("param:")},
    }
    columns = {name: column for name, column in columns.items() if column in names}
    checked = [name for name in names if re.fullmatch(_CHECKED_COLUMNS, name)]
    frame = Results(record.shape, folder).frame([*columns.values(), *checked])
    shown = frame.loc[_is_computable(frame)].head(MAX_ROWS)
    with contextlib.closing(Runs.open(folder, record)) as runs:
        evading = tables.headline_counts(runs, record)["evaded"]
    return {
        "folder": folder.name,
        "cue": cue,
        "runs": len(frame),
        "rows": len(shown),
        "evading": evading._asdict(),
        "columns": {
            # Numbers and truth values stay as they are. Categories become text.
            name: (
                shown[column] if shown[column].dtype.kind in "fiub" else shown[column].astype(str)
            ).tolist()
            for name, column in columns.items()
        },
    }


def _is_computable(frame: pd.DataFrame) -> pd.Series:
    # Returns whether a page can compute each run: it has at most one fault, in one window that
    # opens at a given time, and the page offers the fault's effect.
    sites = frame.filter(regex=r"^fault\d+_site$").astype(str)
    if sites.empty:
        return pd.Series(True, index=frame.index)
    has_one_window = frame["fault0_trigger"].astype(str).eq("time") & frame["fault0_every_ms"].eq(0)
    is_offered = ~frame["fault0_effect"].astype(str).isin(NOT_OFFERED)
    has_no_fault = sites["fault0_site"].eq("")
    has_no_second_fault = sites.drop(columns="fault0_site").eq("").all(axis=1)
    return has_no_second_fault & (has_no_fault | has_one_window & is_offered)
