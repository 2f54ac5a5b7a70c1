"""Runs a campaign for who calls from Python: what callers may pass is looked at before any work."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ravenjax.campaign.executors import choose_executor
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.campaign.stop import adaptive
from ravenjax.errors import UserError, shown
from ravenjax.store.access.results import Results


def run(
    config: CampaignConfig,
    out: Any,
    engine: Any,
    on_progress: OnProgress | None,
    executor: str | None,
    workers: int | None,
) -> Results:
    """Run it into `out`, a path, or in memory where it is None. Raises UserError and StoreError."""
    require(out, on_progress)
    folder, carrier = None if out is None else Path(out), choose_executor(executor, workers)
    return adaptive.run(
        config, folder, engine_name(engine), on_progress=on_progress, executor=carrier
    )


def require(out: Any, on_progress: Any) -> None:
    """UserError unless `out` is a path or None, and `on_progress` a function or None."""
    if out is not None and (not isinstance(out, str | os.PathLike) or not str(out)):
        raise UserError(
            f"out is {shown(out)}, expected the path of a result folder, or None to keep it in"
            " memory"
        )
    if on_progress is not None and not callable(on_progress):
        raise UserError(
            f"on_progress is {shown(on_progress)}, expected a function of one Status, or None"
        )


def engine_name(engine: Any) -> str:
    """The name of an engine. UserError for what is no text."""
    if not isinstance(engine, str):
        raise UserError(f"engine is {shown(engine)}, expected auto or the name of an engine (text)")
    return engine
