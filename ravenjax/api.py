"""Campaigns from a notebook: load, run, look at one run."""

from __future__ import annotations

import numbers
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import adaptive, loading
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.executors import choice
from ravenjax.campaign.progress import OnProgress
from ravenjax.campaign.replay import replay
from ravenjax.errors import UserError, shown


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
    """Run a campaign; one row a run, columns as in results/README.md.

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
    return adaptive.run(config, folder, _engine(engine), on_progress=on_progress, executor=who).frame()


def simulate(
    campaign: CampaignConfig | str | Path | dict[str, Any], run: str | int = 0, engine: str = "auto"
) -> dict[str, np.ndarray]:
    """Time series of one run of a campaign: {name: [ticks] or [ticks, k]}, a tick a millisecond.

    run: index, run id, or the beginning of one. Names are those of `ravenjax.campaign.replay.series`; SI units,
    suffixes elsewhere. Raises UserError.
    """
    if isinstance(run, bool) or not isinstance(run, str | numbers.Integral):
        raise UserError(f"run is {shown(run)}, expected its index (a whole number) or its run_id (text)")
    config = _config(campaign)
    return replay(config, run if isinstance(run, str) else int(run), _engine(engine)).series


def _config(campaign: Any) -> CampaignConfig:
    return campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)


def _engine(engine: Any) -> str:
    if not isinstance(engine, str):
        raise UserError(f"engine is {shown(engine)}, expected auto or the name of an engine (text)")
    return engine
