"""Runs a campaign from Python after checking the arguments."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ravenjax.campaign.executors import choose_executor
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.campaign.stop import adaptive
from ravenjax.errors import UserError, format_value
from ravenjax.store.access.results import Results


def run(
    config: CampaignConfig,
    out: Any,
    engine: str,
    on_progress: OnProgress | None,
    executor: str | None,
    workers: int | None,
) -> Results:
    """Run a campaign into `out`, a path, or into a temporary folder that is deleted with the
    results.

    Raises UserError and StoreError.
    """
    if out is not None and (not isinstance(out, str | os.PathLike) or not str(out)):
        raise UserError(
            f"out is {format_value(out)}, expected the path of a result folder, or None for a"
            " temporary one"
        )
    if on_progress is not None and not callable(on_progress):
        raise UserError(
            f"on_progress is {format_value(on_progress)}, expected a function of one Status, or"
            " None"
        )
    return adaptive.run_adaptively(
        config,
        None if out is None else Path(out),
        engine,
        on_progress=on_progress,
        executor=choose_executor(executor, workers),
    )
