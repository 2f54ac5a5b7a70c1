"""Decides which console drives the robot, and whether its pedal counts. Only one console drives at
a time: it has the *seat*.

The first console whose pedal goes down gets the seat. It loses the seat when it leaves or sends
nothing for `GONE_MS`. While its pedal is up, the operator at another console may take the seat. The
console may give the seat away, and the instructor may give the seat to any console. In `ravenjax
robot` only the pedals decide: a console whose pedal is up loses the seat when another pedal is
pressed.

An operator may not notice that the session began or was interrupted. After such an event a pedal
that is down does not count until it was lifted. A network console receives forces but no texts, so
the page and the terminal show why its pedal does not count.
"""

from collections import deque
from collections.abc import Callable, Mapping

from ravenjax.bundled import resources
from ravenjax.train.protocol import CONSOLES, STALE_MS, Command, Event, Say

NETWORK = ("itp", "crtk")
"""The consoles whose reasons the page and the terminal show."""
HOLDS_MS = 50
"""A reason is reported if it lasts this long, ms: a person cannot react to a shorter one."""
_WORDS = resources.read_tables(__file__, "pedal.toml")
REASONS: dict[str, str] = _WORDS["reasons"]
RELEASED: dict[str, str] = _WORDS["released"]
"""Texts: why a pedal that a CRTK console holds down does not count, by `OperatingState.why`."""
DOUBLE_PRESS_MS = 800
"""The longest time of two presses that count as a double press, ms; an assumption."""
GONE_MS = 2000
"""A console that sends nothing for this time, ms, counts as gone, as in `robot_link.itp`."""
NOBODY, SCRIPT = "nobody", "script"


def packets_message(cause: str) -> str:
    """Return the message that a console's packets are refused. cause: one of `itp.CAUSES`."""
    why = _WORDS["packets"].get(cause, f"{cause} does not fit the console profile")
    return f"its packets are refused: {why}"


class PedalReasons:
    """Reports why the pedal of each network console does not count, once for each change."""

    def __init__(self, say: Say = lambda _: None) -> None:
        """say: prints a reason for the user."""
        self.say = say
        self._published: dict[str, str] = dict.fromkeys(NETWORK, "")
        # The latest reason of each console, and for how many ms it has lasted.
        self._coming: dict[str, tuple[str, int]] = dict.fromkeys(NETWORK, ("", 0))

    def update(self, why: Mapping[str, str]) -> list[Event]:
        """Return an event for each console whose reason changed.

        why: the present reasons, "" for none. Call it once a millisecond, also in a pause.
        """
        events = []
        for console, reason in why.items():
            before, held = self._coming[console]
            held = held + 1 if reason == before else 1
            if reason == self._published[console]:
                held = 0
            elif held == HOLDS_MS:
                self._published[console] = reason
                events.append(self.report(console, reason))
            self._coming[console] = reason, held
        return events

    def report(self, console: str, why: str) -> Event:
        """Print a reason, and return the content of its event."""
        line = f"{console}: {why}" if why else ""
        if line:
            self.say(line)
        return {"console": console, "why": line}


class DoublePress:
    """Detects two short presses of a pedal, which begin and end a trial at a network console."""

    _down = False

    def __init__(self) -> None:
        self._changes: deque[int] = deque(maxlen=4)

    def update(self, down: bool, tick: int) -> bool:
        """Return whether the pedal of this message ends the second of two short presses."""
        if down == self._down:
            return False
        self._down = down
        self._changes.append(tick)
        is_fourth = not down and len(self._changes) == 4
        is_double = is_fourth and tick - self._changes[0] <= DOUBLE_PRESS_MS
        if is_double:
            self._changes.clear()
        return is_double


class ConsoleArbiter:
    """Decides who drives in one session."""

    owner = NOBODY
    """The console that has the seat, one of `CONSOLES`."""
    down = False
    """Whether the owner's pedal is down and counts."""

    def __init__(
        self, record: Callable[..., None] = lambda *_, **__: None, by_pedals: bool = False
    ) -> None:
        """record: called with the tick, the kind and the content of each event. by_pedals: whether
        pedals alone decide who drives.
        """
        self._record, self._by_pedals = record, by_pedals
        self._armed: set[str] = set()  # consoles whose pedal counts, because it was lifted
        self._heard: dict[str, int] = {}  # tick of each console's last message
        self._foot: dict[str, bool] = {}  # each console's pedal in its last message
        self._since: dict[str, str] = {}  # why each console's pedal must be lifted
        self._unheard: dict[str, str] = {}  # why a console's messages are refused

    def receive(self, message: Command, take: Callable[[Command], bool], tick: int) -> None:
        """Process a message in which a console reports its hands and its pedal.

        take: called with the message if its console drives; the pedal in it is up if it does not
        count. `take` returns False to refuse the message.
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
                self._unheard[console] = REASONS["out_of_range"]
                return
            if self.owner != console and down:
                self._hand_to(console, "pedal", tick)
            self.down = down
        self._heard[console], self._foot[console] = tick, pedal
        if self._unheard.get(console) == REASONS["out_of_range"]:
            del self._unheard[console]
        if not pedal:
            self._armed.add(console)

    def set_refusal(self, console: str, why: str) -> None:
        """Store why a console's messages are refused; "": they are accepted again."""
        self._unheard[console] = why

    def is_pedal_down(self, console: str) -> bool:
        """Whether a console's pedal is down, even if it does not count."""
        return self._foot.get(console, False)

    def why_not(self, console: str, tick: int) -> str:
        """Return why a pedal that is held down does not count; "" if it counts or is up."""
        if why := self._unheard.get(console):
            return why
        if not self._foot.get(console):
            return ""
        if tick - self._heard[console] > STALE_MS:
            return REASONS["silent"]
        if self.owner not in (NOBODY, console) and (self.down or not self._by_pedals):
            wait = f"wait until {self.owner} leaves or control is given to this console"
            return f"{self.owner} drives: {wait}"
        if console in self._armed:
            return ""
        cause = _WORDS["since"].get(self._since.get(console))
        return f"{REASONS['lift']} ({cause})" if cause else REASONS["lift"]

    def change_seat(self, command: Command, tick: int) -> bool:
        """Carry out a command of type "seat". Return whether another console has the seat now."""
        console, do, by = console_of(command), command.get("do"), command.get("by", "operator")
        target, refusal = command.get("to") if do == "give" else console if do == "take" else "", ""
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
        """Check the owner once a tick. Return whether it lost the seat because it was silent."""
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
