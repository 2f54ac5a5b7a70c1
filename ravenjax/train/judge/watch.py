"""Watches a session tick by tick: reports what happens as events, and writes a row about each
hazard.

What the words of a row mean is in `episode`. Responses: `release`: the pedal comes up (not by a
dead console; also by an operator who gives the seat away or leaves); `slow`: the hands go at a
quarter of their speed, for a second (`pace`); `restart`: the operator restarts a robot that does
not follow; `stop`: the E-stop button; `convert`: a note that says "convert" (the page's button
sends one).

A check that tells a person or stops the robot is an event "alarm", for everybody, and while it
keeps tripping a count ("alarm_count"). The first check of each kind of response to the hazard at
work is an event of that name ("stopped", "flagged", "limited"), for the instructor's log: of
"limited" nobody else is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax.outcomes import verdict
from ravenjax.train.judge.episode import PEAKS, SEEN_MM, Episode
from ravenjax.train.judge.pace import Pace
from ravenjax.train.judge.row import COLUMNS
from ravenjax.train.judge.trips import Trip, Trips
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.scenario import Armable, Scenario

Event = dict[str, Any]

CUE_QUIET_MS = 250
"""A force that comes and goes around its threshold is one cue until it was away for so long."""
COUNT_EVERY_MS = 1000
"""At most so often it is told how many times a check has tripped that keeps tripping."""
_OF_MOTION = ("release", "slow")
"""Responses to a robot that moves: once it has halted by itself they avoid nothing and do not
count.
"""
_COMMON = (
    *("tick", "live", "fault_active", "pedal", "console_alive"),
    *("golden_cue", "halted_ms", "golden_halted_ms"),
)
_EVENTS = {
    "unintended": "unintended_motion",
    "loss": "loss_of_motion",
    "false_report": "false_report",
}
"""Event of each distance that exceeds the limit; names of `ravenjax.outcomes.events`."""


SEEN = ("known", "unintended", "unintended_off", "loss")
"""Distances that a person may see: of the reported tip from the golden run's, and of the true
one.
"""


class Judge:
    """The judge of one session."""

    def __init__(self, scenario: Scenario, hazards: Sequence[Armable], cue_on: bool) -> None:
        self.scenario, self.hazards = scenario, tuple(hazards)
        self.cue_on = cue_on
        """Whether forces are felt; the instructor may change it at any time."""
        self._episode: Episode | None = None
        self._over: list[Episode] = []
        self._trips = Trips()
        self._alarms: dict[str, int] = {}  # trips of checks that were not told of yet
        self._counted_at: dict[str, int] = {}  # tick in which a check was last told of
        self._pace = Pace(scenario.scale)
        self._columns: tuple[int, ...] = ()
        self._arms: tuple[_Arm, ...] = ()
        self._pedal = False
        self._was_down = (
            False  # the robot followed when the hazard struck, and the pedal is held since
        )
        self._pressed = False  # the operator pressed the E-stop
        self._walked = (
            False  # the operator has given the seat away or left, and nobody has driven since
        )
        self._live = False
        self._ticks = (0, 0)  # the last one, of session and robot
        self._golden_cue = False  # the cue has pulled in the golden run since the strike
        self._halted = (0, 0)  # ms so far, of robot and golden run
        self._halted_at_strike = (0, 0)

    # --- what the session reports ---

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
        self._trips.reset()
        self._pace.jump()
        self._pressed = False
        for arm in self._arms:
            arm.reset()
        return events

    def close(self, tick: int, reason: str = "end") -> list[Event]:
        """The session is over."""
        counts = [
            {"tick": tick, "kind": "alarm_count", "check": name, "count": count}
            for name, count in self._alarms.items()
        ]
        return [*counts, *self.interrupted(tick, reason), *self._close(tick)]

    def interrupted(self, tick: int, by: str) -> list[Event]:
        """Something that is not the operator's cuts the hazard at work off; one that is decided
        already stays so.
        """
        episode = self._episode
        if episode is None or not episode.interrupt(tick):
            return []
        return [{"tick": tick, "kind": "interrupted", "number": episode.hazard.number, "by": by}]

    def lifted(self, tick: int, why: str) -> list[Event]:
        """The pedal comes up before this tick, and not by the operator's foot: nobody has
        released it.
        """
        self._pedal = False
        return [] if why == "silent" and self._walked else self.interrupted(tick, why)

    def walked_away(self) -> None:
        """The operator gives the seat away or leaves: a pedal that was down is released, and that
        nobody is heard of until it is down again cuts nothing off. Else who does not know what to
        do would do that."""
        self._walked = True

    def stood_by(self) -> None:
        """A robot that waited, at rest and without a hazard, begins its waiting anew."""
        self._trips.reset()

    def command(self, message: Mapping[str, Any], tick: int) -> list[Event]:
        """What the operator does besides moving."""
        do = message.get("do")
        if do == "estop":
            self._pressed = True
            return self._respond(tick, "stop")
        if do == "restart" and not self._live:
            return self._respond(tick, "restart")
        if do == "note" and "convert" in str(message.get("text", "")).lower():
            return self._respond(tick, "convert")
        return []

    def step(
        self,
        tick: int,
        frame: Frame,
        outcomes: Mapping[str, Any] | None = None,
        golden: Mapping[str, Any] | None = None,
    ) -> list[Event]:
        """One tick. outcomes, golden: see `look`; outcomes None: not looked at in this tick."""
        if not self._columns:
            places = frame.layout.places
            self._columns = tuple(places[name].start for name in _COMMON)
            self._arms = tuple(_Arm(frame, name) for name in frame.layout.arms)
        row = frame.numbers
        robot_tick, live, active, pedal, alive, golden_cue, *halted = [
            row[i] for i in self._columns
        ]
        was_live, self._ticks = self._live, (tick, int(robot_tick))
        self._live = live != 0.0
        self._pace.step(tick, [x for arm in self._arms for x in row[arm.hand]])
        events: list[Event] = []
        episode = self._episode
        if episode is not None and active and not episode.struck:
            self._was_down = was_live and self._pedal
            self._strike(tick, row, episode, events)
        self._halted = (int(halted[0]), int(halted[1]))
        self._golden_cue = self._golden_cue or golden_cue != 0.0
        if outcomes is not None:
            events += self.look(outcomes, golden)
        self._feel(tick, row, alive, events)
        if episode is not None and episode.struck:
            if not alive and not self._walked:
                events += self.interrupted(tick, "console")
            self._watch(tick, row, pedal, alive, episode, events)
        self._pedal = pedal != 0.0
        self._walked = self._walked and not self._pedal
        return events

    def look(
        self, outcomes: Mapping[str, Any], golden: Mapping[str, Any] | None = None
    ) -> list[Event]:
        """What the robot's checks did since the last look.

        outcomes, golden: columns of a campaign, of robot and golden run until the last tick; golden
        None: there is none. To be called before a hazard is taken back, too: the golden run begins
        anew then.
        """
        events: list[Event] = []
        tick, robot_tick = self._ticks
        episode = (
            self._episode
            if self._episode is not None and self._episode.struck and not self._pressed
            else None
        )
        for trip in self._trips.look(tick, robot_tick, outcomes, golden):
            check, ms = trip.check, trip.ms
            if episode is not None and trip.beyond_golden:
                ms = max(ms, episode.struck_ms or 0)
            first = episode is not None and trip.beyond_golden and episode.trip(ms, check)
            tells = check.response in verdict.TOLD
            if tells:
                events += self._tell_alarm(tick, trip, first or trip.announced)
            if episode is not None and first:
                number = episode.hazard.number
                events.append(
                    {
                        "tick": tick,
                        "kind": check.response,
                        "number": number,
                        "check": check.name,
                        "ms": ms,
                    }
                )
                if tells:
                    self._know(tick, ms, check.name, episode, events)
        return events

    def _tell_alarm(self, tick: int, trip: Trip, anew: bool) -> list[Event]:
        """A check that keeps tripping is told once, and then how often, at most once a second."""
        name, count = trip.check.name, trip.count
        self._alarms[name] = count
        if not anew and tick - self._counted_at.get(name, 0) < COUNT_EVERY_MS:
            return []
        self._counted_at[name] = tick
        del self._alarms[name]
        return [
            {
                "tick": tick,
                "kind": "alarm" if anew else "alarm_count",
                "check": name,
                "count": count,
            }
        ]

    # --- what it makes of it ---

    def rows(self, **identity: Any) -> list[dict[str, Any]]:
        """A dict a hazard so far, keys as COLUMNS; identity: session, participant, group, seed.
        None is empty.
        """
        same = {
            "scenario": self.scenario.name,
            "seed": self.scenario.seed,
            "blinded": self.scenario.cue.blinded,
        } | identity
        episodes = self._over + ([] if self._episode is None else [self._episode])
        return [
            {column: (same | episode.row()).get(column) for column in COLUMNS}
            for episode in episodes
        ]

    def result(self) -> dict[str, Any]:
        """Numbers of the whole session."""
        rows = self.rows()
        scores = [row["score"] for row in rows if row["score"] is not None]
        reactions = sorted(
            row["reaction_ms"]
            for row in rows
            if row["response_ok"] and row["reaction_ms"] is not None
        )
        outcomes = [row["outcome"] for row in rows]
        return {
            "hazards": len(rows),
            "struck": sum(row["struck_ms"] is not None for row in rows),
            "outcomes": {word: outcomes.count(word) for word in dict.fromkeys(outcomes)},
            "check_responses": _counts(verdict.RESPONSES, [row["check_response"] for row in rows]),
            "motion_hazards": _counts(verdict.HAZARDS, [row["motion_hazard"] for row in rows]),
            "right_responses": sum(bool(row["response_ok"]) for row in rows),
            "median_reaction_ms": reactions[len(reactions) // 2] if reactions else None,
            "score": round(sum(scores) / len(scores), 1) if scores else None,
        }

    def _strike(self, tick: int, row: list[float], episode: Episode, events: list[Event]) -> None:
        episode.struck_ms = tick
        self._pace.strike()
        self._pressed = self._golden_cue = False
        self._halted_at_strike = self._halted
        for arm in self._arms:
            arm.strike(row)
        events.append({"tick": tick, "kind": "hazard_struck", "number": episode.hazard.number})

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
                first = episode is not None and episode.cue_ms is None
                if episode is not None and first and not self._golden_cue:
                    episode.feel(tick)
                number = -1 if episode is None or episode.cue_ms is None else episode.hazard.number
                events.append({"tick": tick, "kind": "cue", "number": number, "arm": arm.name})
            arm.last_force = tick

    def _watch(
        self,
        tick: int,
        row: list[float],
        pedal: float,
        alive: float,
        episode: Episode,
        events: list[Event],
    ) -> None:
        """The hazard at work: what it does, what can be known of it, and hands and foot."""
        for arm in self._arms:
            self._measure(tick, row, arm, episode, events)
        self._was_down = self._was_down and pedal != 0.0
        if self._was_down and not self._live and not episode.halted and not self._pressed:
            episode.halted = True
            self._know(tick, tick, "runlevel", episode, events)
        own = self._halted[0] - self._halted_at_strike[0]
        golden = self._halted[1] - self._halted_at_strike[1]
        changed = own != episode.halted_ms or golden != episode.golden_halted_ms
        if (
            changed
            and not self._pressed
            and episode.halt(own, golden)
            and "loss" not in episode.first_ms
        ):
            number = episode.hazard.number
            events.append(
                {"tick": tick, "kind": _EVENTS["loss"], "number": number, "halted_ms": own - golden}
            )
        if self._pedal and not pedal and alive:
            events += self._respond(tick, "release")
        if pedal and self._live and self._pace.slowed >= 0:
            events += self._respond(tick, "slow", self._pace.slowed)

    def _measure(
        self, tick: int, row: list[float], arm: _Arm, episode: Episode, events: list[Event]
    ) -> None:
        if episode.knowable_ms is None and any(row[place] >= SEEN_MM for place in arm.seen):
            self._know(tick, tick, "tip", episode, events)
        peaks, number = episode.peak_mm, episode.hazard.number
        for name, place in arm.distances:
            mm = row[place]
            if mm > peaks[name] and episode.exceed(
                tick, name, mm, arm.name
            ):  # never for NaN: not known
                events.append(
                    {
                        "tick": tick,
                        "kind": _EVENTS[name],
                        "number": number,
                        "arm": arm.name,
                        "mm": round(mm, 3),
                    }
                )
        if not self._live:
            return
        unintended, depth = row[arm.unintended], row[arm.depth]
        if row[arm.error] > episode.peak_error_mm:
            episode.peak_error_mm = row[arm.error]
        if depth > episode.deepest_mm:
            episode.deepest_mm = depth
        # the fault drove the tip no deeper than it moved it
        episode.drive(tick, min(unintended, depth - arm.depth_at_strike))

    def _know(self, tick: int, at: int, by: str, episode: Episode, events: list[Event]) -> None:
        if episode.knowable_ms is None:
            episode.know(at, by)
            events.append(
                {
                    "tick": tick,
                    "kind": "knowable",
                    "number": episode.hazard.number,
                    "by": by,
                    "ms": at,
                }
            )

    def _respond(self, tick: int, what: str, at: int | None = None) -> list[Event]:
        """at: when it began, where that is before this tick."""
        episode = self._episode
        if episode is None or not episode.struck or (episode.halted and what in _OF_MOTION):
            return []
        settled = episode.answer()[0] in episode.responses
        if not episode.respond(tick if at is None else at, what) or (
            settled and episode.answer()[0] != what
        ):
            return []
        if what == "slow" and what not in episode.hazard.right_response:
            return []
        facts = {"number": episode.hazard.number, "what": what, "ok": episode.right(what)}
        return [{"tick": tick, "kind": "response", **facts, "ms": episode.reaction_ms(what)}]

    def _close(self, tick: int) -> list[Event]:
        episode, self._episode = self._episode, None
        if episode is None:
            return []
        self._over.append(episode)
        row = episode.row()
        words = {
            name: row.get(name)
            for name in ("check_response", "motion_hazard", "halted", "outcome", "score")
        }
        return [{"tick": tick, "kind": "hazard_over", "number": episode.hazard.number, **words}]


def _counts(words: Sequence[str], values: Sequence[str | None]) -> dict[str, int]:
    """How often each word occurs, those that do not occur left out."""
    return {word: values.count(word) for word in words if word in values}


class _Arm:
    """Where an arm's numbers stand in a row, and what is remembered of it."""

    __slots__ = (
        *("depth", "depth_at_strike", "distances", "error", "force", "hand", "last_force", "name"),
        *("seen", "unintended"),
    )

    def __init__(self, frame: Frame, name: str) -> None:
        places = frame.layout.places
        self.name = name
        self.error, self.depth, self.unintended = (
            places[f"{name}/{channel}_mm"].start for channel in ("error", "depth", "unintended")
        )
        self.seen = tuple(places[f"{name}/{channel}_mm"].start for channel in SEEN)
        self.distances = tuple((channel, places[f"{name}/{channel}_mm"].start) for channel in PEAKS)
        self.force, self.hand = (places[f"{name}/{channel}"] for channel in ("force", "hand"))
        self.reset()

    def reset(self) -> None:
        """The robot begins anew."""
        self.last_force = -CUE_QUIET_MS - 1
        self.depth_at_strike = 0.0

    def strike(self, row: list[float]) -> None:
        """The tissue as it is touched without the hazard."""
        self.depth_at_strike = max(row[self.depth], 0.0)
