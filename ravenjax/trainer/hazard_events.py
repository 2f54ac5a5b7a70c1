"""Hazards of a session that was cut short, put together from what its recording tells: there is no hazards.csv then."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.trainer.hazard_table import Hazard
from ravenjax.trainer.recording import Recording

_PEAKS = {"peak_error_mm": "error_mm", "peak_stray_mm": "stray_mm", "deepest_mm": "depth_mm"}


def from_recording(recording: Recording, header: Mapping[str, Any]) -> list[Hazard]:
    """A row for each hazard that was armed, as far as events and curves tell; in order of arming.

    Outcome and score are empty where the hazard was still at work when the recording broke off. Sizes are the greatest
    of any arm from the strike until the hazard was over.
    """
    known = {int(one["number"]): one for one in header.get("hazards") or [] if "number" in one}
    found: list[dict[str, Any]] = []
    for event in recording.events:
        if event["kind"] == "hazard_armed":
            found.append(_armed(event, known.get(int(event["number"]), {}), header))
        elif found:
            _take(found[-1], event)
    for row in found:
        _measure(row, recording)
        del row["over_ms"]
    return [Hazard(**row) for row in found]


def _armed(event: Mapping[str, Any], listed: Mapping[str, Any], header: Mapping[str, Any]) -> dict[str, Any]:
    scenario = header.get("scenario")
    times = ("struck_ms", "knowable_ms", "cue_ms", "alarm_ms", "response_ms", "reaction_ms", "over_ms")
    return {
        "session": str(header.get("name", "")),
        "participant": str(header.get("participant", "")),
        "group": str(header.get("group", "")),
        "scenario": str(scenario.get("name", "") if isinstance(scenario, dict) else scenario or ""),
        "seed": str(header.get("seed", "")),
        "cue": "on" if header.get("cue") else "off",
        "blinded": bool(header.get("blinded")),
        "number": int(event["number"]),
        "hazard": str(listed.get("hazard", "")),
        "title": str(listed.get("title", "")),
        "arm": "",
        "armed_ms": float(event["tick"]),
        "right_response": " ".join(listed.get("right_response", [])),
        "stopped": False,
        "response_ok": False,
        **dict.fromkeys(times),
        **dict.fromkeys(("knowable_by", "alarm", "response", "outcome"), ""),
        **dict.fromkeys((*_PEAKS, "score")),
    }


def _take(row: dict[str, Any], event: Mapping[str, Any]) -> None:
    """What one event tells of the hazard at work."""
    kind, tick = event["kind"], float(event.get("tick", 0))
    if row["over_ms"] is not None:
        return
    if kind == "hazard_struck":
        row["struck_ms"] = tick
    elif row["struck_ms"] is None:
        return
    elif kind == "knowable":
        row |= {"knowable_ms": tick, "knowable_by": str(event.get("by", ""))}
    elif kind == "cue" and event.get("felt", True) and row["cue_ms"] is None:
        row["cue_ms"] = tick
    elif kind == "alarm" and row["alarm_ms"] is None:
        row |= {"alarm_ms": tick, "alarm": str(event.get("check", ""))}
    elif kind == "stray" and not row["arm"]:
        row["arm"] = str(event.get("arm", ""))
    elif kind == "response" and not row["response_ok"]:
        row |= {"response": str(event.get("what", "")), "response_ms": tick, "response_ok": bool(event.get("ok"))}
        row["reaction_ms"] = None if event.get("ms") is None else float(event["ms"])
    elif kind == "runlevel" and event.get("runlevel") == 0 and row["response_ms"] is None:
        row["stopped"] = True
    elif kind == "hazard_over":
        row |= {"over_ms": tick, "outcome": str(event.get("outcome", "")), "score": event.get("score")}


def _measure(row: dict[str, Any], recording: Recording) -> None:
    if row["struck_ms"] is None:
        return
    time = recording["session_tick"]
    end = np.inf if row["over_ms"] is None else row["over_ms"]
    inside = (time >= row["struck_ms"]) & (time <= end)
    if inside.any():
        for name, channel in _PEAKS.items():
            values = np.stack([recording[f"{arm}/{channel}"][inside] for arm in recording.layout.arms])
            peak = float(np.nanmax(values))
            row[name] = round(peak, 4) if np.isfinite(peak) else None
