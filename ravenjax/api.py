"""Campaigns from a notebook: load, run, look at one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import loading
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.replay import replay
from ravenjax.campaign.runner import OnProgress, run_campaign


def load_campaign(campaign: str | Path | dict[str, Any], overrides: Sequence[str] = ()) -> CampaignConfig:
    """A validated campaign from a TOML file, the name of a bundled one, or nested tables as TOML has them.

    overrides: `key.path=value`, as `--set` on the command line. Raises UserError that names what is wrong and where.
    """
    if isinstance(campaign, dict):
        for override in overrides:
            campaign = loading.overridden(campaign, override)
        return loading.from_dict(campaign, overrides=overrides)
    return loading.load(campaign, overrides)


def run(
    campaign: CampaignConfig | str | Path,
    out: str | Path | None = None,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
) -> pd.DataFrame:
    """Run a campaign; one row a run, columns as in results/README.md.

    out: result folder, resumed where it holds a part of this campaign; None keeps everything in memory.
    """
    config = campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)
    return run_campaign(config, None if out is None else Path(out), engine, on_progress=on_progress)


def simulate(campaign: CampaignConfig | str | Path, run: str | int = 0, engine: str = "auto") -> dict[str, np.ndarray]:
    """Time series of one run of a campaign: {name: [ticks] or [ticks, k]}, a tick a millisecond.

    run: index or run id. Names are those of `ravenjax.campaign.replay.series`; SI units, suffixes elsewhere.
    """
    config = campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)
    return replay(config, run, engine).series
