"""What a campaign would run, as `ravenjax check` shows it: expanded and checked as for a run,
and nothing computed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign import copies, loading
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


class GroupRow(NamedTuple):
    """A group of runs."""

    name: str
    design: str
    runs: int
    sites: tuple[str, ...]
    effects: tuple[str, ...]


class FaultRow(NamedTuple):
    """How many runs a site is struck in by an effect."""

    site: str
    layer: str
    effect: str
    runs: int


class PhaseRow(NamedTuple):
    """A phase of the operation in which faults begin."""

    name: str
    ms: int  # in all
    stretches: int


class OwnCheckPreview(NamedTuple):
    """A check of one's own; values in words, those that vary with all that the file lists."""

    name: str
    at: str
    acts: str
    does: str
    threshold: str
    consecutive: int
    parameters: dict[str, str]  # path -> value


class Preview(NamedTuple):
    """Everything that is known before a campaign runs."""

    config: CampaignConfig
    runs: int  # rows of the fault table
    due: int  # of them asked for: all but with a limit
    groups: tuple[GroupRow, ...]
    faults: tuple[FaultRow, ...] | None  # None: too many runs to expand
    phases: tuple[PhaseRow, ...]  # that onsets of faults name
    checks: tuple[OwnCheckPreview, ...]  # of one's own
    fault_free: int | None  # runs without a fault, None as above
    golden_runs: int | None  # that the runs are compared with, None as above
    copies: int  # runs that are another one to the letter
    sample: pd.DataFrame  # some rows of the fault table
    notices: tuple[str, ...]  # what is accepted and may not be meant
    engine: str
    device: str
    why: str  # why it is no faster engine, "" if there is none
    cost: CostEstimate
    basis: str  # where the estimate comes from
    folder: Path
    state: str  # what the result folder holds


def preview(config: CampaignConfig, folder: Path, engine: str = "auto") -> Preview:
    """Look at a campaign that is to go to `folder`. Raises UserError for whatever `ravenjax run`
    would refuse.
    """
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    runs, due = design.count(config), design.due(config)
    plan = make_plan(config) if runs <= MOST_EXPANDED else None
    if plan is None:
        _require_parameters(config)
    rows = None if plan is None else plan.table
    backend = selection.select(engine, CAMPAIGN)
    why = selection.fastest(CAMPAIGN)[1] if engine == "auto" else ""
    machine = Machine(backend.name, len(os.sched_getaffinity(0)), _width(backend.device))
    golden_runs = None if plan is None else len(np.unique(plan.golden[:due]))
    own_golden = config.campaign.noise or config.random_packets
    sites = {fault.site for group in config.group for fault in group.fault}
    work = CostFactors(
        runs=due,
        ticks=config.campaign.ticks,
        golden_runs=(due if own_golden else 1) if golden_runs is None else golden_runs,
        arms=len(config.campaign.arms),
        sites=max(1, len(sites)),
        slots=max(1, config.slots),
        cues=len(config.haptics.cues()),
        thresholds=sum(len(thresholds) for _, _, thresholds in config.detectors),
        substeps=config.substeps,
        reacts=config.reacts,
    )
    cost, basis = _expected(work, machine, config.campaign.name, folder)
    return Preview(
        config=config,
        runs=runs,
        due=due,
        groups=tuple(_group(config, group, runs) for group, runs in _sizes(config)),
        faults=None if rows is None else tuple(_faults(config, rows)),
        phases=tuple(_phases(config)),
        checks=tuple(_checks(config, plan)),
        fault_free=None if rows is None else int((_sites(config, rows) == "").all(axis=1).sum()),
        golden_runs=golden_runs,
        copies=0 if rows is None else _copies(config, rows),
        sample=pd.DataFrame() if rows is None else _sample(rows),
        notices=tuple(_notices(config)),
        engine=backend.name,
        device=backend.device,
        why=why,
        cost=cost,
        basis=basis,
        folder=folder,
        state=_state(folder),
    )


def _require_parameters(config: CampaignConfig) -> None:
    """UserError for a path that names no parameter, a list that reads like a vector, a motion
    that cannot be read.
    """
    bare = config.model_copy(
        update={"group": (Group(name="bare"),), "parameters": {}, "cross": {}, "stop": None}
    )
    program = make_plan(bare).program
    loading.check_parameters(config, known_parameters(program.params, program.setup))


def _sizes(config: CampaignConfig) -> Iterator[tuple[Group, int]]:
    counts = design.counts(config)
    return ((group, counts[group.name]) for group in config.group)


def _group(config: CampaignConfig, group: Group, runs: int) -> GroupRow:
    faults = [fault for entry, _ in design.faults_and_axes(config, group) for fault in entry]
    sites = dict.fromkeys(fault.site for fault in faults)
    effects = dict.fromkeys(effect for fault in faults for effect in fault.effect.listed)
    return GroupRow(group.name, group.design, runs, tuple(sites), tuple(effects))


def _phases(config: CampaignConfig) -> Iterator[PhaseRow]:
    phases = Moments(config).phases if (names := list(moments.uses(config))) else {}
    for name in names:
        yield PhaseRow(
            name, int((phases[name][:, 1] - phases[name][:, 0]).sum()), len(phases[name])
        )


def _checks(config: CampaignConfig, plan: Plan | None) -> Iterator[OwnCheckPreview]:
    """What each looks at and does, with its numbers; those that vary with least and largest. Of a
    campaign that is not expanded the numbers of the files are left out."""
    numbers: dict[str, str] = {}
    if config.check and plan is not None:
        params, setup = plan.program.params, plan.program.setup
        numbers = {
            path: f"{float(value):g}"
            for path, value in paths.leaves(params.checks, setup, "checks")
        }
        for column in plan.table.filter(regex=r"^param:checks\."):
            path, values = str(column).removeprefix("param:"), plan.table[column]
            least, most = (
                f"{value:g}" for value in (values.min(), values.max())
            )  # NaN: the file's
            numbers[path] = least if least == most else f"{least} to {most}, varied"
    for one in config.check:
        own = f"checks.own.{one.name}."
        yield OwnCheckPreview(
            one.name,
            one.at,
            one.acts,
            one.check.does,
            numbers.get(f"checks.threshold.{one.name}", f"{one.threshold:g}"),
            one.consecutive,
            {path: value for path, value in numbers.items() if path.startswith(own)},
        )


def _sites(config: CampaignConfig, rows: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {slot: rows[f"fault{slot}_site"].astype(str) for slot in range(config.slots)},
        index=rows.index,
    )


def _faults(config: CampaignConfig, rows: pd.DataFrame) -> Iterator[FaultRow]:
    """By the robot's order of sites; a run that is struck twice in the same way counts once."""
    hits: dict[tuple[str, str], np.ndarray] = {}
    for slot in range(config.slots):
        site, effect = (
            rows[f"fault{slot}_site"].astype(str),
            rows[f"fault{slot}_effect"].astype(str),
        )
        for pair in set(zip(site, effect, strict=True)) - {("", "")}:
            hit = ((site == pair[0]) & (effect == pair[1])).to_numpy()
            hits[pair] = hits.get(pair, np.zeros(len(rows), bool)) | hit
    sites = config.robot.sites
    order = list(sites)
    for site, effect in sorted(hits, key=lambda pair: (order.index(pair[0]), pair[1])):
        yield FaultRow(site, sites[site].layer, effect, int(hits[site, effect].sum()))


def _inputs(rows: pd.DataFrame) -> list[str]:
    return [name for name in rows.columns if name.startswith(("fault", "param:"))]


def _copies(config: CampaignConfig, rows: pd.DataFrame) -> int:
    """Runs whose every input is that of an earlier one, where nothing else tells them apart."""
    random = any(semantics.random_in_itself(config, group) for group in config.group)
    if random:
        return 0
    inputs = _inputs(rows)
    return int(rows.duplicated(inputs).sum()) if inputs else len(rows) - 1


def _sample(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows from all over the table, its ids in letters."""
    places = np.unique(np.linspace(0, len(rows) - 1, min(SAMPLE, len(rows))).round().astype(int))
    some = rows.iloc[places].reset_index(drop=True)
    return some.assign(run_id=run_id.text(some["run_id"].to_numpy()).to_pylist())


def _notices(config: CampaignConfig) -> Iterator[str]:
    for key, message in copies.notices(config):
        yield f"{location.dotted(key)}: {message}"


def _expected(
    work: CostFactors, machine: Machine, name: str, folder: Path
) -> tuple[CostEstimate, str]:
    """What it will cost, by what the folder's last start measured where it holds a part of such
    a campaign.
    """
    cost, record = estimate(work, machine), _record(folder)
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


def _record(folder: Path) -> manifest.Manifest | None:
    try:
        return manifest.read(folder) if (folder / manifest.FILE).exists() else None
    except StoreError:
        return None


def _state(folder: Path) -> str:
    """What the result folder holds, in words."""
    if not (folder / manifest.FILE).exists():
        return "nothing yet"
    record = _record(folder)
    if record is None:
        return "a result that this version does not read"
    return (
        f"{record.done} of {record.runs} runs of campaign {record.campaign}; a run goes on where it"
        " is the same one"
    )


def _width(device: str) -> int:
    """float32 numbers in a vector of this CPU, by its engine's words."""
    return next((width for name, width in (("AVX-512", 16), ("AVX2", 8)) if name in device), 4)


def as_json(view: Preview, faults: Sequence[str]) -> dict[str, Any]:
    """Everything as JSON has it; `faults`: the sample's faults in words."""
    config = view.config
    sample = view.sample
    return {
        "campaign": config.campaign.name,
        "description": config.campaign.description,
        "file": None if config.source is None else str(config.source),
        "runs": view.runs,
        "runs_asked_for": view.due,
        "phases": [row._asdict() for row in view.phases],
        "fault_free_runs": view.fault_free,
        "golden_runs": view.golden_runs,
        "copies": view.copies,
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
        "checks": [one._asdict() for one in view.checks],
        "stop": None if config.stop is None else config.stop.model_dump(mode="json"),
        "groups": [row._asdict() for row in view.groups],
        "faults": None if view.faults is None else [row._asdict() for row in view.faults],
        "sample": [
            {
                "index": int(row["index"]),
                "run_id": row["run_id"],
                "group": str(row["group"]),
                "fault": words,
            }
            for row, words in zip(sample.to_dict("records"), faults, strict=True)
        ],
        "notices": list(view.notices),
        "engine": {"name": view.engine, "device": view.device, "why": view.why},
        "expected": {**view.cost._asdict(), "basis": view.basis},
        "folder": {"path": str(view.folder), "holds": view.state},
    }
