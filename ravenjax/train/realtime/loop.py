"""Runs a session in real time: one thread, one tick a millisecond. It waits only for the clock.

A training session and the session of `ravenjax robot` run in this loop.
"""

import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np

from ravenjax.store.ring import Ring, put_json, read_json
from ravenjax.train.protocol import PAUSED, Command, Event, Frame
from ravenjax.train.realtime import clock
from ravenjax.train.robot import Arms
from ravenjax.train.scenario import Scenario
from ravenjax.train.session.advance import Session
from ravenjax.train.session.console_arbiter import ConsoleArbiter, console_of

MAX_COMMANDS = 16
"""The largest number of commands taken in a tick. Further commands wait for the next tick."""
CONSOLE_COMMANDS = ("input", "increments", "seat")
"""Types of commands to which the loop adds the console that sent them."""
AFTER_END_MS = 200
"""Number of ticks after the end of a session, so that every process reads the end."""


class Console(Protocol):
    """A console: `poll` returns its new commands, `send_frame` sends the robot's frame to it."""

    def poll(self) -> list[Command]: ...
    def send_frame(self, frame: Frame) -> None: ...


class TickedSession(Protocol):
    """A session: `move` computes a tick's `frame`; `conclude` computes its events afterwards."""

    scenario: Scenario
    arms: Arms
    arbiter: ConsoleArbiter
    frame: Frame
    ticks: int

    @property
    def over(self) -> bool: ...
    def move(self, commands: list[Command]) -> None: ...
    def conclude(self) -> list[Event]: ...


@dataclasses.dataclass
class PageCommands:
    """Reads the commands that the page writes to its ring, and marks them as the page's."""

    ring: Ring
    drives: bool = True
    """False if a script drives, so that the page's hands and pedal are ignored."""
    _next = 0

    def poll(self) -> list[Command]:
        """Return the commands that have arrived, at most `MAX_COMMANDS`."""
        if self.ring.written == self._next:
            return []
        first, rows = self.ring.read(self._next, MAX_COMMANDS)
        self._next = first + len(rows)
        commands = []
        for command in read_json(rows):
            if command.get("type") not in CONSOLE_COMMANDS:
                commands.append(command)
            elif self.drives:
                commands.append({**command, "console": "page"})
        return commands

    def send_frame(self, frame: Frame) -> None:
        """Do nothing, because the page reads frames from a ring."""


def run_loop(
    session: TickedSession,
    consoles: list[Console],
    stopped: Callable[[], bool] = lambda: False,
    rings: tuple[Ring, Ring] | None = None,
    find_failure: Callable[[], str | None] = lambda: None,
) -> clock.LoopTiming:
    """Run `session` in real time until it is over, or `stopped` returns True. rings: receive frames
    and events; None: nobody reads them. find_failure: called once a second, returns a message if
    another process has failed. The first message becomes an event.
    """
    warmer = _CacheWarmer(session) if isinstance(session, Session) else None
    frame, places = session.frame, session.frame.layout.places
    row = frame.row.view(np.uint8)
    timing_places = slice(places["compute_us"].start, places["late_ticks"].stop)
    reported_late_ticks = ticks_after_end = ticks = 0
    failure = None
    with clock.no_collection():
        loop_clock = clock.Clock()
        timing = loop_clock.timing
        while ticks_after_end < AFTER_END_MS:
            loop_clock.wait(warmer and warmer.tick)
            commands = [command for console in consoles for command in console.poll()]
            if not session.over and stopped():
                commands.append({"type": "instructor", "do": "end", "by": "terminal"})
            frame.row[timing_places] = loop_clock.compute_us, loop_clock.lateness_us, timing.late
            session.move(commands)
            if rings:
                rings[0].put(row)
            for console in consoles:
                console.send_frame(frame)
            loop_clock.done()
            session_events = session.conclude()
            if warmer:
                warmer.set_commands(commands)
            if timing.late > reported_late_ticks and session.ticks % 100 == 0:
                reported_late_ticks = timing.late
                event = {"kind": "overrun", "late_ticks": reported_late_ticks}
                session_events.append({"tick": session.ticks, **event})
            ticks += 1
            if failure is None and ticks % 1000 == 0 and (failure := find_failure()):
                session_events.append({"tick": session.ticks, "kind": "trouble", "text": failure})
            if rings:
                for event in session_events:
                    put_json(rings[1], event)
            ticks_after_end += session.over
            loop_clock.rest()
    return timing


class _CacheWarmer:
    """A second session that computes a tick just before each real tick, to keep CPU caches warm.
    Without it, a tick takes two to three times as long, because the process sleeps between ticks.
    The second session gets the latest commands of the first. Nothing reads its results.
    """

    def __init__(self, session: Session):
        self._real_session = session
        self._second_session = Session(session.scenario, session.seed, ready=session.blueprint)
        self._commands: list[Command] = []

    def set_commands(self, commands: list[Command]) -> None:
        """Store the commands of this tick that move the hands. The second session repeats them in
        each tick until other commands arrive.
        """
        if commands:
            motions = [each for each in commands if each.get("type") in ("input", "increments")]
            owner = self._real_session.arbiter.owner
            driving = [each for each in motions if console_of(each) == owner]
            # The second session has one console, "script". It gets the commands of the console that
            # drives in the real session, or the first one if the driving console sent none.
            self._commands = [{**each, "console": "script"} for each in driving or motions[:1]]

    def tick(self) -> None:
        """Advance the second session, unless the first is paused: both must end together."""
        if not self._second_session.over and self._real_session.phase != PAUSED:
            self._second_session.tick(self._commands)
            self._second_session.command_lines.clear()
