"""Decides which console drives, and whether its pedal counts. One console has the seat, the others
watch.

At first no console has the seat. The first console whose pedal goes down gets it and keeps it. A
console that has left, or that was silent for `GONE_MS`, loses it. An operator may take the seat
while the other console's pedal is up. The owner may give it away, and the instructor may give it to
any console. Each change is an event "owner". Where pedals alone decide, a console loses the seat as
soon as another one presses its pedal while the first one's is up.

A pedal counts as down only after it was up. This applies at the beginning, and after each event
that an operator with a foot on the pedal may not notice. The console left, was silent for
`STALE_MS` or was given the seat. The robot was stopped or restarted. A pause ended, or the link to
the robot was lost.
"""

from collections.abc import Callable

from ravenjax.train.protocol.frame import CONSOLES
from ravenjax.train.protocol.messages import STALE_MS, Command
from ravenjax.train.session import pedal as words

GONE_MS = 2000
"""After this silence a console counts as gone, as in `robot_link.packet_filter`."""
NOBODY, SCRIPT = "nobody", "script"


class ConsoleArbiter:
    """The arbiter of one session."""

    def __init__(
        self, record: Callable[..., None] = lambda *_, **__: None, by_pedals: bool = False
    ) -> None:
        """record: receives the tick, the kind and the content of each event. by_pedals: whether
        pedals alone decide who drives.
        """
        self._record, self._by_pedals = record, by_pedals
        self.owner = NOBODY
        """The console that has the seat, one of `CONSOLES`."""
        self._armed: set[str] = set()  # consoles whose pedal was up as required
        self._heard: dict[str, int] = {}  # tick of each console's last message
        self.down = False
        """The owner's pedal, as it counts."""
        self._foot: dict[str, bool] = {}  # each console's pedal in its last message
        self._since: dict[str, str] = {}  # why each console's pedal must be lifted
        self._unheard: dict[str, str] = {}  # why a console's messages are refused

    def hear(self, message: Command, take: Callable[[Command], bool], tick: int) -> None:
        """Process a message of a console's hands.

        take: receives the message of the console that drives, with the pedal as it counts. It
        returns False if it refuses the message.
        """
        console, pedal = console_of(message), message["pedal"]
        if console in self._heard and tick - self._heard[console] > STALE_MS:
            self._disarm(console, "silence", tick)
        is_free = self.owner in (NOBODY, console) or (self._by_pedals and not self.down)
        if pedal and not is_free:
            # A pedal that was pressed while another one is down must be lifted first.
            self._armed.discard(console)
        down = pedal and console in self._armed
        if is_free and (down or self.owner in (NOBODY, console)):
            if not take({**message, "pedal": down}):
                self._unheard[console] = words.REASONS["out_of_range"]
                return
            if self.owner != console and down:
                self._hand_to(console, "pedal", tick)
            self.down = down
        self._heard[console], self._foot[console] = tick, pedal
        if self._unheard.get(console) == words.REASONS["out_of_range"]:
            del self._unheard[console]
        if not pedal:
            self._armed.add(console)

    def unheard(self, console: str, why: str) -> None:
        """Record why a console's messages are refused; "": they are accepted again."""
        self._unheard[console] = why

    def holds(self, console: str) -> bool:
        """Whether a console's pedal is down, whether or not it counts."""
        return self._foot.get(console, False)

    def why_not(self, console: str, tick: int) -> str:
        """Return why a pedal that is held down does not count; "" if it counts or is up."""
        if why := self._unheard.get(console):
            return why
        if not self._foot.get(console):
            return ""
        if tick - self._heard[console] > STALE_MS:
            return words.REASONS["silent"]
        if self.owner not in (NOBODY, console) and (self.down or not self._by_pedals):
            return words.other_console_message(self.owner)
        return "" if console in self._armed else words.lift_message(self._since.get(console, ""))

    def obey(self, command: Command, tick: int) -> bool:
        """Carry out a command "seat". Return whether the seat has changed hands."""
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
        if do == "take" and self.owner != NOBODY and self.down and is_alive:
            refusal = f"the pedal of {self.owner} is down"
        elif do == "give" and by != "instructor" and self.owner not in (console, NOBODY):
            refusal = f"{self.owner} has the console"
        if refusal:
            self._record(tick, "refused", console=console, why=refusal)
            return False
        self._armed.discard(target)
        self._since[target] = "handover"
        self._hand_to(target, by, tick)
        return True

    def step(self, tick: int) -> bool:
        """Advance by one tick. Return whether the owner has lost the seat by its silence."""
        gone_ms = STALE_MS if self._by_pedals else GONE_MS
        if self.owner == NOBODY or tick - self._heard.get(self.owner, tick) <= gone_ms:
            return False
        self._disarm(self.owner, "silence", tick)
        self._hand_to(NOBODY, "silent", tick)
        return True

    def rearm(self, why: str, tick: int) -> None:
        """Require that every pedal is lifted before it counts again."""
        if self._armed:
            self._record(tick, "rearm", why=why)
        self._armed.clear()
        self._since = dict.fromkeys(CONSOLES, why)
        self.down = False

    def _hand_to(self, console: str, by: str, tick: int) -> None:
        self.owner, self.down = console, False
        self._heard[console] = tick
        self._record(tick, "owner", console=console, by=by)

    def _disarm(self, console: str, why: str, tick: int) -> None:
        if console in self._armed:
            self._armed.discard(console)
            self._since[console] = why
            if console == self.owner:
                self._record(tick, "rearm", why=why)


def console_of(message: Command) -> str:
    """Return the console that a message comes from."""
    console = message.get("console")
    return console if console in CONSOLES[1:] else SCRIPT
