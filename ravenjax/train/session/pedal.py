"""Explains why a pedal that a network console holds down does not count. Each reason is reported
once.

The page shows the state of its own pedal. The operator of another console learns about a session
only through the force. So each change of the reason is an event "refused" (console, why), shown by
the page and the log, and a line at the terminal.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NETWORK = ("itp", "crtk")
"""The consoles of `CONSOLES` whose users get the reasons."""
HOLDS_MS = 50
"""Only a reason that lasts longer than this is reported: a person cannot react to a shorter one."""

LIFT = "the pedal is down, and counts once it was seen up: lift it first"
PAUSED = "the instructor has paused the session"
STOPPED = "the robot is stopped: restart it first"
LOST = "nothing is heard of the robot"
HOMING = "the robot is being homed"
SILENT = "nothing comes from the console any more, so its pedal counts as up; lift it once"
OUT_OF_RANGE = "its increments lead farther than the robot can be told"
_SINCE = {
    "silence": "the console was silent",
    "silent": "the console was silent",
    "left": "the console had left",
    "handover": "it was given to this console",
    "resume": "the session was paused",
    "restart": "the robot began anew",
    "reset": "the robot began anew",
    "link": "nothing was heard of the robot",
}


def lift(since: str = "") -> str:
    """Return that the pedal must be lifted. since: why it must be seen up, as in the
    event "rearm".
    """
    return f"{LIFT} ({_SINCE[since]})" if since in _SINCE else LIFT


def other(owner: str) -> str:
    """Return that another console drives."""
    return (
        f"{owner} drives, and this console watches until it is given the seat or {owner} has gone"
    )


def rival(owner: str) -> str:
    """Return that another console holds its pedal down, where pedals alone decide."""
    return f"the pedal of {owner} is down: lift this one, and press it once that one is up"


RELEASED = {
    "silence": "the pedal came up, for no servo command came for 250 ms: resume",
    "idle": "the pedal came up, for nothing was said for 5 s: resume",
    "nobody": "the pedal came up, for nobody publishes commands any more",
    "refused": (
        "the pedal came up, for the robot did not follow it: another console drives, or it was to"
        " be seen up"
    ),
    "stopped": "the pedal came up, for the robot has stopped: home it, and lift the foot once",
    "lost": "the pedal came up, for nothing is heard of the robot",
}
"""Why a pedal that CRTK holds down was raised automatically, by `OperatingState.why`."""


def packets(cause: str) -> str:
    """Return that the console's packets are refused. cause: one of `packet_filter.CAUSES`."""
    words = {
        "stranger": "packets of another console are followed, until it was silent for two seconds",
        "undecided": "it is not decided yet which console profile they are of",
        "behind": "their numbers go back, as in a stream that is sent again",
        "far_ahead": "their numbers leap too far ahead",
        "duplicate": "their number stays the same",
    }
    return (
        f"its packets are refused: {words.get(cause, f'{cause} does not fit the console profile')}"
    )


class PedalReasons:
    """Stores the reason that was last reported for each console."""

    def __init__(self) -> None:
        self._published: dict[str, str] = dict.fromkeys(NETWORK, "")
        # The new reason that must persist before it is reported, and for how many ms it has.
        self._coming: dict[str, tuple[str, int]] = dict.fromkeys(NETWORK, ("", 0))
        self._lines: list[str] = []

    def look(self, why: Mapping[str, str]) -> list[dict[str, Any]]:
        """Take each console's current reason ("" for none) and return the events for changes.

        Call it once a millisecond, also in a pause. When a reason no longer holds, the event has an
        empty "why".
        """
        events = []
        for console, reason in why.items():
            before, held = self._coming[console]
            held = held + 1 if reason == before else 1
            if reason == self._published[console]:
                held = 0
            elif held == HOLDS_MS:
                self._published[console] = reason
                events.append(self.once(console, reason))
            self._coming[console] = reason, held
        return events

    def once(self, console: str, why: str) -> dict[str, Any]:
        """Return the content of an event for a reason that does not last."""
        line = f"{console}: {why}" if why else ""
        self._lines += [line] if line else []
        return {"console": console, "why": line}

    def news(self) -> list[str]:
        """Return the new lines for the user since the last call."""
        lines, self._lines = self._lines, []
        return lines
