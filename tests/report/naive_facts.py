"""What the report says about each run, in plain pandas from the raw columns:
the oracle of `ravenjax.report.data.facts`.

It takes nothing from the package: the definitions of `ravenjax.outcomes` are written out once more,
from first detections, counts of milliseconds and golden runs, and neither the column `hazard` nor
`verdict` is read.
"""

import numpy as np
import pandas as pd

LAYERS = {
    "console": ("hand", "console"),
    "network": ("network",),
    "packets": ("packet", "packet_header"),
    "process model": ("pos_d", "ori_d", "jpos_d", "mpos_d"),
    "estimation": ("runlevel", "mpos", "mvel", "jpos", "jvel", "pos", "ori"),
    "control output": ("tau_d", "current_cmd"),
    "USB in": ("encoder", "usb_in", "usb_status"),
    "USB out, motors": ("usb_out", "torque_scale", "brake"),
    "PLC link": ("pins_out", "plc", "buttons"),
    "mechanics": ("cable_scale", "friction_scale", "external_torque"),
}


def derive(
    frame: pd.DataFrame, cue: int = 0, jump: str = "jump_code", action: int = 0
) -> pd.DataFrame:
    """One row per run, the columns of `facts.define_facts`. cue: number of the haptic set of the
    verdicts; jump: column of the jump rule; action: what the operator does at a cue where the run's
    parameters do not say."""
    facts = pd.DataFrame(index=frame.index)
    facts["run_id"] = frame["run_id"]
    facts["group"] = frame["group"].astype("category")
    facts["faulty"] = faulty(frame)
    facts["activated"] = frame["activated"].astype(bool)
    facts["failed"] = frame["failed"].astype(str) != ""
    valid = ~facts["failed"]
    response = frame["response"].astype(str)
    facts["response"] = response.where(valid, "")
    facts["told"] = valid & response.isin(["stopped", "flagged"])
    facts["hazard"] = hazard(frame).where(valid, "")
    for name, word in (
        ("unintended", "unintended motion"),
        ("loss", "loss of motion"),
        ("misreport", "false report"),
    ):
        facts[name] = facts["hazard"] == word
    facts["halted"] = facts["loss"] & (frame["loss_first_ms"] < 0)
    facts["evaded"] = facts["unintended"] & ~facts["told"]
    facts["active_ms"] = frame["first_active_ms"]
    facts["response_ms"] = frame["response_ms"]
    facts["told_ms"] = frame["told_ms"]
    facts["cue_ms"] = frame[f"cue{cue}_first_ms"]
    facts["warned_ms"] = warned(frame, cue)
    facts["cued"] = valid & (facts["warned_ms"] >= 0)
    facts["jump"] = valid & frame[jump].astype(bool)
    facts["unintended_ms"] = frame["unintended_first_ms"].where(facts["unintended"], -1)
    facts["loss_ms"] = frame["loss_first_ms"].where(facts["loss"], -1)
    facts["misreport_ms"] = frame["false_report_first_ms"].where(facts["misreport"], -1)
    facts["outcome"] = [outcome(row) for row in facts.to_dict("records")]
    own = (
        frame["param:reaction.action"]
        if "param:reaction.action" in frame
        else pd.Series(np.nan, frame.index)
    )
    facts["action"] = own.fillna(action).astype(int)
    facts["plain"] = (facts["action"] == 0) | ~(facts["action"] == 0).any()
    facts["distinct"] = distinct(frame)
    able = facts["plain"] & valid
    acted = able & (facts["activated"] | ~facts["faulty"])
    facts["sample"] = acted & ~facts["distinct"].where(acted).duplicated()
    facts["site"] = frame["fault0_site"].astype(str) if "fault0_site" in frame else ""
    facts["layer"] = [
        next((layer for layer, sites in LAYERS.items() if s in sites), "other")
        for s in facts["site"]
    ]
    if "fault0_site" in frame:
        facts["block"] = facts["site"] + " · " + frame["fault0_effect"].astype(str)
        facts["onset_ms"] = frame["fault0_start_ms"]
        facts["length_ms"] = frame["fault0_duration_ms"]
        facts["magnitude"] = frame["fault0_value"]
    return facts


def hazard(frame: pd.DataFrame) -> pd.Series:
    """The gravest hazard of each run, whether it is valid or not."""
    found = []
    for row in frame.to_dict("records"):
        stood = row["halted_ms"] > row["golden_halted_ms"] + 200
        if row["unintended_first_ms"] >= 0:
            found.append("unintended motion")
        elif row["loss_first_ms"] >= 0 or (stood and row["response"] != "stopped"):
            found.append("loss of motion")
        elif row["false_report_first_ms"] >= 0:
            found.append("false report")
        else:
            found.append("none")
    return pd.Series(found, frame.index, dtype=object)


def outcome(row: dict) -> str:
    """The one outcome of a run under which the groups show it."""
    if row["failed"]:
        return "failed"
    if row["told"]:
        return row["response"]
    if row["hazard"] == "unintended motion":
        return "felt" if row["cued"] else "unseen"
    if row["hazard"] == "loss of motion":
        return "lost"
    if row["hazard"] == "false report":
        return "misreported"
    if row["cued"]:
        return "phantom"
    return "limited" if row["response"] == "limited" else "quiet"


def warned(frame: pd.DataFrame, cue: int) -> pd.Series:
    """When each run's cue of this number came and its golden run had none by then, -1 if never."""
    pairs = zip(
        frame[f"cue{cue}_first_ms"].tolist(),
        frame[f"golden_cue{cue}_first_ms"].tolist(),
        strict=True,
    )
    return pd.Series(
        [own if own >= 0 and not 0 <= golden <= own else -1 for own, golden in pairs],
        frame.index,
        int,
    )


def faulty(frame: pd.DataFrame) -> pd.Series:
    """Whether a run has a fault in any slot."""
    sites = [name for name in frame if name.startswith("fault") and name.endswith("_site")]
    return (frame[sites].astype(str) != "").any(axis=1)


def distinct(frame: pd.DataFrame) -> pd.Series:
    """Number of the run's input among the campaign's inputs, random numbers and crossed
    parameters apart, but for faults that draw numbers in each tick.
    """
    inputs = [name for name in frame if name == "operator" or name.startswith(("param:", "fault"))]
    effects = frame.filter(regex=r"^fault\d+_effect$")
    draws = effects.isin(["random", "lose"]).any(axis=1)
    copy = frame.groupby(inputs, observed=True, dropna=False).cumcount()
    table = frame[inputs].assign(copy=copy.where(draws, 0))
    number = table.groupby([*inputs, "copy"], observed=True, dropna=False, sort=False).ngroup()
    return number.groupby(frame["pair"]).transform("min")


def motions(frame: pd.DataFrame, chosen: pd.Series | None = None) -> pd.DataFrame:
    """The different golden runs: one row for each operator and outcome of a golden run."""
    return (
        (frame if chosen is None else frame[chosen])
        .filter(regex=r"^(operator$|golden_)")
        .drop_duplicates()
    )
