"""What the report says about each run, derived by plain pandas: the oracle of `ravenjax.report.facts`."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ravenjax.report import layers
from ravenjax.report.facts import ACTION, EVADED, HARM_MM


def derive(
    frame: pd.DataFrame, cue: int = 0, threshold_mm: float = HARM_MM, jump: str = "jump_code", action: int = 0
) -> pd.DataFrame:
    """As `facts.derive`; `cue` is the haptic set of the verdicts, `threshold_mm` its own,
    `jump` the column of the jump rule, `action` what the operator does at a cue where the run's parameters do not say.

    Columns: run_id, group, faulty, activated, failed, response, haptic, jump (from the verdict), moved (the true tip
    left the nominal model by more than the threshold, which encoders need not see), outcome (of OUTCOMES), evaded,
    distinct (equal for runs that differ in seed or in crossed parameters alone), action (of ACTIONS, by number), plain
    (nobody reacts, or everybody does; so that one fault is not counted once for each action), sample (the first valid
    plain run of each distinct input: what intervals and tests take as one draw), site, layer and block (site and
    effect) of the first fault, onset_ms, length_ms, magnitude (of the first fault), active_ms, cue_ms, response_ms,
    warned_ms (the cue, where the fault-free twin had none by then), moved_ms (more than HARM_MM off, and the twin not),
    harm_ms (see HARM); times are -1 where never. harm is whether it came.
    """
    words = {
        verdict: tuple(verdict.split("/")) if verdict else ("", "", "")
        for verdict in frame["verdict"].unique().tolist()
    }
    response, haptic, jumped = np.array([words[v] for v in frame["verdict"]], object).reshape(-1, 3).T
    facts = pd.DataFrame(
        {
            "run_id": frame["run_id"],
            "group": frame["group"].astype("category"),
            "faulty": _faulty(frame),
            "activated": frame["activated"].astype(bool),
            "failed": (frame["failed"] != "").to_numpy(),
            "response": response,
            "haptic": haptic == "haptic",
            "jump": jumped == "jump",
            "moved": (frame["peak_model_deviation_mm"] > threshold_mm).to_numpy(),
            "active_ms": frame["first_active_ms"],
            "cue_ms": frame[f"cue{cue}_first_ms"],
            "response_ms": frame["response_ms"],
            "warned_ms": warned(frame, cue),
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
    facts["moved_ms"] = np.where(
        facts["failed"], -1, own(frame["moved_first_ms"].to_numpy(), frame["twin_moved_first_ms"].to_numpy())
    )
    jumped_ms = np.where(frame[jump] & ~facts["failed"], frame[f"{jump}_first_ms"], -1)
    facts["harm_ms"] = first_of(facts["moved_ms"].to_numpy(), jumped_ms)
    facts["harm"] = facts["harm_ms"] >= 0
    facts["distinct"] = _distinct(frame)
    facts["action"] = frame[ACTION].fillna(action).astype(int) if ACTION in frame else action
    facts["plain"] = (facts["action"] == 0) | ~(facts["action"] == 0).any()
    chosen = facts.loc[facts["plain"] & ~facts["failed"], "distinct"]
    facts["sample"] = False
    facts.loc[chosen.index[~chosen.duplicated()], "sample"] = True
    facts["site"] = frame["fault0_site"].astype(str) if "fault0_site" in frame else ""
    facts["layer"] = facts["site"].map(layers.name)
    if "fault0_site" in frame:
        facts["block"] = facts["site"] + " · " + frame["fault0_effect"].astype(str)
        facts["onset_ms"] = frame["fault0_start_ms"]
        facts["length_ms"] = frame["fault0_duration_ms"]
        facts["magnitude"] = frame["fault0_value"]
    return facts


def own(first_ms: np.ndarray, twin_ms: np.ndarray) -> np.ndarray:
    """Time [n] of what came first in each run, -1 where it never came or the fault-free twin had it by then, too."""
    return np.where((first_ms >= 0) & ~((twin_ms >= 0) & (twin_ms <= first_ms)), first_ms, -1)


def first_of(*times_ms: np.ndarray) -> np.ndarray:
    """The earliest of several times [n] of each run; -1 stands for never, of each and of the result."""
    came = [np.where(time < 0, np.inf, time) for time in times_ms]
    earliest = np.min(came, axis=0)
    return np.where(np.isinf(earliest), -1, earliest).astype(int)


def warned(frame: pd.DataFrame, cue: int) -> np.ndarray:
    """When each run's cue of this number came and its twin's had not, -1 if never: a cue that the twin has too tells
    of the motion and not of the fault."""
    return own(frame[f"cue{cue}_first_ms"].to_numpy(), frame[f"twin_cue{cue}_first_ms"].to_numpy())


def _faulty(frame: pd.DataFrame) -> np.ndarray:
    sites = [name for name in frame if name.startswith("fault") and name.endswith("_site")]
    return np.any([frame[name] != "" for name in sites], axis=0) if sites else np.zeros(len(frame), bool)


def _distinct(frame: pd.DataFrame) -> np.ndarray:
    """Number of the run's input among the campaign's inputs, random numbers and crossed parameters apart."""
    inputs = [n for n in frame if n == "operator" or n.startswith("param:") or n.startswith("fault")]
    number = frame[inputs].groupby(inputs, observed=True, dropna=False, sort=False).ngroup()
    return number.groupby(frame["pair"]).transform("min").to_numpy()
