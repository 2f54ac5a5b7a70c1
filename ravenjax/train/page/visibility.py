"""Hides parts of frames, events and header from roles.

Operators do not see hazards. What blinding hides, nobody sees. As at a real console, an operator
learns only of checks that raise an alarm or stop the robot (event "alarm").
"""

import numpy as np

from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.messages import Event, Json

_OPERATORS_EVENTS = {
    *("phase", "view", "console", "pedal", "runlevel", "owner", "refused", "rearm", "started"),
    *("alarm", "alarm_count", "target", "object", "level", "task_done", "overrun", "trouble"),
    "end",
}
_FELT_EVENTS = {"cue", "response"}
"""Events that the operator's hand feels. In a blinded session they would reveal the group."""
# Channels that would reveal a hazard to an operator, of the robot and of each arm.
_OF_HAZARDS = ("fault_active", "trips", "halted_ms", "golden_halted_ms", "golden_cue")
_OF_HAZARDS_ARM = ("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm", "known_mm")
_HIDDEN_FROM_OPERATORS = {"hazards", "group", "seed", "director", "scenario", "summary"}
_HIDDEN_BY_BLINDING = {"group", "cue", "scenario", "seed", "summary"}


class Visibility:
    """What one role sees of one session."""

    def __init__(self, layout: FrameLayout, role: str, blinded: bool) -> None:
        self._layout, self._blinded = layout, blinded
        self._is_instructor = role == "instructor"

    def shows_event(self, event: Event) -> bool:
        """Whether the role sees an event."""
        kind = event.get("kind", "")
        if self._is_instructor:
            return kind != "hazard_row" and not (self._blinded and kind == "cue")
        return kind in _OPERATORS_EVENTS or (kind in _FELT_EVENTS and not self._blinded)

    def header(self, header: Json) -> Json:
        """Return the session's header without the hidden entries."""
        hidden = set() if self._is_instructor else _HIDDEN_FROM_OPERATORS
        if self._blinded:
            hidden = hidden | _HIDDEN_BY_BLINDING
        scenario = header.get("scenario") or {}
        words = {name: scenario[name] for name in ("title", "description") if scenario.get(name)}
        return words | {name: value for name, value in header.items() if name not in hidden}

    def frame(self, row: np.ndarray, extras: np.ndarray) -> bytes:
        """Return a frame's message, float32: extras [arms, 5] of `Page._extras`, then the row.

        Both are masked. The force is what the hand feels: zero with the cue off. The instructor
        sees the force that the cue would have.
        """
        frame, extras = Frame(self._layout, row.copy()), extras.copy()
        is_felt = frame.number("cue_on") != 0
        if self._blinded:
            frame["cue_on"] = 1
        if not self._is_instructor:
            frame["hazard"] = -1
            for name in _OF_HAZARDS:
                frame[name] = 0
            for i, arm in enumerate(self._layout.arms):
                for name in _OF_HAZARDS_ARM:
                    frame[f"{arm}/{name}"] = 0
                if not is_felt:
                    extras[i, 1] = 0
                    frame[f"{arm}/force"] = 0
                if self._blinded:
                    frame[f"{arm}/error_mm"] = extras[i, 0] = 0
                    frame[f"{arm}/model_jpos"] = frame[f"{arm}/link_jpos"]
                    frame[f"{arm}/model_tip"] = extras[i, 2:] = frame[f"{arm}/tip"]
        return np.concatenate([extras.ravel(), frame.row]).astype(np.float32).tobytes()
