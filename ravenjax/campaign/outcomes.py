"""From what an engine returns to rows of the result table: names, types, response and verdict."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ravenjax.campaign.config import CampaignConfig
from ravenjax.store import schema

STOPS: dict[str, str] = {
    "overdrive_instant": "overdrive",
    "overdrive_hard": "hard_counter",
    "soft_estop": "soft_estop",
    "plc_watchdog": "watchdog",
    "estop": "plc",
}
"""Checks that stop the robot and the name of each as a cause, earliest in the loop first."""


def checks(names: list[str]) -> tuple[str, ...]:
    """Names of the checks among outcome columns."""
    return tuple(
        n.removeprefix("check_").removesuffix("_count")
        for n in names
        if n.startswith("check_") and n.endswith("_count")
    )


def frame(config: CampaignConfig, runs: pd.DataFrame, outcomes: pd.DataFrame, twins: pd.DataFrame) -> pd.DataFrame:
    """Rows of the result table.

    runs: rows of the fault table. outcomes: what the engine returned for each; twins: the same of its fault-free twin.
    """
    runs, outcomes, twins = (part.reset_index(drop=True) for part in (runs, outcomes, twins))
    out = pd.concat([runs, outcomes], axis=1)
    faulty = np.zeros(len(runs), bool)
    for column in runs.columns[runs.columns.str.fullmatch(r"fault\d+_site")]:
        faulty |= (runs[column] != "").to_numpy()
    out["activated"] = outcomes["active_ticks"] > 0
    out["diverged"] = faulty & (outcomes["diverged_ms"] >= 0)
    for rule in ("code", "text"):
        first = outcomes[f"jump_{rule}_ms"]
        out[f"jump_{rule}"] = first >= 0
        out[f"jump_{rule}_first_ms"] = first
    out["failed"] = np.where(outcomes["failed_ms"] >= 0, "nan", "")
    out["tissue_depth_mm"] = np.maximum(outcomes["tissue_depth_mm"], 0.0)
    out["tip_distance_mm"] = outcomes["tip_distance_mm"].where(np.isfinite(outcomes["tip_distance_mm"]))
    out = out.drop(columns=["diverged_ms", "jump_code_ms", "jump_text_ms", "failed_ms"])
    out = pd.concat([out, responses(outcomes, twins)], axis=1)
    out["verdict"] = schema.verdict(out, config.outcomes.cue, f"jump_{config.outcomes.jump}")
    return out


def responses(outcomes: pd.DataFrame, twins: pd.DataFrame) -> pd.DataFrame:
    """Columns response, response_cause and response_ms.

    Checks trip on fault-free motion too: a command is clipped, the first packet of a stream lost. Only what the fault
    changed counts: a check that tripped more often than in the fault-free twin.
    """
    rows = len(outcomes)
    response, cause = np.full(rows, "none", dtype=object), np.full(rows, "", dtype=object)
    first = np.full(rows, -1, dtype=np.int32)
    onset = outcomes["first_active_ms"].to_numpy()
    for name in checks(list(outcomes.columns)):
        kind = "stopped" if name in STOPS else "flagged"
        more = outcomes[f"check_{name}_count"].to_numpy() > twins[f"check_{name}_count"].to_numpy()
        tick = outcomes[f"check_{name}_first_ms"].to_numpy()
        # Where the twin trips as well, the first trip may precede the fault; the response then is not before its onset.
        tick = np.where(twins[f"check_{name}_count"].to_numpy() > 0, np.maximum(tick, onset), tick)
        outranks = (response == "none") | ((kind == "stopped") & (response == "flagged"))
        earlier = (response == kind) & (tick < first)
        entered = more & (outranks | earlier)
        response[entered], cause[entered], first[entered] = kind, STOPS.get(name, name), tick[entered]
    return pd.DataFrame({"response": response, "response_cause": cause, "response_ms": first})
