"""Converts the output of an engine to rows of the result table: names, types, response, verdict."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign.faults import run_id
from ravenjax.campaign.faults.table import SHARED, count_slots
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.outcomes import verdict
from ravenjax.store import schema
from ravenjax.vocabulary import checks, failures

_GOLDEN_ONLY = re.compile(r"detector\d+_threshold0_(first_ms|alarms)|harm_\w+_first_ms")
"""Columns of alarms at the first threshold of a detector, at which it may stop the robot, and of
harms that the campaign defines. The result table has no columns of these for golden runs.
"""

Columns = Mapping[str, np.ndarray]
"""Outcome -> array [rows], as an engine returns them. A DataFrame is accepted, too."""

MAY_BE_INFINITE = (*schema.MAY_BE_INFINITE, "tissue_depth_mm", "tip_distance_mm")
"""Endings of outcome names that an engine returns as infinite if nothing was measured."""
OVERLOAD = "cable_overload"
"""Column of the first cable that was overloaded."""


def select_golden_outcomes(shape: schema.Shape, outcomes: Columns) -> dict[str, np.ndarray]:
    """Return the outcomes of golden runs that the rows of their faulty runs need."""
    stored = schema.golden_outcomes(shape)
    return {
        name: values
        for name, values in outcomes.items()
        if name in stored or _GOLDEN_ONLY.fullmatch(name)
    }


def result_columns(
    config: CampaignConfig, runs: pd.DataFrame, outcomes: Columns, golden_runs: Columns
) -> dict[str, Any]:
    """Return the columns of the result table, arrays [rows]. runs: rows of the fault table.
    outcomes: the engine's outcomes. golden_runs: `select_golden_outcomes` of the golden runs.
    """
    measures: dict[str, Any] = {name: np.asarray(values) for name, values in outcomes.items()}
    diverged_ms = measures.pop("diverged_ms")
    failed_signal, failed_ms = _find_failures(config, measures)
    sites: list[Any] = [runs[f"fault{slot}_site"].array for slot in range(count_slots(runs))]
    jumps_ms = {rule: measures.pop(f"jump_{rule}_ms") for rule in ("code", "text", "tip")}
    measures.setdefault("restart_ms", np.full(len(runs), -1, np.int32))
    if OVERLOAD in measures:
        # The engine returns -1 for no cable, which is the first word.
        cable_numbers = measures[OVERLOAD].astype(np.int32) + 1
        measures[OVERLOAD] = schema.word_column(cable_numbers, cable_names(config))
    depth, distance = measures["tissue_depth_mm"], measures["tip_distance_mm"]
    out: dict[str, Any] = {
        **{
            str(name): values.array if values.dtype == "category" else values.to_numpy()
            for name, values in runs.items()
            if name != SHARED
        },
        "run_id": run_id.format_run_ids(runs["run_id"].to_numpy()),
        **measures,
        "activated": measures["active_ticks"] > 0,
        "diverged": np.any([site != "" for site in sites], axis=0) & (diverged_ms >= 0),
        **{f"jump_{rule}": first_ms >= 0 for rule, first_ms in jumps_ms.items()},
        **{f"jump_{rule}_first_ms": first_ms for rule, first_ms in jumps_ms.items()},
        "failed": schema.word_column(failed_signal + 1, failures.CAUSES),
        "failed_first_ms": failed_ms,
        "tissue_depth_mm": np.maximum(depth, 0),
        "tip_distance_mm": np.where(np.isfinite(distance), distance, np.nan),
        **{
            f"golden_{name}": np.asarray(values)
            for name, values in golden_runs.items()
            if not _GOLDEN_ONLY.fullmatch(name)
        },
    }
    out["golden_tissue_depth_mm"] = np.maximum(out["golden_tissue_depth_mm"], 0)
    if checks.needs_own_columns(config.own_checks, config.stops):
        detectors = [number for number, (_, use, _) in enumerate(config.detectors) if use.stops]
        built_in = verdict.built_in_responses(measures, golden_runs, config.robot, detectors)
        out[checks.BUILT_IN] = schema.word_column(built_in.response, verdict.RESPONSES)
        out["built_in_told_ms"] = built_in.told_ms
    response = verdict.classify_responses(measures, golden_runs, config.robot)
    stopped = response.response == verdict.RESPONSES.index("stopped")
    hazard = verdict.classify_hazards(out, stopped)
    cue_column = f"cue{config.outcomes.cue}_first_ms"
    has_cue = verdict.beyond_golden(out[cue_column], out[f"golden_{cue_column}"]) >= 0
    verdicts = verdict.classify_verdicts(response.response, hazard, has_cue, failed_ms < 0)
    return out | {
        "response": schema.word_column(response.response, verdict.RESPONSES),
        "response_cause": schema.word_column(response.cause, response.causes),
        "response_ms": response.ms,
        "told_ms": response.told_ms,
        "hazard": schema.word_column(hazard, verdict.HAZARDS),
        "verdict": schema.word_column(verdicts, (*verdict.VERDICTS, "")),
    }


def _find_failures(
    config: CampaignConfig, measures: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    # Returns for each run which signal first became infinite or NaN (code of `failures.CODES`), and
    # when, in ms. Both are -1 if all numbers are finite. The engine's columns of these two are
    # removed from `measures`. Outcomes that only this robot has are not checked in each tick. If
    # one of these is infinite or NaN, the run fails at its end.
    failed_ms = measures.pop("failed_ms")
    # A robot without the column `failed_signal` checks only the tip.
    signal = measures.pop("failed_signal", np.where(failed_ms >= 0, failures.CODES["tip"], -1))
    invalid = np.zeros(len(failed_ms), bool)
    for name, values in measures.items():
        if values.dtype.kind == "f":
            invalid |= np.isnan(values) if name.endswith(MAY_BE_INFINITE) else ~np.isfinite(values)
    fails_at_end = invalid & (failed_ms < 0)
    end_ms = config.campaign.duration_ms
    signal = np.where(fails_at_end, failures.CODES["outcome"], signal).astype(np.int8)
    return signal, np.where(fails_at_end, end_ms, failed_ms).astype(np.int32)


def cable_names(config: CampaignConfig) -> tuple[str, ...]:
    """Return the words of column `cable_overload`: "" for no cable, then the name of each cable."""
    arms, joints = config.campaign.arms, config.robot.joints
    return ("", *(f"{arm} {joint}" for arm in arms for joint in joints))
