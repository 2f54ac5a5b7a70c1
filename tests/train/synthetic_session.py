"""Folders of sessions that never were: smooth motion, hazards that strike, an operator who
answers or not.
"""

import dataclasses

import numpy as np

from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.judge import COLUMNS, HazardRow
from ravenjax.train.protocol import Frame, FrameLayout
from ravenjax.train.recording.reader import as_csv

LIMIT_MM = 8.0
"""[harm] excursion_mm of these sessions."""
NAMES = {"C09": "Encoder scaled", "L7": "Cable breaks", "M2": "Packets repeat"}


def hazard(
    number=0,
    *,
    struck=2000.0,
    cue=90.0,
    response=430.0,
    known=35.0,
    alarm=None,
    off=6.5,
    ok=True,
    what="",
    **more,
):
    """A row of hazards.csv; cue, response, known, alarm in ms after the strike, None where it never
    came.

    off: unintended motion of the live robot, mm. what: the response, where it is not to lift the
    pedal.
    """
    name = list(NAMES)[number % len(NAMES)]
    first = min((one for one in (cue, alarm, known) if one is not None), default=None)
    after = {"knowable_ms": known, "cue_ms": cue, "alarm_ms": alarm, "response_ms": response}
    absolute = {
        key: None if value is None or struck is None else struck + value
        for key, value in after.items()
    }
    values = {
        **{"session": "s", "participant": "P1", "group": "cue", "scenario": "synthetic"},
        **{"seed": "7", "cue": "on", "arm": "gold"},
        **{"number": number, "hazard": name, "title": NAMES[name]},
        "armed_ms": None if struck is None else struck - 500,
        "struck_ms": struck,
        **absolute,
        "knowable_by": "tip" if known is not None else "",
        "alarm": "overdrive_hard" if alarm is not None else "",
        "check_response": "silent" if alarm is None else "stopped",
        "check_cause": "overdrive_hard" if alarm is not None else "",
        "motion_hazard": "unintended motion" if off > LIMIT_MM else "none",
        "limit_mm": LIMIT_MM,
        "unintended_mm": off,
        "unintended_first_ms": None if off <= LIMIT_MM or struck is None else struck + 200.0,
        **dict.fromkeys(("unintended_off_mm", "loss_mm", "halted_ms", "golden_halted_ms"), 0.0),
        "false_report_mm": 0.2,
        "response": what or ("release" if response is not None else ""),
        "reaction_ms": None if response is None or first is None else response - first,
        "right_response": "release",
        "response_ok": ok and response is not None,
        "peak_error_mm": off * 0.8,
        "deepest_mm": off - 5,
        "halted": alarm is not None,
        "outcome": "avoided" if ok and response is not None else "harm",
        "score": 82.0 if ok and response is not None else 10.0,
    }
    return HazardRow(**(dict.fromkeys(COLUMNS) | values | more))


def rows(layout, hazards, seconds):
    """Frames [T, size] of a session with these hazards."""
    T = int(seconds * 1000)
    time = np.arange(T)
    frame = Frame(layout, np.zeros((T, layout.size), np.float32).T)  # channel by channel
    frame["tick"] = frame["session_tick"] = time
    frame["runlevel"] = 3
    for name in ("surgeon_mode", "pedal", "phase", "live"):
        frame[name] = 1
    frame["pedal"][:, :400], frame["runlevel"][:, :400], frame["phase"][:, :400] = 0, 2, 0
    frame["live"][:, :400] = 0
    frame["progress"] = np.linspace(0, 0.8, T)
    frame["cue_on"], frame["console_alive"], frame["hazard"] = 1, 1, -1
    random = np.random.default_rng(5)
    frame["compute_us"], frame["lateness_us"] = random.gamma(9, 4, T), random.exponential(12, T)
    off = np.zeros(T)
    for one in hazards:
        if one.struck_ms is None:
            continue
        start, end = int(one.struck_ms), int(one.response_ms or one.struck_ms + 1500)
        after = np.clip((time - start) / max(1, end - start), 0, None)
        shape = np.where(after < 1, after, np.exp(-(after - 1) * 2))
        off += one.unintended_mm * shape * (time >= start)
        frame["fault_active"][:, start:end] = 1
        frame["hazard"][:, start:end] = one.number
        if one.response_ms is not None:
            frame["pedal"][:, end : end + 700], frame["runlevel"][:, end + 8 : end + 708] = 0, 2
            frame["live"][:, end + 8 : end + 708] = 0
    for i, arm in enumerate(layout.arms):
        phase = time / 700 + i
        mine = off if i == 0 else 0 * off
        path = np.stack(
            [0.02 * np.sin(phase), 0.015 * np.cos(phase), -0.1 + 0.004 * np.sin(2.3 * phase)]
        )
        frame[f"{arm}/model_tip"] = path
        frame[f"{arm}/position"] = path + 1e-3 * np.stack([0.8 * mine, 0 * mine, 0 * mine])
        frame[f"{arm}/tip"] = path + 1e-3 * np.stack([mine, 0 * mine, 0 * mine])
        frame[f"{arm}/unintended_mm"], frame[f"{arm}/known_mm"] = mine, 0.8 * mine
        frame[f"{arm}/error_mm"] = 0.8 * mine + 0.15 + 0.1 * np.sin(phase * 3)
        frame[f"{arm}/depth_mm"] = mine - 5
        frame[f"{arm}/force"] = np.stack(
            [0.4 * np.maximum(frame[f"{arm}/error_mm"][0] - 3, 0), 0 * mine, 0 * mine]
        )
    return np.ascontiguousarray(frame.row.T)


def write(folder, table, seconds=8.0, arms=("gold", "green"), recorded=True, **header):
    """A session's folder; `header` changes session.json."""
    layout = FrameLayout.of(arms)
    told = {
        "name": "synthetic",
        "scenario": {
            "name": "synthetic",
            "title": "Pegs under attack",
            "description": "Six pegs, three hazards",
            "harm": {"excursion_mm": LIMIT_MM, "depth_mm": 5.0},
        },
        **{"seed": 7, "participant": "P1", "group": "cue", "cue": True, "blinded": False},
        **{"arms": list(arms), "robot": "virtual", "cue_threshold_mm": 3.0},
        "versions": {"ravenjax": "0.1.0", "numpy": "2"},
        "started": "2026-01-02T03:04:05.000+00:00",
        "ended": "2026-01-02T03:04:13.000+00:00",
        "hazards": [],
        "task": {},
        "summary": {"recording": {"rows": int(seconds * 1000), "lost_rows": 0, "late_ticks": 3}},
    } | header
    description.write_session(folder, told)
    if recorded:
        log = session_log.SessionWriter(folder / session_log.FILE, layout.names(), told)
        data = rows(layout, table or [], seconds)
        for first in range(0, len(data), 50):
            log.add(first, data[first : first + 50])
        log.add(len(data), data[:0], [{"tick": len(data) - 1, "kind": "end", "reason": "<time>"}])
        log.close()
    if table is not None:
        write_hazards(folder, table)
    return folder


def write_hazards(folder, hazards):
    text = as_csv(COLUMNS, map(dataclasses.asdict, hazards))
    (folder / "hazards.csv").write_text(text, encoding="utf-8")
