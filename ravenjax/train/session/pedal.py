"""Explains why a pedal does not count although a network console holds it down.

The page shows the state of its own pedal. The operator of another console gets only forces from the
session. Therefore each change of the reason makes an event "refused" (console, why), which the page
and the log show. The terminal prints each new reason. A reason that lasts is reported once.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path

from ravenjax.train.protocol.messages import Event, Say

NETWORK = ("itp", "crtk")
"""The consoles of `CONSOLES` whose users get the reasons."""
HOLDS_MS = 50
"""Only a reason that lasts longer than this is reported: a person cannot react to a shorter one."""
_WORDS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
REASONS: dict[str, str] = _WORDS["reasons"]
RELEASED: dict[str, str] = _WORDS["released"]
"""Why a pedal that CRTK holds down was raised automatically, by `OperatingState.why`."""


def lift_message(since: str = "") -> str:
    """Return that the pedal must be lifted. since: the cause, as in the event "rearm"."""
    cause = _WORDS["since"].get(since)
    return f"{REASONS['lift']} ({cause})" if cause else REASONS["lift"]


def other_console_message(owner: str) -> str:
    """Return that another console drives."""
    return f"{owner} drives: wait until {owner} leaves or control is given to this console"


def packets_message(cause: str) -> str:
    """Return that the console's packets are refused. cause: one of `packet_filter.CAUSES`."""
    why = _WORDS["packets"].get(cause, f"{cause} does not fit the console profile")
    return f"its packets are refused: {why}"


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
