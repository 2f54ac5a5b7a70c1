"""From what an engine returns to rows of the result table: names, types, response and verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import run_id
from ravenjax.campaign.config import CampaignConfig
from ravenjax.campaign.table import SHARED
from ravenjax.store import schema, words

STOPS: dict[str, str] = {
    "overdrive_instant": "overdrive",
    "overdrive_hard": "hard_counter",
    "soft_estop": "soft_estop",
    "plc_watchdog": "watchdog",
    "estop": "plc",
}
"""Checks that stop the robot and the name of each as a cause, earliest in the loop first."""


RESPONSES = ("none", "flagged", "stopped")
"""Words of the column response."""

Columns = Mapping[str, np.ndarray]
"""Outcome -> [rows], as an engine returns them; a DataFrame will do."""


def checks(names: Iterable[str]) -> tuple[str, ...]:
    """Names of the checks among outcome columns."""
    return tuple(n.removeprefix("check_").removesuffix("_count") for n in counts(names))


def counts(names: Iterable[str]) -> tuple[str, ...]:
    """Those outcome columns that say how often a check tripped."""
    return tuple(n for n in names if n.startswith("check_") and n.endswith("_count"))


def of_twin(names: Iterable[str]) -> tuple[str, ...]:
    """Those outcome columns of which the fault-free twin's are needed, too: trips of checks, and what is kept of it."""
    names = tuple(names)
    return counts(names) + tuple(name for name in names if schema.kept_of_twin(name))


def columns(config: CampaignConfig, runs: pd.DataFrame, outcomes: Columns, twins: Columns) -> dict[str, Any]:
    """Columns of the result table, arrays [rows].

    runs: rows of the fault table. outcomes: what the engine returned for each; twins: `of_twin` of its fault-free twin.
    """
    found = {name: np.asarray(values) for name, values in outcomes.items()}
    diverged, failed = found.pop("diverged_ms"), found.pop("failed_ms")
    jumps = {rule: found.pop(f"jump_{rule}_ms") for rule in ("code", "text", "tip")}
    depth, distance = found["tissue_depth_mm"], found["tip_distance_mm"]
    out: dict[str, Any] = {
        **{name: runs[name].array for name in runs.columns if name != SHARED},
        "run_id": run_id.text(runs["run_id"].to_numpy()),
        **found,
        "activated": found["active_ticks"] > 0,
        "diverged": _faulty(runs) & (diverged >= 0),
        **{f"jump_{rule}": first >= 0 for rule, first in jumps.items()},
        **{f"jump_{rule}_first_ms": first for rule, first in jumps.items()},
        "failed": words.column((failed >= 0).astype(np.int8), ("", "nan")),
        "tissue_depth_mm": np.maximum(depth, depth.dtype.type(0)),
        "tip_distance_mm": np.where(np.isfinite(distance), distance, distance.dtype.type(np.nan)),
        **{f"twin_{name}": np.asarray(twins[name]) for name in found if schema.kept_of_twin(name)},
        **responses(found, twins),
    }
    out["twin_tissue_depth_mm"] = np.maximum(out["twin_tissue_depth_mm"], depth.dtype.type(0))
    out["verdict"] = schema.verdicts(out, config.outcomes.cue, f"jump_{config.outcomes.jump}")
    return out


def frame(config: CampaignConfig, runs: pd.DataFrame, outcomes: Columns, twins: Columns) -> pd.DataFrame:
    """`columns` as a DataFrame."""
    return pd.DataFrame(columns(config, runs, outcomes, twins))


def _faulty(runs: pd.DataFrame) -> np.ndarray:
    """Which rows have a fault, bool [rows]."""
    sites = runs.columns[runs.columns.str.fullmatch(r"fault\d+_site")]
    return np.any([np.zeros(len(runs), bool), *((runs[name] != "").to_numpy() for name in sites)], axis=0)


def responses(outcomes: Columns, twins: Columns) -> dict[str, np.ndarray | pd.Categorical]:
    """Columns response, response_cause and response_ms.

    Checks trip on fault-free motion too: a command is clipped, the first packet of a stream lost. Only what the fault
    changed counts: a check that tripped more often than in the fault-free twin.
    """
    onset = outcomes["first_active_ms"]
    names = checks(outcomes)
    causes = ("", *(STOPS.get(name, name) for name in names))
    response, cause = np.zeros((2, len(onset)), np.int8)
    first = np.full(len(onset), -1, np.int32)
    for place, name in enumerate(names, start=1):
        kind = RESPONSES.index("stopped" if name in STOPS else "flagged")
        tick, of_twin = outcomes[f"check_{name}_first_ms"], np.asarray(twins[f"check_{name}_count"])
        more = outcomes[f"check_{name}_count"] > of_twin
        if not more.any():
            continue
        # Where the twin trips as well, the first trip may precede the fault; the response then is not before its onset.
        tick = np.where(of_twin > 0, np.maximum(tick, onset), tick)
        entered = more & ((response < kind) | ((response == kind) & (tick < first)))
        response[entered], cause[entered], first[entered] = kind, place, tick[entered]
    return {
        "response": words.column(response, RESPONSES),
        "response_cause": words.column(cause, causes),
        "response_ms": first,
    }
