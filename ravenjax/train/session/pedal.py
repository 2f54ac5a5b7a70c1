"""Explains why a pedal that a network console holds down does not count. Each reason is reported
once.

The page shows the state of its own pedal. The operator of another console learns about a session
only through the force. So each change of the reason is an event "refused" (console, why), shown by
the page and the log, and a line at the terminal.
"""

from __future__ import annotations

from collections.abc import Mapping

from ravenjax.train.protocol.messages import Event, Say

NETWORK = ("itp", "crtk")
"""The consoles of `CONSOLES` whose users get the reasons."""
HOLDS_MS = 50
"""Only a reason that lasts longer than this is reported: a person cannot react to a shorter one."""

LIFT = "the pedal was already down: lift it, then press it again"
PAUSED = "the instructor has paused the session"
STOPPED = "the robot is stopped: restart it first"
LOST = "no reports of the robot arrive"
HOMING = "the robot is homing"
SILENT = "the console sends nothing, so its pedal counts as up: lift it once"
RIVAL = "the pedal of another console is down: lift this one, and press it once that one is up"
OUT_OF_RANGE = "its increments lead out of the range of positions that a packet can hold"
_SINCE = {
    "silence": "the console was silent",
    "silent": "the console was silent",
    "left": "the console had left",
    "handover": "control was given to this console",
    "resume": "the session was paused",
    "restart": "the robot was restarted",
    "reset": "the robot was restarted",
    "link": "no reports of the robot arrived",
}


def lift_message(since: str = "") -> str:
    """Return that the pedal must be lifted. since: the cause, as in the event "rearm"."""
    return f"{LIFT} ({_SINCE[since]})" if since in _SINCE else LIFT


def other_console_message(owner: str) -> str:
    """Return that another console drives."""
    return f"{owner} drives: wait until {owner} leaves or control is given to this console"


RELEASED = {
    "silence": "the pedal was released after 250 ms without a servo command: send resume",
    "idle": "the pedal was released after 5 s without a command: send resume",
    "nobody": "the pedal was released: nobody publishes commands any more",
    "refused": (
        "the pedal was released because the robot did not follow it: another console drives, or"
        " the pedal was not lifted before"
    ),
    "stopped": "the pedal was released because the robot stopped: home it, and lift the foot once",
    "lost": "the pedal was released: no reports of the robot arrive",
}
"""Why a pedal that CRTK holds down was raised automatically, by `OperatingState.why`."""


def packets_message(cause: str) -> str:
    """Return that the console's packets are refused. cause: one of `packet_filter.CAUSES`."""
    words = {
        "stranger": "another console drives until it is silent for two seconds",
        "undecided": "the packets do not show yet which console profile applies",
        "behind": "their numbers go back, as in a repeated stream",
        "far_ahead": "their numbers jump too far ahead",
        "duplicate": "their number does not change",
    }
    return (
        f"its packets are refused: {words.get(cause, f'{cause} does not fit the console profile')}"
    )


class PedalReasons:
    """Stores the reason that was last reported for each console."""

    def __init__(self, say: Say = lambda _: None) -> None:
        """say: prints a reason for the user."""
        self.say = say
        self._published: dict[str, str] = dict.fromkeys(NETWORK, "")
        # The new reason that must persist before it is reported, and for how many ms it has.
        self._coming: dict[str, tuple[str, int]] = dict.fromkeys(NETWORK, ("", 0))

    def look(self, why: Mapping[str, str]) -> list[Event]:
        """Take each console's reason ("" for none) and return the events for changes.

        Call it once a millisecond, also in a pause.
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

    def once(self, console: str, why: str) -> Event:
        """Return the content of an event for a reason that does not last."""
        line = f"{console}: {why}" if why else ""
        if line:
            self.say(line)
        return {"console": console, "why": line}
