"""Decides which console drives, and whether its pedal counts. One has the seat, the others watch.

Nobody has the seat at first: it goes to the console that first steps on its pedal, and stays there.
A console that has left, or that was silent for `GONE_MS`, loses it. Every other change is a
deliberate act and an event "owner": an operator takes it while the pedal of the other console is
up, its owner gives it away, the instructor gives it to anyone.

A pedal counts as down only after it was seen up: at the beginning, and again after each of these,
which a foot that never moved would not notice: the console was silent for `STALE_MS` or has left,
the seat went to it, the robot was stopped, restarted or set back, a pause was over, the link to the
robot was lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ravenjax.train.protocol.frame import CONSOLES
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.session import pedal as words

GONE_MS = 2000
"""A console that was silent for so long has gone; the same as `robot_link.packet_filter` has for
a stream.
"""
NOBODY, SCRIPT = "nobody", "script"


class ConsoleArbiter:
    """The arbiter of one session."""

    def __init__(self) -> None:
        self.owner = NOBODY
        """One of `CONSOLES`."""
        self._armed: set[str] = set()  # consoles whose pedal was seen up since it had to be
        self._heard: dict[str, int] = {}  # tick of the last word of each
        self._down = False  # the owner's pedal, as it counts
        self._foot: dict[str, bool] = {}  # the pedal of each, as it was said last
        self._since: dict[str, str] = {}  # why each console's pedal had to be seen up
        self._unheard: dict[str, str] = {}  # why nothing of a console is taken
        self._events: list[dict[str, Any]] = []

    @property
    def number(self) -> int:
        """The number of the owner in `CONSOLES`."""
        return CONSOLES.index(self.owner)

    def hear(
        self, message: Mapping[str, Any], take: Callable[[Mapping[str, Any]], bool], tick: int
    ) -> None:
        """A message of a console's hands.

        take: gets it as it counts, if its console drives; it gives False where it is refused, as if
        it were unsaid.
        """
        console, pedal = console_of(message), message["pedal"]
        if console in self._heard and tick - self._heard[console] > STALE_MS:
            self._disarm(console, "silence", tick)
        down = pedal and console in self._armed
        if self.owner in (NOBODY, console):
            if not take({**message, "pedal": down}):
                self._unheard[console] = words.OUT_OF_RANGE
                return
            if self.owner == NOBODY and down:
                self._hand_to(console, "pedal", tick)
            self._down = down
        self._heard[console], self._foot[console] = tick, pedal
        if self._unheard.get(console) == words.OUT_OF_RANGE:
            del self._unheard[console]
        if not pedal:
            self._armed.add(console)

    def unheard(self, console: str, why: str) -> None:
        """Nothing of a console is taken, or "": it is again."""
        self._unheard[console] = why

    def holds(self, console: str) -> bool:
        """Whether a console's pedal is down, whether or not it counts."""
        return self._foot.get(console, False)

    def why_not(self, console: str, tick: int) -> str:
        """Why the pedal that a console holds down does not count; "": it does, or is up."""
        if why := self._unheard.get(console):
            return why
        if not self._foot.get(console):
            return ""
        if tick - self._heard[console] > STALE_MS:
            return words.SILENT
        if self.owner not in (NOBODY, console):
            return words.other(self.owner)
        return "" if console in self._armed else words.lift(self._since.get(console, ""))

    def obey(self, command: Mapping[str, Any], tick: int) -> bool:
        """A command "seat"; whether the seat or its pedal is another's now."""
        console, do, by = console_of(command), command.get("do"), command.get("by", "operator")
        target, refusal = (command.get("to") if do == "give" else console), ""
        if do == "left":
            self._disarm(console, "left", tick)
            if console != self.owner:
                return False
            self._hand_to(NOBODY, "left", tick)
            return True
        if target == self.owner or target not in CONSOLES:
            return False
        is_alive = tick - self._heard.get(self.owner, tick) <= STALE_MS
        if do == "take" and self.owner != NOBODY and self._down and is_alive:
            refusal = f"the pedal of {self.owner} is down"
        elif do == "give" and by != "instructor" and self.owner not in (console, NOBODY):
            refusal = f"{self.owner} has the console"
        if refusal:
            self._tell(tick, "refused", console=console, why=refusal)
            return False
        self._armed.discard(target)
        self._since[target] = "handover"
        self._hand_to(target, by, tick)
        return True

    def step(self, tick: int) -> bool:
        """Once a tick; whether the console that had the seat has lost it by its silence."""
        if self.owner == NOBODY or tick - self._heard.get(self.owner, tick) <= GONE_MS:
            return False
        self._disarm(self.owner, "silence", tick)
        self._hand_to(NOBODY, "silent", tick)
        return True

    def vacate(self, tick: int) -> str:
        """Once a tick where pedals alone decide: nobody keeps the seat whose pedal is up, or whose
        console was silent for `STALE_MS`; that one is returned. A pedal that was pressed meanwhile
        must be seen up first.
        """
        is_silent = self.owner != NOBODY and tick - self._heard[self.owner] > STALE_MS
        silent = self.owner if is_silent else ""
        if is_silent or not self._down:
            self._armed -= {console for console, is_down in self._foot.items() if is_down}
            self.owner, self._down = NOBODY, False
        return silent

    def rearm(self, why: str, tick: int) -> None:
        """Whatever pedal is down now no longer counts, until it was seen up."""
        if self._armed:
            self._tell(tick, "rearm", why=why)
        self._armed.clear()
        self._since = dict.fromkeys(CONSOLES, why)
        self._down = False

    def events(self) -> list[dict[str, Any]]:
        """What happened since the last call."""
        events, self._events = self._events, []
        return events

    def _hand_to(self, console: str, by: str, tick: int) -> None:
        self.owner, self._down = console, False
        self._heard[console] = tick
        self._tell(tick, "owner", console=console, by=by)

    def _disarm(self, console: str, why: str, tick: int) -> None:
        if console in self._armed:
            self._armed.discard(console)
            self._since[console] = why
            if console == self.owner:
                self._tell(tick, "rearm", why=why)

    def _tell(self, tick: int, kind: str, **what: Any) -> None:
        self._events.append({"tick": tick, "kind": kind, **what})


def console_of(message: Mapping[str, Any]) -> str:
    """Which console a message is of."""
    console = message.get("console")
    return console if console in CONSOLES[1:] else SCRIPT
