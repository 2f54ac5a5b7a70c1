"""Hazards of a session that was cut short, reconstructed from its recording: there is no
hazards.csv then.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.outcomes import verdict
from ravenjax.train.judge.episode import DISTANCES, motion_hazard
from ravenjax.train.judge.row import HazardRow
from ravenjax.train.recording.hazards.table import NUMBERS
from ravenjax.train.recording.reader import Recording


def from_recording(recording: Recording, header: Mapping[str, Any]) -> list[HazardRow]:
    """A row for each hazard that was armed, as far as events and curves tell; in order of arming.

    Outcome and score are empty where the hazard was still at work when the recording broke off.
    Distances are the largest of any arm from the strike until the hazard was over.
    """
    listed = {int(one["number"]): one for one in header.get("hazards") or [] if "number" in one}
    rows: list[dict[str, Any]] = []
    for event in recording.events:
        if event["kind"] == "hazard_armed":
            rows.append(_armed(event, listed.get(int(event["number"]), {}), header))
        elif rows:
            _take(rows[-1], event)
    for row in rows:
        _measure(row, recording)
        del row["over_ms"]
    return [HazardRow(**row) for row in rows]


def _armed(
    event: Mapping[str, Any], listed: Mapping[str, Any], header: Mapping[str, Any]
) -> dict[str, Any]:
    scenario = header.get("scenario")
    table = scenario if isinstance(scenario, dict) else {}
    return dict.fromkeys((*NUMBERS, "over_ms")) | {
        "session": str(header.get("name", "")),
        "participant": str(header.get("participant", "")),
        "group": str(header.get("group", "")),
        "scenario": str(table.get("name", "") if table else scenario or ""),
        "seed": str(header.get("seed", "")),
        "cue": "on" if header.get("cue") else "off",
        "blinded": bool(header.get("blinded")),
        "number": int(event["number"]),
        "hazard": str(listed.get("hazard", "")),
        "title": str(listed.get("title", "")),
        "arm": "",
        "armed_ms": float(event["tick"]),
        "limit_mm": (table.get("harm") or {}).get("excursion_mm"),
        "right_response": " ".join(listed.get("right_response", [])),
        "halted": False,
        "response_ok": False,
        **dict.fromkeys(("knowable_by", "alarm", "limited", "response", "outcome"), ""),
        **dict.fromkeys(("check_response", "check_cause", "motion_hazard"), ""),
    }


def _take(row: dict[str, Any], event: Mapping[str, Any]) -> None:
    """What one event says of the hazard at work."""
    kind, tick = event["kind"], float(event.get("tick", 0))
    if row["over_ms"] is not None:
        return
    if kind == "hazard_struck":
        row |= {"struck_ms": tick, "check_response": "silent"}
    elif row["struck_ms"] is None:
        return
    elif kind == "knowable":
        row |= {
            "knowable_ms": float(event.get("ms", tick)),
            "knowable_by": str(event.get("by", "")),
        }
    elif kind == "cue" and event.get("number", -1) >= 0 and row["cue_ms"] is None:
        row["cue_ms"] = tick
    elif kind in verdict.RESPONSES:
        _respond(row, kind, float(event.get("ms", tick)), str(event.get("check", "")))
    elif kind == "unintended_motion" and not row["arm"]:
        row["arm"] = str(event.get("arm", ""))
    elif kind == "response" and not row["response_ok"]:
        row |= {
            "response": str(event.get("what", "")),
            "response_ms": tick,
            "response_ok": bool(event.get("ok")),
        }
        row["reaction_ms"] = None if event.get("ms") is None else float(event["ms"])
    elif kind == "hazard_over":
        words = {name: event[name] for name in ("motion_hazard", "halted") if name in event}
        row |= {
            "over_ms": tick,
            "outcome": str(event.get("outcome", "")),
            "score": event.get("score"),
        } | words


def _respond(row: dict[str, Any], response: str, ms: float, check: str) -> None:
    """The first check of a kind of response."""
    words = verdict.RESPONSES
    if words.index(response) < words.index(row["check_response"]):
        row |= {"check_response": response, "check_cause": check}
    column = "alarm" if response in verdict.TOLD else "limited"
    before = row[f"{column}_ms"]
    if before is None or ms < before or (ms == before and response == "stopped"):
        row |= {f"{column}_ms": ms, column: check}


def _measure(row: dict[str, Any], recording: Recording) -> None:
    if row["struck_ms"] is None:
        return
    time = recording["session_tick"]
    end = np.inf if row["over_ms"] is None else row["over_ms"]
    inside = (time >= row["struck_ms"]) & (time <= end)
    if not inside.any():
        return
    live = recording["live"][inside] != 0
    limit, first_ms = row["limit_mm"], {}
    for name in (*DISTANCES, "unintended_off"):
        values = _worst(recording, f"{name}_mm", inside)
        row[f"{name}_mm"] = _rounded(values)
        if name in DISTANCES and limit is not None and (over := values > limit).any():
            row[f"{name}_first_ms"] = first_ms[name] = float(time[inside][over][0])
    for name, channel in {"peak_error_mm": "error_mm", "deepest_mm": "depth_mm"}.items():
        row[name] = _rounded(_worst(recording, channel, inside)[live])
    before = np.flatnonzero(time < row["struck_ms"])[-1:]
    for name, channel in {"halted_ms": "halted_ms", "golden_halted_ms": "golden_halted_ms"}.items():
        values = recording[channel]
        row[name] = float(values[inside][-1] - (values[before][0] if len(before) else 0.0))
    if row["over_ms"] is None:
        follows = (recording["live"] != 0) & (recording["pedal"] != 0)
        pressed = np.logical_and.accumulate(recording["pedal"][inside] != 0)
        by_itself = (
            pressed & ~live
            if row["response"] != "stop"
            else pressed & ~live & (time[inside] < row["response_ms"])
        )
        row["halted"] = bool(follows[before].any() and by_itself.any())
        if limit is not None:
            stopped = row["check_response"] == "stopped"
            row["motion_hazard"] = motion_hazard(
                first_ms, row["halted_ms"], row["golden_halted_ms"], stopped
            )


def _worst(recording: Recording, channel: str, inside: np.ndarray) -> np.ndarray:
    """Of the arms, over time; NaN where no arm has a number."""
    return np.fmax.reduce([recording[f"{arm}/{channel}"][inside] for arm in recording.layout.arms])


def _rounded(values: np.ndarray) -> float | None:
    peak = np.fmax.reduce(values) if len(values) else np.nan
    return round(float(peak), 4) if np.isfinite(peak) else None
