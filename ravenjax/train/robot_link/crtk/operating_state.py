"""Decides the operating state that CRTK sees, and whether its consoles hold the robot's pedal down.

- DISABLED: not enabled since power-on (brakes on, pedal up), or stopped by `disable` (E-stop).
- ENABLED: pedal down, also that of another console; or initialising, then busy.
- PAUSED: powered, but the pedal is up.
- FAULT: stopped by a check of the robot, an E-stop, or a lost link.

Commands are those of CRTK's table. A command that is invalid in a state changes nothing. `enable`
homes a stopped robot again, as `home` does. A robot without power has lost its homing, so `unhome`
is the same as `disable`.

A command holds the pedal down only while somebody commands. It comes up, and stays up until
`resume`, once nobody publishes commands or the last command is `IDLE_MS` old (the robot's own
time-out). In a stream of servo commands, it comes up once the last is `STALE_MS` old. An E-stop
cancels every request, including that of a foot that is still on a pedal.
"""

from typing import Literal

from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP

State = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]
Order = Literal["estop", "restart"]
IDLE_MS = 5000
"""The robot lifts the pedal of a console that is silent for this time (raven2 `local_io.cpp`)."""
REFUSED_MS = 500
"""A pedal that the robot does not follow for this time does not count: another console drives."""
COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")


class OperatingState:
    """The operating state of one robot. Times are ms of one monotonic clock."""

    def __init__(self) -> None:
        self.runlevel = PEDAL_UP
        self.is_busy = False  # whether a move is under way
        self.pedal = False  # whether CRTK wants the pedal down
        self.why = ""  # why the pedal came up last
        self._stopped = self._lost = False
        self._disabled = True  # nobody has enabled the robot
        # A stop was ordered but has not happened yet.
        self._disabling = False
        # A restart was ordered; the pedal goes down once the robot is ready.
        self._restarting = False
        self._present = self._clutch = False  # feet on the two pedals
        # The pedal was down when the clutch was pressed.
        self._clutched = False
        self._streams = False  # servo commands came since pedal-down
        self._servo_ms = self._word_ms = self._down_ms = self._up_ms = float("-inf")
        # Another console holds the pedal: CRTK cannot drive until it lets go.
        self.other_drives = False

    @property
    def state(self) -> State:
        if self._lost:
            return "FAULT"
        if self._stopped or self.runlevel == E_STOP:
            return "DISABLED" if self._disabled else "FAULT"
        if self.runlevel == INIT or self.other_drives:
            return "ENABLED"
        if self._disabled:
            return "DISABLED"
        return "ENABLED" if self.pedal and self.runlevel == PEDAL_DOWN else "PAUSED"

    @property
    def is_homed(self) -> bool:
        """Whether the robot is homed. A robot without power has lost its homing."""
        return self.runlevel in (PEDAL_UP, PEDAL_DOWN)

    @property
    def drives(self) -> bool:
        """Whether commands of motion are followed."""
        return self.pedal and self.state == "ENABLED" and self.runlevel == PEDAL_DOWN

    def command(self, word: str, now_ms: float) -> list[Order]:
        """Return the orders for the robot. Raises ValueError if CRTK has no such command."""
        if word not in COMMANDS:
            raise ValueError(f"state command {word!r}, expected one of {', '.join(COMMANDS)}")
        self._word_ms = now_ms
        state = self.state
        if word in ("disable", "unhome"):
            self._release(word)
            if self.runlevel == E_STOP:
                self._disabled = True
                return []
            self._disabling = True
            return ["estop"]
        if word == "pause":
            if state == "ENABLED":
                self._release(word)
            return []
        if word == "resume":
            if state == "PAUSED":
                self._press(now_ms)
            return []
        if word == "enable" and state in ("DISABLED", "FAULT"):
            if self.is_homed and not (self._stopped or self._lost):
                self._disabled = False
                self._press(now_ms)
                return []
            self._restarting = True
            return ["restart"]
        if word == "home" and not self.is_homed:
            self._disabled = False
            return ["restart"]
        return []

    def foot(self, present: bool | None, clutch: bool | None, now_ms: float) -> None:
        """Take the feet on the pedals: operator present, and clutch. A value of None is unknown.

        A present operator drives, except while the clutch is held.
        """
        self._word_ms = now_ms
        if present is not None:
            steps_on, self._present = present and not self._present, present
            if (
                steps_on
                and not self._clutch
                and self.state in ("PAUSED", "DISABLED")
                and self.is_homed
            ):
                self._disabled = False
                self._press(now_ms)
            elif not present:
                self._release("operator")
        if clutch is not None and clutch != self._clutch:
            self._clutch = clutch
            if clutch:
                down = self.pedal
                self._release("clutch")
                self._clutched = down
            elif self._clutched and self.state == "PAUSED":
                self._press(now_ms)

    def servo(self, now_ms: float) -> None:
        """Record that a servo command came."""
        self._servo_ms = self._word_ms = now_ms
        self._streams = True

    def word(self, now_ms: float) -> None:
        """Record that another, single command of motion came."""
        self._word_ms = now_ms
        self._streams = False

    def observe(
        self, runlevel: int, stopped: bool, connected: bool, now_ms: float, lost: bool = False
    ) -> None:
        """Take the run level, and whether the robot is stopped, commanded and lost."""
        was_stopped = self._stopped or self.runlevel == E_STOP
        if lost and not self._lost:
            # A robot that was enabled need not be enabled again afterwards.
            self._release("lost")
        self.runlevel, self._stopped, self._lost = runlevel, stopped, lost
        is_stopped = stopped or runlevel == E_STOP
        if is_stopped and not was_stopped:
            self._release("stopped")
            self._disabled = False
        if is_stopped and self._disabling:
            self._disabled, self._disabling = True, False
        if self._restarting and not (is_stopped or lost) and runlevel == PEDAL_UP:
            self._restarting = self._disabled = False
            self._press(now_ms)
        if self.pedal or runlevel != PEDAL_DOWN:
            self._up_ms = now_ms
        self.other_drives = now_ms - self._up_ms > REFUSED_MS
        if not self.pedal:
            return
        if self.is_busy:
            self._word_ms = now_ms
        if not connected:
            self._release("nobody")
        elif self._streams and not self.is_busy and now_ms - self._servo_ms > STALE_MS:
            self._release("silence")
        elif now_ms - self._word_ms > IDLE_MS:
            self._release("idle")
        elif runlevel == PEDAL_DOWN:
            self._down_ms = now_ms
        elif now_ms - self._down_ms > REFUSED_MS:
            self._release("refused")

    def _press(self, now_ms: float) -> None:
        self.pedal, self._streams, self._clutched = True, False, False
        self._down_ms = now_ms

    def _release(self, why: str) -> None:
        if self.pedal:
            self.why = why
        self.pedal = self._clutched = self._restarting = False
