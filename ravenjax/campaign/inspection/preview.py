"""Shows what a campaign file would run, for `ravenjax check`, without running anything."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import notices
from ravenjax.campaign.faults import design, run_id, table
from ravenjax.campaign.faults.moments import Moments
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection import estimate
from ravenjax.campaign.plan import Plan, make_plan
from ravenjax.campaign.runner import make_manifest
from ravenjax.engines.interface import Block
from ravenjax.errors import StoreError
from ravenjax.numbers import paths
from ravenjax.store import manifest

SAMPLE = 8
"""Number of sample rows, evenly spaced over the fault table."""


def preview_campaign(
    config: CampaignConfig, folder: Path, engine: str = "auto"
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Return a description of a campaign before it runs, as JSON values, and SAMPLE rows of its
    fault table. folder: the folder that `ravenjax run` would write. Raise UserError for everything
    that `ravenjax run` would refuse.
    """
    from ravenjax.engines import selection

    plan, due = make_plan(config), design.count_due_rows(config)
    rows = plan.rows
    ticks = plan.runs * plan.program.ticks
    backend = selection.select_engine(engine, ticks=ticks)
    if any(config.own_parts()):
        from ravenjax.engines import traced

        # A user's file may read a number that does not exist, which only tracing detects.
        block = Block(*plan.lanes([0], 1), None)
        traced.traced_forms(traced.printable_program(plan.program), block, plan.columns)
    record = make_manifest(plan, backend)
    golden_runs = len(np.unique(plan.golden[:due]))
    faults = {
        group.name: [fault for some, _ in design.faults_and_axes(config, group) for fault in some]
        for group in config.group
    }
    every = list(itertools.chain(*faults.values()))
    work = estimate.CostFactors(
        runs=due,
        ticks=config.campaign.ticks,
        golden_runs=golden_runs,
        arms=len(config.campaign.arms),
        sites=max(1, len({fault.site for fault in every})),
        slots=max(1, config.slots),
        cues=len(record.cues),
        thresholds=sum(record.shape.detectors),
        substeps=getattr(plan.program.setup, "substeps", 1),
        reacts="reaction" in record.shape.stages,
    )
    cost = estimate.estimate_cost(work, backend.name, estimate.measure_speed())
    cost, basis, content = _of_folder(folder, config, backend.name, cost, due)
    names = dict.fromkeys(phase for fault in every for phase in fault.start_ms.phases)
    phases = Moments(config).phases if names else {}
    view = {
        "campaign": record.campaign,
        "description": config.campaign.description,
        "file": None if config.source is None else str(config.source),
        "runs": plan.runs,
        "runs_asked_for": due,
        "phases": [
            {"name": name, "ms": int(np.diff(phases[name]).sum()), "stretches": len(phases[name])}
            for name in names
        ],
        "fault_free_runs": int((plan.faults["code"] == 0).all(axis=1).sum()),
        "golden_runs": golden_runs,
        "copies": int(notices.find_copies(plan).sum()),
        "duration_ms": record.duration_ms,
        "arms": list(config.campaign.arms),
        **config.settings(),
        "cues": [cue.model_dump() for cue in record.cues],
        "detectors": [detector._asdict() for detector in record.detectors],
        "checks": list(_own_checks(config, plan)),
        "stop": None if config.stop is None else config.stop.model_dump(mode="json"),
        "groups": [
            {
                "name": group.name,
                "design": group.design,
                "runs": design.count_group_rows(config)[group.name],
                "sites": list(dict.fromkeys(fault.site for fault in faults[group.name])),
                "effects": list(
                    dict.fromkeys(e for fault in faults[group.name] for e in fault.effect.listed)
                ),
            }
            for group in config.group
        ],
        "faults": list(_fault_rows(config, rows)),
        "notices": list(notices.of_plan(plan)),
        "engine": {
            "name": backend.name,
            "device": backend.device,
            # Why a faster engine is not used.
            "why": selection.fastest_engine(None, ticks)[1] if engine == "auto" else "",
        },
        "expected": {**cost._asdict(), "basis": basis},
        "folder": {"path": str(folder), "holds": content},
    }
    places = np.unique(np.linspace(0, len(rows) - 1, min(SAMPLE, len(rows))).round().astype(int))
    sample = rows.iloc[places].reset_index(drop=True)
    ids = run_id.format_run_ids(sample["run_id"].to_numpy()).to_pylist()
    return view, sample.assign(run_id=ids)


def _own_checks(config: CampaignConfig, plan: Plan) -> Iterator[dict[str, Any]]:
    # Describes the user's checks with the values of their parameters in this campaign.
    if not config.check:
        return
    leaves = paths.path_leaves(plan.program.params, plan.program.setup)
    texts = {path: f"{float(value):g}" for path, value in leaves if path.startswith("checks.")}
    for path, values in table.varied_parameters(plan.rows).items():
        # NaN means the default in the user's file.
        least, most = f"{np.nanmin(values):g}", f"{np.nanmax(values):g}"
        texts[path] = least if least == most else f"{least} to {most}, varied"
    for check in config.check:
        prefix = f"checks.own.{check.name}."
        yield {
            "name": check.name,
            "at": check.at,
            "acts": check.acts,
            "does": check.check.does,
            "threshold": texts[f"checks.threshold.{check.name}"],
            "consecutive": check.consecutive,
            "parameters": {path: text for path, text in texts.items() if path.startswith(prefix)},
        }


def _fault_rows(config: CampaignConfig, rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the number of runs with each combination of fault site and effect, in the robot's order
    of sites. A run with two faults of the same site and effect counts once.
    """
    # (run, site, effect) of the fault in each slot.
    slots = [
        rows[["index", f"fault{slot}_site", f"fault{slot}_effect"]].set_axis(
            ["index", "site", "effect"], axis=1
        )
        for slot in range(config.slots)
    ]
    if not slots:
        return
    faults = slots[0] if len(slots) == 1 else pd.concat(slots).drop_duplicates()
    runs = faults.groupby(["site", "effect"], observed=True).size().to_dict()
    for site, declared in config.robot.sites.items():
        for effect in sorted(effect for run_site, effect in runs if run_site == site):
            number = runs[site, effect]
            yield {"site": site, "layer": declared.layer, "effect": effect, "runs": number}


def _of_folder(
    folder: Path, config: CampaignConfig, engine: str, cost: estimate.CostEstimate, runs: int
) -> tuple[estimate.CostEstimate, str, str]:
    """Return (expected cost, basis of this expectation, description of the folder's content). If
    the folder contains a part of the same campaign, its last speed gives the run time, in place of
    the model's `cost`. runs: number of all runs.
    """
    if not (folder / manifest.FILE).exists():
        return cost, estimate.BASIS, "no result yet"
    try:
        record = manifest.read_manifest(folder)
    except StoreError:
        return cost, estimate.BASIS, "a result that this version cannot read"
    content = (
        f"{record.done} of {record.runs} runs of campaign {record.campaign}; if this campaign is"
        " the same, `ravenjax run` continues it"
    )
    # The speed of another campaign, engine or duration is no basis.
    identity = config.campaign.name, engine, config.campaign.duration_ms
    if not record.runs_per_s or identity != (record.campaign, record.engine, record.duration_ms):
        return cost, estimate.BASIS, content
    left = max(0, runs - record.done)
    basis = (
        f"{record.runs_per_s:.0f} runs/s, measured at the folder's last start; {left} of"
        f" {runs} runs left"
    )
    return cost._replace(run_s=left / record.runs_per_s), basis, content
