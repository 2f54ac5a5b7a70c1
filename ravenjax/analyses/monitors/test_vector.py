"""Records a monitor's inputs and scores in each millisecond, to test its C code."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from ravenjax import consent
from ravenjax.analyses.monitors import code
from ravenjax.analyses.monitors.monitor import Monitor, list_reads
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.file.config import CampaignConfig, validate_tables
from ravenjax.campaign.inspection.replay import LANES
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError

SECONDS = 3.0
FAULT = {
    "site": "usb_out",
    "effect": "overwrite",
    "value": 20000,
    "start_ms": 1500,
    "duration_ms": 100,
}
"""Fault that causes an alarm if a robot has this site, which is after every software check."""
_NAME, _SAME_LANES = "monitor", 2


def compute_test_vector(
    config: CampaignConfig, monitor: Monitor, seed: int, engine: str = "auto"
) -> pd.DataFrame:
    """Return one row per millisecond of the first arm of `config`'s robot.

    Columns: ms, live, the monitor's inputs, score (0 while not live), alarm. The run has a fault if
    the robot has the site of FAULT. Raises UserError for a robot that does not show what its
    detectors read.
    """
    robot = config.robot
    part: Any = robot.part("campaign")
    if not hasattr(part, "watched"):
        raise UserError(
            f"robot {robot.name!r} does not show what its detectors see, so there is no test"
            " vector: expected a robot whose part `campaign` has `watched`, as raven2"
        )
    compile_cache.enable_cache()
    with TemporaryDirectory() as folder, consent.given_for(Path(folder)):
        file = Path(folder) / "monitor.py"
        text = code.write_part(monitor.terms, monitor.segments, monitor.scales, records=True)
        file.write_text(text, encoding="utf-8")
        ready = plan.make_plan(_campaign(config, monitor, seed, file))
        program = part.watched(ready.program)
        tracer = selection.select_engine(
            engine, program.setup.precision, compile_cache.object_cache()
        ).tracer(program, LANES)
        golden, block = (
            Block(*ready.lanes([0], LANES, harmless=harmless), None) for harmless in (True, False)
        )
        *_, signals = tracer.run(golden, block, ready.columns)
    own, before = signals.detectors.own[0][0], signals.detectors.detectors[0].recent[0]
    armed_after = ready.program.params.detectors.armed_after
    live = np.asarray(signals.live).astype(bool) & (np.arange(len(before)) >= armed_after)
    score = np.asarray(before, np.float32)
    inputs = {
        name: np.asarray(getattr(own, f"read_{name}"), np.float32)
        for name in list_reads(monitor.terms, monitor.segments)
    }
    alarm = score > np.float32(monitor.threshold)
    columns = {"live": live.astype(int), **inputs, "score": score, "alarm": alarm.astype(int)}
    return pd.DataFrame({"ms": range(len(score))} | columns)


def _campaign(config: CampaignConfig, monitor: Monitor, seed: int, file: Path) -> CampaignConfig:
    """Return a short campaign of one arm, whose only detector shows the score of each tick."""
    own, robot = config.model_dump(mode="json"), config.robot
    group: dict[str, Any] = {"name": "vector"}
    if FAULT["site"] in robot.sites:
        group["fault"] = [FAULT | {"channel": robot.joints[0]}]
    settings = {
        "duration_s": SECONDS,
        "arms": [config.campaign.arms[0]],
        "seed": seed,
        "limit": None,
        "observe_ms": None,
    }
    raw = own | {"reaction": None, "stop": None, "cross": {}, "group": [group]}
    raw["campaign"] = own["campaign"] | settings
    raw["parameters"] = {
        path: value for path, value in own["parameters"].items() if _is_plain(config, path)
    }
    raw["detector"] = [
        {
            "name": _NAME,
            "file": str(file),
            "consecutive": _SAME_LANES,
            "threshold": [monitor.threshold],
        }
    ]
    return validate_tables(raw)


def _is_plain(config: CampaignConfig, path: str) -> bool:
    """Return whether a parameter is a single number, and of the arm that is kept."""
    lost = {f".{arm}." for arm in config.campaign.arms[1:]}
    return config.parameters[path].kind == "fixed" and not any(arm in path for arm in lost)
