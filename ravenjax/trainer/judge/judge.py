"""Watches a session tick by tick: tells what happens as events, and writes a row about each hazard.

What the words of a row mean is in `episode`. Responses: `release`: the pedal comes up (not by a dead console);
`slow`: the hands go at a quarter of their speed, for a second (`pace`); `restart`: the operator restarts a robot that
does not follow; `stop`: the E-stop button; `convert`: a note that says "convert" (the page's button sends one).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax.trainer.frame import Frame
from ravenjax.trainer.judge.alarms import Alarms
from ravenjax.trainer.judge.episode import COLUMNS, KNOWN_MM, Episode
from ravenjax.trainer.judge.pace import Pace
from ravenjax.trainer.scenario import Armable, Scenario

Event = dict[str, Any]

CUE_QUIET_MS = 250
"""A force that comes and goes around its threshold is one cue until it was away for so long."""
_PEDAL_DOWN = 3
_OF_MOTION = ("release", "slow")
"""Responses to a robot that moves: once it has stopped by itself they avoid nothing and do not count."""
_COMMON = ("tick", "runlevel", "soft_estopped", "fault_active", "pedal", "console_alive")


class Judge:
    """The judge of one session."""

    def __init__(self, scenario: Scenario, hazards: Sequence[Armable], cue_on: bool) -> None:
        self.scenario, self.hazards = scenario, tuple(hazards)
        self.cue_on = cue_on
        """Whether forces are felt; the instructor may change it at any time."""
        self._episode: Episode | None = None
        self._over: list[Episode] = []
        self._alarms = Alarms()
        self._pace = Pace(scenario.scale)
        self._columns: tuple[int, ...] = ()
        self._arms: tuple[_Arm, ...] = ()
        self._pedal = False
        self._was_down = False  # the robot followed when the hazard struck, and the pedal is held since
        self._pressed = False  # the operator pressed the E-stop
        self._down = False  # the robot follows
        self._threshold_mm = scenario.cue.threshold_mm

    # --- what the session tells ---

    def armed(self, number: int, tick: int) -> list[Event]:
        """A hazard is let loose before this tick."""
        events = self._close(tick)
        self._episode = Episode(self.hazards[number], self.scenario.harm, tick, self.cue_on)
        return [*events, {"tick": tick, "kind": "hazard_armed", "number": number}]

    def disarmed(self, tick: int) -> list[Event]:
        """The hazard is taken back."""
        return self._close(tick)

    def restarted(self, tick: int) -> list[Event]:
        """The robot was homed again, without any fault."""
        events = self._close(tick)
        self._alarms.reset()
        self._pace.jump()
        self._pressed = False
        for arm in self._arms:
            arm.reset()
        return events

    def close(self, tick: int) -> list[Event]:
        """The session is over."""
        return self._close(tick)

    def command(self, message: Mapping[str, Any], tick: int) -> list[Event]:
        """What the operator does besides moving."""
        do = message.get("do")
        if do == "estop":
            self._pressed = True
            return self._respond(tick, "stop")
        if do == "restart" and not self._down:
            return self._respond(tick, "restart")
        if do == "note" and "convert" in str(message.get("text", "")).lower():
            return self._respond(tick, "convert")
        return []

    def step(self, tick: int, frame: Frame, outcomes: Mapping[str, Any] | None = None) -> list[Event]:
        """One tick. outcomes: of the robot so far, as a campaign's columns; None: not looked at in this tick."""
        if not self._columns:
            places = frame.layout.places
            self._columns = tuple(places[name].start for name in _COMMON)
            self._arms = tuple(_Arm(frame, name) for name in frame.layout.arms)
        row = frame.numbers
        robot_tick, runlevel, estopped, active, pedal, alive = [row[i] for i in self._columns]
        was_down = self._down
        self._down = runlevel == _PEDAL_DOWN and not estopped
        self._pace.step(tick, [x for arm in self._arms for x in row[arm.hand]])
        events: list[Event] = []
        episode = self._episode
        if episode is not None and active and not episode.struck:
            self._was_down = was_down and self._pedal
            self._strike(tick, row, episode, events)
        if outcomes is not None:
            self._look(tick, int(robot_tick), outcomes, events)
        self._feel(tick, row, alive, events)
        if episode is not None and episode.struck:
            self._watch(tick, row, pedal, alive, episode, events)
        self._pedal = pedal != 0.0
        return events

    # --- what it makes of it ---

    def rows(self, **identity: Any) -> list[dict[str, Any]]:
        """A dict a hazard so far, keys as COLUMNS; identity: session, participant, group, seed. None is empty."""
        same = {
            "scenario": self.scenario.name,
            "seed": self.scenario.seed,
            "blinded": self.scenario.cue.blinded,
        } | identity
        episodes = self._over + ([] if self._episode is None else [self._episode])
        return [{column: (same | episode.row()).get(column) for column in COLUMNS} for episode in episodes]

    def result(self) -> dict[str, Any]:
        """Numbers of the whole session."""
        rows = self.rows()
        scores = [row["score"] for row in rows if row["score"] is not None]
        reactions = sorted(row["reaction_ms"] for row in rows if row["response_ok"] and row["reaction_ms"] is not None)
        outcomes = [row["outcome"] for row in rows]
        return {
            "hazards": len(rows),
            "struck": sum(row["struck_ms"] is not None for row in rows),
            "outcomes": {word: outcomes.count(word) for word in dict.fromkeys(outcomes)},
            "right_responses": sum(bool(row["response_ok"]) for row in rows),
            "median_reaction_ms": reactions[len(reactions) // 2] if reactions else None,
            "score": round(sum(scores) / len(scores), 1) if scores else None,
        }

    def _strike(self, tick: int, row: list[float], episode: Episode, events: list[Event]) -> None:
        episode.struck_ms = tick
        self._pace.strike()
        self._pressed = False
        for arm in self._arms:
            arm.strike(row)
        events.append({"tick": tick, "kind": "hazard_struck", "number": episode.hazard.number})

    def _look(self, tick: int, robot_tick: int, outcomes: Mapping[str, Any], events: list[Event]) -> None:
        """The robot's checks."""
        episode = self._episode
        for check, at, tell in self._alarms.look(tick, robot_tick, outcomes):
            if tell:
                events.append({"tick": tick, "kind": "alarm", "check": check})
            if episode is not None and episode.struck_ms is not None and episode.alarm_ms is None and not self._pressed:
                episode.alarmed(max(at, episode.struck_ms), check)
                self._know(tick, max(at, episode.struck_ms), check, episode, events)

    def _feel(self, tick: int, row: list[float], alive: float, events: list[Event]) -> None:
        """Forces of the cue, where they are felt."""
        if not (self.cue_on and alive):
            return
        episode = self._episode if self._episode is not None and self._episode.struck else None
        for arm in self._arms:
            x, y, z = row[arm.force]
            if not (x or y or z):
                continue
            if tick - arm.last_force > CUE_QUIET_MS:
                number = -1 if episode is None else episode.hazard.number
                events.append({"tick": tick, "kind": "cue", "number": number, "arm": arm.name})
                if episode is not None and episode.cue_ms is None:
                    episode.feel(tick)
            arm.last_force = tick

    def _watch(
        self, tick: int, row: list[float], pedal: float, alive: float, episode: Episode, events: list[Event]
    ) -> None:
        """The hazard at work: what it does, what can be known of it, and hands and foot."""
        for arm in self._arms:
            self._measure(tick, row, arm, episode, events)
        self._was_down = self._was_down and pedal != 0.0
        if self._was_down and not self._down and not episode.stopped and not self._pressed:
            episode.stopped = True
            self._know(tick, tick, "runlevel", episode, events)
        if self._pedal and not pedal and alive:
            events += self._respond(tick, "release")
        if pedal and self._down and self._pace.slowed >= 0:
            events += self._respond(tick, "slow", self._pace.slowed)

    def _measure(self, tick: int, row: list[float], arm: _Arm, episode: Episode, events: list[Event]) -> None:
        stray, depth = arm.strayed(row, self._down), row[arm.depth]
        if row[arm.known] > KNOWN_MM:
            self._know(tick, tick, "tip", episode, events)
        if self._down and row[arm.error] > episode.peak_error_mm:
            episode.peak_error_mm = row[arm.error]
        if stray > episode.peak_stray_mm:
            episode.peak_stray_mm = stray
            if not episode.hazard.arm:
                episode.arm = arm.name
        if self._down and depth > episode.deepest_mm:
            episode.deepest_mm = depth
        if self._down:
            # the fault drove the tip no deeper than it took it astray
            episode.driven_mm = max(episode.driven_mm, min(stray, depth - arm.depth_at_strike))
        if stray > self._threshold_mm and not episode.strayed:
            episode.strayed = True
            number = episode.hazard.number
            events.append({"tick": tick, "kind": "stray", "number": number, "arm": arm.name, "mm": round(stray, 3)})

    def _know(self, tick: int, at: int, by: str, episode: Episode, events: list[Event]) -> None:
        if episode.knowable_ms is None:
            episode.know(at, by)
            events.append({"tick": tick, "kind": "knowable", "number": episode.hazard.number, "by": by})

    def _respond(self, tick: int, what: str, at: int | None = None) -> list[Event]:
        """at: when it began, where that is before this tick."""
        episode = self._episode
        if episode is None or not episode.struck or (episode.stopped and what in _OF_MOTION):
            return []
        settled = episode.answer()[0] in episode.responses
        if not episode.respond(tick if at is None else at, what) or (settled and episode.answer()[0] != what):
            return []
        if what == "slow" and what not in episode.hazard.right_response:
            return []
        told = {"number": episode.hazard.number, "what": what, "ok": episode.right(what)}
        return [{"tick": tick, "kind": "response", **told, "ms": episode.reaction_ms(what)}]

    def _close(self, tick: int) -> list[Event]:
        episode, self._episode = self._episode, None
        if episode is None:
            return []
        self._over.append(episode)
        told = {"number": episode.hazard.number, "outcome": episode.outcome(), "score": episode.score()}
        return [{"tick": tick, "kind": "hazard_over", **told}]


class _Arm:
    """Where an arm's numbers stand in a row, and what is remembered of it."""

    __slots__ = (
        *("depth", "depth_at_strike", "error", "force", "hand", "known", "last_force", "name", "stray", "tip"),
        *("_stray_followed", "_tip_followed"),
    )

    def __init__(self, frame: Frame, name: str) -> None:
        places = frame.layout.places
        self.name = name
        self.error, self.depth, self.stray, self.known = (
            places[f"{name}/{channel}"].start for channel in ("error_mm", "depth_mm", "stray_mm", "known_mm")
        )
        self.force, self.hand, self.tip = (places[f"{name}/{channel}"] for channel in ("force", "hand", "tip"))
        self.reset()

    def reset(self) -> None:
        """The robot begins anew."""
        self.last_force = -CUE_QUIET_MS - 1
        self.depth_at_strike = 0.0
        self._stray_followed = 0.0
        self._tip_followed: list[float] | None = None

    def strike(self, row: list[float]) -> None:
        """The tissue as it is touched without the hazard."""
        self.depth_at_strike = max(row[self.depth], 0.0)
        self._stray_followed, self._tip_followed = 0.0, row[self.tip]

    def strayed(self, row: list[float], follows: bool) -> float:
        """How far the true tip is astray, mm.

        A robot that no longer follows stands while its fault-free twin goes on with the hand: from then on only its own
        way counts, since it last followed.
        """
        stray = row[self.stray]
        if follows or self._tip_followed is None:
            self._stray_followed, self._tip_followed = stray, row[self.tip]
            return stray
        return min(stray, self._stray_followed + 1e3 * math.dist(row[self.tip], self._tip_followed))
