"""Campaigns from a notebook: load, run, look at one run."""

# Callers may pass anything, and pandas has no types.
# pyright: reportUnnecessaryIsInstance=false, reportMissingTypeStubs=false

from __future__ import annotations

import numbers
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ravenjax.campaign import loading
from ravenjax.campaign.executors.carriers import choice
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.explain import Explainer
from ravenjax.campaign.inspection.replay import replay
from ravenjax.campaign.progress.counts import OnProgress
from ravenjax.campaign.stop import adaptive
from ravenjax.errors import UserError, shown
from ravenjax.report import wording
from ravenjax.report.run import chain
from ravenjax.store import manifest, schema
from ravenjax.store.logs import run_dataset

if TYPE_CHECKING:
    import xarray


def load_campaign(campaign: str | Path | dict[str, Any], overrides: Sequence[str] = ()) -> CampaignConfig:
    """A validated campaign from a TOML file, the name of a bundled one, or nested tables as TOML has them.

    overrides: `key.path=value`, as `--set` on the command line. Raises UserError that names what is wrong and where.
    """
    if isinstance(campaign, dict):
        return loading.from_dict(campaign, overrides=overrides)
    return loading.load(campaign, overrides)


def run(
    campaign: CampaignConfig | str | Path | dict[str, Any],
    out: str | Path | None = None,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
    executor: str | None = None,
    workers: int | None = None,
) -> pd.DataFrame:
    """Run a campaign; one row a run, columns as in results/README.md; their units and meanings are in `attrs`.

    out: result folder, resumed where it holds a part of this campaign; None keeps everything in memory. executor:
    "local" (this process), "processes" or "ray"; workers: processes or tasks side by side; the table is the same.
    Raises UserError and, for what is wrong with `out`, StoreError.
    """
    if out is not None and (not isinstance(out, str | os.PathLike) or not str(out)):
        raise UserError(f"out is {shown(out)}, expected the path of a result folder, or None to keep it in memory")
    if on_progress is not None and not callable(on_progress):
        raise UserError(f"on_progress is {shown(on_progress)}, expected a function of one Status, or None")
    config = _config(campaign)
    folder, who = None if out is None else Path(out), choice.executor(executor, workers)
    results = adaptive.run(config, folder, _engine(engine), on_progress=on_progress, executor=who)
    table = results.frame()
    table.attrs.update(described(results.shape))
    return table


def described(shape: schema.Shape) -> dict[str, dict[str, str]]:
    """What `run` puts into the attrs of its table: {"units": {column: unit}, "meanings": {column: meaning}}."""
    columns = schema.columns(shape)
    return {
        "units": {column.name: column.unit for column in columns},
        "meanings": {column.name: column.meaning for column in columns},
    }


def simulate(
    campaign: CampaignConfig | str | Path | dict[str, Any], run: str | int = 0, engine: str = "auto"
) -> xarray.Dataset:
    """Time series of one run of a campaign, a tick a millisecond, as an xarray.Dataset.

    One variable a quantity (`store.logs.time_series` lists them), with attrs units and long_name; coordinates time
    (s), arm, joint, axis, fault and cue: `simulate(c, 42)["tip"].sel(arm="gold", axis="z")`. attrs of the dataset say
    which run it is and what became of it. run: index, run id, or the beginning of one. Raises UserError.
    """
    if isinstance(run, bool) or not isinstance(run, str | numbers.Integral):
        raise UserError(f"run is {shown(run)}, expected its index (a whole number) or its run_id (text)")
    config = _config(campaign)
    again = replay(config, run if isinstance(run, str) else int(run), _engine(engine))
    row: dict[str, Any] = {str(name): value for name, value in again.row.items()}
    plain = ("run_id", "group", "operator", "verdict", "response", "response_cause", "hazard")
    attributes = {name: str(row[name]) for name in plain} | {
        "index": int(row["index"]),
        "seed": int(row["seed"]),
        "fault": wording.fault(row, config.robot),
        "campaign": config.campaign.name,
        "engine": again.engine,
        "version": manifest.package_versions()["ravenjax"],
    }
    return run_dataset.dataset(
        again.series, attributes, [cue.threshold_m * 1e3 for cue in config.haptics.cues()], config.robot
    )


def explain(
    campaign: CampaignConfig | str | Path | dict[str, Any],
    runs: int | str | Sequence[int | str] | None = None,
    engine: str = "auto",
) -> pd.DataFrame:
    """How faults spread, tick by tick against the golden run: one row a run and signal that differs, by run, then in
    the robot's order.

    Columns run_id, index, layer, arm, seam; differs_ms, when the signal first differed in any bit, and differs_in, in
    which number; leaves_ms and leaves_in, when it first left its normal range (-1: never); harm_ms, when the run's
    hazard began (-1: none did), and left_ms, how long before that the signal left its range. attrs say which engine.

    campaign: as for `run`, or a result folder. runs: index, run id, or the beginning of one, or several; None: every
    run with a fault. Raises UserError, and StoreError for a folder that cannot be read.
    """
    name = _engine(engine)
    if isinstance(campaign, str | Path) and (Path(campaign) / manifest.FILE).is_file():
        explainer = Explainer.of_folder(Path(campaign), name)
    else:
        explainer = Explainer(_config(campaign), name)
    wanted = runs if runs is None or (isinstance(runs, Sequence) and not isinstance(runs, str)) else [runs]
    rows = explainer.faulty() if wanted is None else [_row(explainer, one) for one in wanted]
    explanation, config = explainer.explain(rows), explainer.config
    table = chain.table(explanation.results, explanation.ticks, config.robot, config.campaign.arms)
    table.attrs.update({"campaign": config.campaign.name, "engine": explanation.engine})
    return table


def _row(explainer: Explainer, run: Any) -> int:
    if isinstance(run, bool) or not isinstance(run, str | numbers.Integral):
        raise UserError(f"a run is {shown(run)}, expected its index (a whole number) or its run_id (text)")
    return explainer.index(run if isinstance(run, str) else int(run))


def _config(campaign: Any) -> CampaignConfig:
    return campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)


def _engine(engine: Any) -> str:
    if not isinstance(engine, str):
        raise UserError(f"engine is {shown(engine)}, expected auto or the name of an engine (text)")
    return engine
