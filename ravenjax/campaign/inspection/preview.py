"""What a campaign would run, as `ravenjax check` shows it: expanded and checked as for a run,
and nothing computed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design, moments, run_id
from ravenjax.campaign.faults.moments import Moments
from ravenjax.campaign.file import location, semantics
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import Group
from ravenjax.campaign.inspection.estimate import (
    BASIS,
    CostEstimate,
    CostFactors,
    Machine,
    estimate,
)
from ravenjax.campaign.plan import Plan, known_parameters, make_plan
from ravenjax.errors import StoreError
from ravenjax.numbers import paths
from ravenjax.store import manifest

MOST_EXPANDED = 1_000_000
"""Runs that are expanded to be looked at; of more, groups are counted alone."""

SAMPLE = 8
"""Runs of the sample, from the whole table."""


def preview(
    config: CampaignConfig, folder: Path, engine: str = "auto"
) -> tuple[dict[str, Any], pd.DataFrame]:
    """What is known before a campaign runs that is to go to `folder`, as JSON has it; and some rows
    of the fault table. Of too many runs to expand, what takes the whole table is None.

    Raises UserError for whatever `ravenjax run` would refuse.
    """
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    runs, due = design.count(config), design.due(config)
    plan = make_plan(config) if runs <= MOST_EXPANDED else None
    if plan is None:
        _require_parameters(config)
    rows = None if plan is None else plan.table
    backend = selection.select(engine, CAMPAIGN)
    machine = Machine(backend.name, len(os.sched_getaffinity(0)), _vector_width(backend.device))
    golden_runs = None if plan is None else len(np.unique(plan.golden[:due]))
    own_golden = config.campaign.noise or config.random_packets
    work = CostFactors(
        runs=due,
        ticks=config.campaign.ticks,
        golden_runs=(due if own_golden else 1) if golden_runs is None else golden_runs,
        arms=len(config.campaign.arms),
        sites=max(1, len({fault.site for group in config.group for fault in group.fault})),
        slots=max(1, config.slots),
        cues=len(config.haptics.cues()),
        thresholds=sum(len(thresholds) for _, _, thresholds in config.detectors),
        substeps=config.substeps,
        reacts=config.reacts,
    )
    cost, basis = _expected_cost(work, machine, config.campaign.name, folder)
    struck = None if rows is None else _struck_sites(config, rows)
    view = {
        "campaign": config.campaign.name,
        "description": config.campaign.description,
        "file": None if config.source is None else str(config.source),
        "runs": runs,
        "runs_asked_for": due,
        "phases": list(_phases(config)),
        "fault_free_runs": None if struck is None else int((struck == "").all(axis=1).sum()),
        "golden_runs": golden_runs,
        "copies": 0 if rows is None else _count_copies(config, rows),
        "duration_ms": config.campaign.ticks,
        "arms": list(config.campaign.arms),
        **config.settings(),
        "cues": [cue._asdict() for cue in config.haptics.cues()],
        "detectors": [
            {
                "name": name,
                "kind": use.kind,
                "fusion": use.fusion,
                "consecutive": use.consecutive,
                "thresholds": thresholds,
            }
            for name, use, thresholds in config.detectors
        ],
        "checks": list(_own_checks(config, plan)),
        "stop": None if config.stop is None else config.stop.model_dump(mode="json"),
        "groups": [_group_row(config, group) for group in config.group],
        "faults": None if rows is None else list(_fault_rows(config, rows)),
        "notices": [
            f"{location.dotted(key)}: {message}" for key, message in semantics.notices(config)
        ],
        "engine": {
            "name": backend.name,
            "device": backend.device,
            # why it is no faster engine
            "why": selection.fastest(CAMPAIGN)[1] if engine == "auto" else "",
        },
        "expected": {**cost._asdict(), "basis": basis},
        "folder": {"path": str(folder), "holds": _folder_content(folder)},
    }
    return view, pd.DataFrame() if rows is None else _sample_rows(rows)


def _require_parameters(config: CampaignConfig) -> None:
    """UserError for a path that names no parameter, a list that reads like a vector, a motion
    that cannot be read.
    """
    bare = config.model_copy(
        update={"group": (Group(name="bare"),), "parameters": {}, "cross": {}, "stop": None}
    )
    program = make_plan(bare).program
    loading.check_parameters(config, known_parameters(program.params, program.setup))


def _group_row(config: CampaignConfig, group: Group) -> dict[str, Any]:
    faults = [fault for entry, _ in design.faults_and_axes(config, group) for fault in entry]
    return {
        "name": group.name,
        "design": group.design,
        "runs": design.counts(config)[group.name],
        "sites": list(dict.fromkeys(fault.site for fault in faults)),
        "effects": list(dict.fromkeys(e for fault in faults for e in fault.effect.listed)),
    }


def _phases(config: CampaignConfig) -> Iterator[dict[str, Any]]:
    """The phases of the operation in which faults begin: ms in all, and stretches."""
    phases = Moments(config).phases if (names := list(moments.uses(config))) else {}
    for name in names:
        ms = int((phases[name][:, 1] - phases[name][:, 0]).sum())
        yield {"name": name, "ms": ms, "stretches": len(phases[name])}


def _own_checks(config: CampaignConfig, plan: Plan | None) -> Iterator[dict[str, Any]]:
    """What each of the user's checks looks at and does, with its numbers; those that vary with
    least and largest. Of a campaign that is not expanded the numbers of the files are left out.
    """
    numbers: dict[str, str] = {}
    if config.check and plan is not None:
        params, setup = plan.program.params, plan.program.setup
        numbers = {
            path: f"{float(value):g}"
            for path, value in paths.leaves(params.checks, setup, "checks")
        }
        for column in plan.table.filter(regex=r"^param:checks\."):
            path, values = str(column).removeprefix("param:"), plan.table[column]
            # NaN stands for the file's own number
            least, most = f"{values.min():g}", f"{values.max():g}"
            numbers[path] = least if least == most else f"{least} to {most}, varied"
    for check in config.check:
        prefix = f"checks.own.{check.name}."
        yield {
            "name": check.name,
            "at": check.at,
            "acts": check.acts,
            "does": check.check.does,
            "threshold": numbers.get(f"checks.threshold.{check.name}", f"{check.threshold:g}"),
            "consecutive": check.consecutive,
            "parameters": {p: value for p, value in numbers.items() if p.startswith(prefix)},
        }


def _struck_sites(config: CampaignConfig, rows: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {slot: rows[f"fault{slot}_site"].astype(str) for slot in range(config.slots)},
        index=rows.index,
    )


def _fault_rows(config: CampaignConfig, rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """How many runs each site is struck in by each effect, by the robot's order of sites; a run
    that is struck twice in the same way counts once.
    """
    hits: dict[tuple[str, str], np.ndarray] = {}
    for slot in range(config.slots):
        site, effect = (rows[f"fault{slot}_{key}"].astype(str) for key in ("site", "effect"))
        for pair in set(zip(site, effect, strict=True)) - {("", "")}:
            hit = ((site == pair[0]) & (effect == pair[1])).to_numpy()
            hits[pair] = hits.get(pair, np.zeros(len(rows), bool)) | hit
    sites = config.robot.sites
    order = list(sites)
    for site, effect in sorted(hits, key=lambda pair: (order.index(pair[0]), pair[1])):
        yield {
            "site": site,
            "layer": sites[site].layer,
            "effect": effect,
            "runs": int(hits[site, effect].sum()),
        }


def _count_copies(config: CampaignConfig, rows: pd.DataFrame) -> int:
    """Runs whose every input is that of an earlier one, where nothing else tells them apart."""
    if any(semantics.random_in_itself(config, group) for group in config.group):
        return 0
    inputs = [name for name in rows.columns if name.startswith(("fault", "param:"))]
    return int(rows.duplicated(inputs).sum()) if inputs else len(rows) - 1


def _sample_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows from all over the table, its ids in letters."""
    places = np.unique(np.linspace(0, len(rows) - 1, min(SAMPLE, len(rows))).round().astype(int))
    some = rows.iloc[places].reset_index(drop=True)
    return some.assign(run_id=run_id.text(some["run_id"].to_numpy()).to_pylist())


def _expected_cost(
    work: CostFactors, machine: Machine, name: str, folder: Path
) -> tuple[CostEstimate, str]:
    """What it will cost, by what the folder's last start measured where it holds a part of such
    a campaign.
    """
    cost, record = estimate(work, machine), _read_record(folder)
    alike = record is not None and (record.campaign, record.engine, record.duration_ms) == (
        name,
        machine.engine,
        work.ticks,
    )
    if record is None or not alike or not record.runs_per_s:
        return cost, BASIS
    left = max(0, work.runs - record.done)
    speed = f"{record.runs_per_s:.0f} runs/s, measured at the folder's last start"
    return (
        cost._replace(run_s=left / record.runs_per_s),
        f"{speed}; {left} of {work.runs} runs left",
    )


def _read_record(folder: Path) -> manifest.Manifest | None:
    try:
        return manifest.read(folder) if (folder / manifest.FILE).exists() else None
    except StoreError:
        return None


def _folder_content(folder: Path) -> str:
    """What the result folder holds, in words."""
    if not (folder / manifest.FILE).exists():
        return "nothing yet"
    record = _read_record(folder)
    if record is None:
        return "a result that this version does not read"
    return (
        f"{record.done} of {record.runs} runs of campaign {record.campaign}; a run goes on where it"
        " is the same one"
    )


def _vector_width(device: str) -> int:
    """float32 numbers in a vector of this CPU, by its engine's words."""
    return next((width for name, width in (("AVX-512", 16), ("AVX2", 8)) if name in device), 4)
