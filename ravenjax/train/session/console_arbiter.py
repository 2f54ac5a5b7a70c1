"""Decides which console drives the robot (has the *seat*), and whether its pedal counts.

The first console whose pedal goes down gets the seat. It loses the seat when it leaves or sends
nothing for `GONE_MS`. While its pedal is up, the operator at another console may take the seat. The
console may give the seat away, and the instructor may give the seat to any console. In `ravenjax
robot` only the pedals decide: a console whose pedal is up loses the seat when another pedal is
pressed. An operator could miss that a session begins, or that it continues after an interruption.
If the pedal is already down at this moment, the operator must lift it before it counts. A network
console receives no texts, so the page and the terminal show why its pedal does not count.
"""

from collections import deque
from collections.abc import Callable, Mapping

from ravenjax import resources
from ravenjax.train.protocol import CONSOLES, STALE_MS, Command, Event, Say

NETWORK = ("itp", "crtk")  # The consoles whose reasons the page and the terminal show
MIN_REASON_MS = 50
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
    """Return the message that a console's packets are refused. cause: one of `itp.CAUSES`, or the
    part of a packet that does not fit the console profile.
    """
    reason = _WORDS["packets"].get(cause, f"{cause} does not fit the console profile")
    return f"its packets are refused: {reason}"


class PedalReasons:
    """Reports why the pedal of each network console does not count, once for each change."""

    def __init__(self, say: Say = lambda _: None):
        """say: prints a reason for the user."""
        self.say = say
        self._published: dict[str, str] = dict.fromkeys(NETWORK, "")
        # The latest reason of each console, and for how many ms it has lasted unpublished.
        self._latest: dict[str, tuple[str, int]] = dict.fromkeys(NETWORK, ("", 0))

    def update(self, reasons: Mapping[str, str]) -> list[Event]:
        """Return an event for each console whose reason changed and lasted `MIN_REASON_MS`.
        reasons: of this millisecond, by console; "" for none. Call it each ms, also in a pause.
        """
        events = []
        for console, reason in reasons.items():
            last_reason, duration_ms = self._latest[console]
            duration_ms = duration_ms + 1 if reason == last_reason else 1
            if reason == self._published[console]:
                # The user knows this reason already, so its duration does not matter.
                duration_ms = 0
            elif duration_ms == MIN_REASON_MS:
                self._published[console] = reason
                events.append(self.report(console, reason))
            self._latest[console] = reason, duration_ms
        return events

    def report(self, console: str, reason: str) -> Event:
        """Print a reason, and return the content of its event. reason "": there is none now."""
        line = f"{console}: {reason}" if reason else ""
        if line:
            self.say(line)
        return {"console": console, "why": line}


class DoublePress:
    """Detects two short presses of a pedal, which begin and end a trial at a network console."""

    _was_down = False

    def __init__(self):
        # Ticks at which the pedal last went down, up, down and up.
        self._change_ticks: deque[int] = deque(maxlen=4)

    def update(self, down: bool, tick: int) -> bool:
        """Return whether the second of two short presses ends in this tick. down: whether the pedal
        is down in a console's message. `_change_ticks` keeps only the last four changes.
        """
        if down == self._was_down:
            return False
        self._was_down = down
        self._change_ticks.append(tick)
        is_second_end = not down and len(self._change_ticks) == 4
        is_double = is_second_end and tick - self._change_ticks[0] <= DOUBLE_PRESS_MS
        if is_double:
            self._change_ticks.clear()
        return is_double


class ConsoleArbiter:
    """Decides who drives in one session."""

    owner = NOBODY  # The console that has the seat, one of `CONSOLES`
    pedal_down = False  # Whether the owner's pedal is down and counts

    def __init__(
        self, record: Callable[..., None] = lambda *_, **__: None, by_pedals: bool = False
    ):
        """record: called with kind and content of each event. by_pedals: pedals alone decide."""
        self._record, self._by_pedals = record, by_pedals
        self._ready: set[str] = set()  # Consoles whose pedal counts, because it was lifted
        # By console: tick of the last message, and whether the pedal was down in it.
        self._message_ticks: dict[str, int] = {}
        self._pedals_down: dict[str, bool] = {}
        # By console: why the pedal must be lifted, and why messages are refused.
        self._lift_causes: dict[str, str] = {}
        self._refusals: dict[str, str] = {}

    def receive(self, message: Command, take: Callable[[Command], bool], tick: int) -> None:
        """Process a message in which a console reports its hands and its pedal.

        The console may drive if it has the seat or the seat is free. If pedals alone decide, it may
        also drive while the owner's pedal is up. Its pedal counts if the operator lifts the pedal
        and then presses it while the console may drive. The console then gets the seat. take: moves
        the hands, or returns False to refuse the message. It is called if the console has or gets
        the seat, or if the seat is free. In its argument, "pedal" tells whether the pedal counts.
        """
        console, pedal = console_of(message), message["pedal"]
        last_tick = self._message_ticks.get(console)
        if last_tick is not None and tick - last_tick > STALE_MS:
            self._require_lift(console, "silence")
        no_other_owner = self.owner in (NOBODY, console)
        may_drive = no_other_owner or (self._by_pedals and not self.pedal_down)
        if pedal and not may_drive:
            # A pedal that was pressed while another one is down must be lifted first.
            self._ready.discard(console)
        counts = pedal and console in self._ready
        if may_drive and (counts or no_other_owner):
            if not take({**message, "pedal": counts}):
                self._refusals[console] = REASONS["out_of_range"]
                return
            if self.owner != console and counts:
                self._hand_over(console, "pedal", tick)
            self.pedal_down = counts
        self._message_ticks[console], self._pedals_down[console] = tick, pedal
        # The hands are in range again.
        if self._refusals.get(console) == REASONS["out_of_range"]:
            del self._refusals[console]
        if not pedal:
            self._ready.add(console)

    def set_refusal(self, console: str, reason: str) -> None:
        """Store why a console's messages are refused; "": they are accepted again."""
        self._refusals[console] = reason

    def is_pedal_down(self, console: str) -> bool:
        """Whether a console's pedal is down, even if it does not count."""
        return self._pedals_down.get(console, False)

    def refusal_reason(self, console: str, tick: int) -> str:
        """Return why a console's messages are refused, or why its pedal, which is held down, does
        not count; "" if the messages are accepted and the pedal counts or is up.
        """
        if refusal := self._refusals.get(console):
            return refusal
        if not self._pedals_down.get(console):
            return ""
        if tick - self._message_ticks[console] > STALE_MS:
            return REASONS["silent"]
        has_other_owner = self.owner not in (NOBODY, console)
        # If pedals alone decide, an owner whose pedal is up does not prevent others from driving.
        if has_other_owner and (self.pedal_down or not self._by_pedals):
            wait = f"wait until {self.owner} leaves or control is given to this console"
            return f"{self.owner} drives: {wait}"
        if console in self._ready:
            return ""
        cause = _WORDS["since"].get(self._lift_causes.get(console))
        return f"{REASONS['lift']} ({cause})" if cause else REASONS["lift"]

    def change_seat(self, command: Command, tick: int) -> bool:
        """Carry out a command of type "seat". Return whether another console has the seat now.
        "left": the console leaves. "take": it takes the seat, unless the owner's pedal is down.
        "give": owner or instructor gives the seat to console "to". A refusal becomes an event.
        """
        console, action = console_of(command), command.get("do")
        sender = command.get("by", "operator")
        if action == "left":
            self._require_lift(console, "left")
            if console != self.owner:
                return False
            self._hand_over(NOBODY, "left", tick)
            return True
        target = {"give": command.get("to"), "take": console}.get(str(action), "")
        if target == self.owner or target not in CONSOLES:
            return False
        refusal = ""
        is_alive = tick - self._message_ticks.get(self.owner, tick) <= STALE_MS
        if action == "take" and self.owner != NOBODY and self.pedal_down and is_alive:
            refusal = f"the pedal of {self.owner} is down"
        elif action == "give" and sender != "instructor" and self.owner not in (console, NOBODY):
            refusal = f"{self.owner} has the console"
        if refusal:
            self._record("refused", console=console, why=refusal)
            return False
        self._ready.discard(target)
        self._lift_causes[target] = "handover"
        self._hand_over(target, sender, tick)
        return True

    def step(self, tick: int) -> bool:
        """Check the owner once a tick. Return whether it lost the seat because it was silent."""
        # If pedals alone decide, silence counts as a lifted pedal, so the seat becomes free.
        gone_ms = STALE_MS if self._by_pedals else GONE_MS
        if self.owner == NOBODY or tick - self._message_ticks.get(self.owner, tick) <= gone_ms:
            return False
        self._require_lift(self.owner, "silence")
        self._hand_over(NOBODY, "silent", tick)
        return True

    def require_lifts(self, cause: str) -> None:
        """Require that every pedal is lifted before it counts again. cause: shown to the user."""
        if self._ready:
            self._record("rearm", why=cause)
        self._ready.clear()
        self._lift_causes = dict.fromkeys(CONSOLES, cause)
        self.pedal_down = False

    def _hand_over(self, console: str, sender: str, tick: int):
        # Gives the seat to a console. sender: who caused this, for the event.
        self.owner, self.pedal_down = console, False
        # A console that has just got the seat does not count as silent.
        self._message_ticks[console] = tick
        self._record("owner", console=console, by=sender)

    def _require_lift(self, console: str, cause: str):
        if console in self._ready:
            self._ready.discard(console)
            self._lift_causes[console] = cause
            if console == self.owner:
                self._record("rearm", why=cause)


def console_of(message: Command) -> str:
    """Return the console that a message comes from."""
    console = message.get("console")
    return console if console in CONSOLES[1:] else SCRIPT
