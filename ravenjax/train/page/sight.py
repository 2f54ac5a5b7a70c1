"""What each role sees of frames, events and header: the operator no hazard, nobody what blinding
hides.

Of the robot's checks an operator learns of those that tell a person or stop the robot (event
"alarm"), as at a console.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.train.protocol.frame import FrameLayout

_OPERATOR = {
    "phase",
    "view",
    "console",
    "pedal",
    "runlevel",
    "owner",
    "refused",
    "rearm",
    "started",
    "alarm",
    "alarm_count",
    "target",
    "object",
    "level",
    "task_done",
    "overrun",
    "trouble",
    "end",
}
_OF_HAZARDS = ("hazard", "fault_active", "trips", "halted_ms", "golden_halted_ms", "golden_cue")
"""Channels that would tell an operator of a hazard."""
_OF_HAZARDS_ARM = ("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm", "known_mm")
_FELT = {
    "cue",
    "response",
}  # what the operator's own hand knows; in a blinded session it would tell the group
_HEADER_OPERATOR = {"hazards", "group", "seed", "director", "scenario", "summary"}
_HEADER_BLINDED = {"group", "cue", "scenario", "seed", "summary"}


class Sight:
    """What one role sees of one session."""

    def __init__(self, layout: FrameLayout, role: str, blinded: bool) -> None:
        self._layout, self._blinded = layout, blinded
        self._instructor = role == "instructor"

    def event(self, kind: str) -> bool:
        """Whether an event of this kind is told."""
        if self._instructor:
            return not (self._blinded and kind == "cue")
        return kind in _OPERATOR or (kind in _FELT and not self._blinded)

    def header(self, header: dict[str, Any]) -> dict[str, Any]:
        """The session's header without what is hidden."""
        hidden = set() if self._instructor else set(_HEADER_OPERATOR)
        if self._blinded:
            hidden |= _HEADER_BLINDED
        scenario = header.get("scenario") or {}
        words = {name: scenario[name] for name in ("title", "description") if scenario.get(name)}
        return words | {name: value for name, value in header.items() if name not in hidden}

    def frame(self, row: np.ndarray, extras: np.ndarray) -> bytes:
        """Message of a frame, float32: extras [arms, 5], then the row, masked.

        Of each arm: greatest error_mm and force since the last frame; the tip that the software
        wants, m, frame 0.

        The force is what the hand feels: zero with the cue off. The instructor sees the force that
        the cue would have.
        """
        row, extras = row.copy(), extras.copy()
        places = self._layout.places
        felt = float(row[places["cue_on"]][0]) != 0
        if self._blinded:
            row[places["cue_on"]] = 1
        if not self._instructor:
            for name in _OF_HAZARDS:
                row[places[name]] = -1 if name == "hazard" else 0
            if not felt:
                extras[:, 1] = 0
            for arm in self._layout.arms:
                for name in _OF_HAZARDS_ARM:
                    row[places[f"{arm}/{name}"]] = 0
                if not felt:
                    row[places[f"{arm}/force"]] = 0
                if self._blinded:
                    row[places[f"{arm}/error_mm"]] = 0
                    row[places[f"{arm}/model_jpos"]] = row[places[f"{arm}/link_jpos"]]
                    row[places[f"{arm}/model_tip"]] = row[places[f"{arm}/tip"]]
            if self._blinded:
                extras[:, 0] = 0
                extras[:, 2:] = [row[places[f"{arm}/tip"]] for arm in self._layout.arms]
        return np.concatenate([extras.ravel(), row]).astype(np.float32).tobytes()
