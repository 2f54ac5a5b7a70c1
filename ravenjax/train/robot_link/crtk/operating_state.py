"""The operating state that CRTK sees, and whether its consoles hold the robot's pedal down.

    DISABLED   not enabled since the robot was switched on (brakes on, pedal up), or stopped by `disable` (E-stop)
    ENABLED    pedal down, whoever drives; also while the robot initialises, busy then
    PAUSED     powered, but the pedal is up
    FAULT      stopped by anything else: a check of the robot, an E-stop, a link that is lost

Commands are those of CRTK's table, and what is invalid there changes nothing. `enable` homes a
stopped robot anew, as `home` does; a robot without power has lost its homing, so that `unhome` is
`disable`.

A pedal that is held down by a command must be held by somebody. It comes up, and stays up until
`resume`, when nobody publishes commands any more, `STALE_MS` after the last of a stream of servo
commands, and `IDLE_MS` after the last word of any kind, the robot's own time-out. An E-stop takes
every wish back, a foot that is still on a pedal among them.
"""  # noqa: E501

from __future__ import annotations

from typing import Literal

from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP

State = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]
Order = Literal["estop", "restart"]
IDLE_MS = 5000
"""raven2 `local_io.cpp`: the robot lifts the pedal of a console that was silent for so many
cycles.
"""
REFUSED_MS = 500
"""A pedal that the robot does not follow for so long does not count: another console drives."""
COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")


class OperatingState:
    """Of one robot. Times are ms of one monotonic clock."""

    def __init__(self) -> None:
        self.runlevel = PEDAL_UP
        self.is_busy = False  # a move is on its way
        self.pedal = False  # as CRTK wishes it
        self.why = ""  # the pedal came up last
        self._stopped = self._lost = False
        self._disabled = True  # nobody has enabled it
        self._disabling = False  # it was asked to stop, and has not yet
        self._restarting = False  # and the pedal goes down once it is ready
        self._present = self._clutch = False  # feet
        self._clutched = False  # the pedal was down when the clutch was stepped on
        self._streams = False  # servo commands came since the pedal went down
        self._servo_ms = self._word_ms = self._down_ms = self._up_ms = float("-inf")
        self.other_drives = (
            False  # another console holds the pedal: nothing is to be had before it lets go
        )

    @property
    def state(self) -> State:
        """What is told."""
        if self._lost:
            return "FAULT"
        if self._stopped or self.runlevel == E_STOP:
            return "DISABLED" if self._disabled else "FAULT"
        if self.runlevel == INIT:
            return "ENABLED"
        if self.other_drives:
            return "ENABLED"
        if self._disabled:
            return "DISABLED"
        return "ENABLED" if self.pedal and self.runlevel == PEDAL_DOWN else "PAUSED"

    @property
    def is_homed(self) -> bool:
        """A robot without power has lost it."""
        return self.runlevel in (PEDAL_UP, PEDAL_DOWN)

    @property
    def drives(self) -> bool:
        """Whether motion is taken."""
        return self.pedal and self.state == "ENABLED" and self.runlevel == PEDAL_DOWN

    def command(self, word: str, now_ms: float) -> list[Order]:
        """A state command; what it asks of the robot. ValueError where CRTK has no such word."""
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
        """The operator steps on a pedal or off it: who is there drives, and does not while the
        clutch is held.
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
        """A servo command came."""
        self._servo_ms = self._word_ms = now_ms
        self._streams = True

    def word(self, now_ms: float) -> None:
        """Another command of motion came: a single one."""
        self._word_ms = now_ms
        self._streams = False

    def observe(
        self, runlevel: int, stopped: bool, connected: bool, now_ms: float, lost: bool = False
    ) -> None:
        """What the robot is in now, and whether anybody could command it. lost: nothing is heard
        of it.
        """
        was_stopped = self._stopped or self.runlevel == E_STOP
        if lost and not self._lost:
            self._release("lost")  # who had not enabled it has not to anew once it is heard again
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
