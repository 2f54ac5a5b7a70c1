"""What the report says about each run, derived once from the result table."""

from __future__ import annotations

import numpy as np
import pandas as pd

OUTCOMES = {
    "stopped": "a built-in check stopped the robot",
    "flagged": "a built-in check responded without a stop",
    "felt": "no check; the instrument left the model, the cue fired",
    "unseen": "no check; the instrument left the model, no cue fired",
    "phantom": "no check; the instrument stayed near, the cue fired all the same",
    "jumped": "no check, no cue; the reported tip jumped, the instrument stayed near",
    "quiet": "no check, no cue, no jump; the instrument stayed near",
    "failed": "the run gave no valid outcome",
}
"""Each run has exactly one; "felt" and "unseen" evaded the checks and moved the instrument off the model by more than
the cue's threshold."""

EVADED = ("felt", "unseen")


def derive(frame: pd.DataFrame, cue: int = 0, threshold_mm: float = 3.0) -> pd.DataFrame:
    """One row per run, the index of `frame` kept; `cue` is the haptic set of the verdicts, `threshold_mm` its own.

    Columns: run_id, group, faulty, activated, failed, response, haptic, jump (from the verdict), moved (the true tip
    left the nominal model by more than the threshold, which encoders need not see), outcome (of OUTCOMES), evaded,
    distinct (equal for runs that differ in seed alone), block (site and effect of the first fault), onset_ms,
    length_ms, magnitude (of the first fault), active_ms, cue_ms, response_ms (-1 where never).
    """
    words = {
        verdict: tuple(verdict.split("/")) if verdict else ("", "", "")
        for verdict in frame["verdict"].unique().tolist()
    }
    response, haptic, jump = np.array([words[v] for v in frame["verdict"]], object).reshape(-1, 3).T
    facts = pd.DataFrame(
        {
            "run_id": frame["run_id"],
            "group": frame["group"].astype("category"),
            "faulty": _faulty(frame),
            "activated": frame["activated"].astype(bool),
            "failed": (frame["failed"] != "").to_numpy(),
            "response": response,
            "haptic": haptic == "haptic",
            "jump": jump == "jump",
            "moved": (frame["peak_model_deviation_mm"] > threshold_mm).to_numpy(),
            "active_ms": frame["first_active_ms"],
            "cue_ms": frame[f"cue{cue}_first_ms"],
            "response_ms": frame["response_ms"],
        },
        index=frame.index,
    )
    silent = facts["response"] == "silent"
    facts["outcome"] = np.select(
        [
            facts["failed"],
            ~silent,
            facts["haptic"] & facts["moved"],
            facts["moved"],
            facts["haptic"],
            facts["jump"],
        ],
        ["failed", facts["response"], "felt", "unseen", "phantom", "jumped"],
        "quiet",
    )
    facts["evaded"] = facts["outcome"].isin(EVADED)
    facts["distinct"] = _distinct(frame)
    if "fault0_site" in frame:
        facts["block"] = frame["fault0_site"].astype(str) + " · " + frame["fault0_effect"].astype(str)
        facts["onset_ms"] = frame["fault0_start_ms"]
        facts["length_ms"] = frame["fault0_duration_ms"]
        facts["magnitude"] = frame["fault0_value"]
    return facts


def _faulty(frame: pd.DataFrame) -> np.ndarray:
    sites = [name for name in frame if name.startswith("fault") and name.endswith("_site")]
    return np.any([frame[name] != "" for name in sites], axis=0) if sites else np.zeros(len(frame), bool)


def _distinct(frame: pd.DataFrame) -> np.ndarray:
    """Number of the run's input among the campaign's inputs, random numbers apart."""
    inputs = [n for n in frame if n == "operator" or n.startswith("param:") or n.startswith("fault")]
    return frame[inputs].groupby(inputs, observed=True, dropna=False, sort=False).ngroup().to_numpy()
