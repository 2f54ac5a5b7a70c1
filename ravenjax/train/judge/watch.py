"""Judges a session tick by tick: reports events, and makes a row for each hazard.

`episode` explains the terms of a row. The operator can respond in these ways:

- `release`: the pedal comes up. This includes an operator who hands the console over or leaves. A
  pedal that comes up because the console fails is no release.
- `slow`: for a second, the hands move at less than a quarter of their usual speed.
- `restart`: the operator restarts a robot that does not follow.
- `stop`: the operator presses the E-stop button.
- `convert`: the operator sends a note that contains "convert", for example by the page's button.

A check that raises an alarm or stops the robot causes the event "alarm". While the check keeps
tripping, events "alarm_count" follow. Checks respond to a hazard in three ways: "stopped",
"flagged" and "limited". The first check that responds in one of these ways causes an event of that
name. Only the instructor sees this event.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ravenjax.outcomes import verdict
from ravenjax.train.judge.episode import COLUMNS, KNOWN_WHEN_ARMED, PEAKS, SEEN_MM, Episode
from ravenjax.train.protocol import Command, Frame, Json
from ravenjax.train.robot import ROBOT
from ravenjax.train.scenario import Armable, Scenario
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check

SLOW_SHARE = 0.25
"""Hands are slow below this share of their usual speed before the hazard (`stages.reaction`)."""
SLOW_FOR_MS = 1000
"""A slow-down counts only if it lasts this long without a break."""
MOVING_MM_S = 2.0
"""Hands below this speed, as tip motion, have no speed to reduce."""
# Rates of the running means of the usual and the present speed, 1/ms.
_USUAL, _PRESENT = 1.0 / 2000.0, 1.0 / 50.0
_QUICK, _SLOW_AT_STRIKE = -1, -2
QUIET_MS = 1000
"""A check that keeps tripping is announced again only after this time without a trip."""
CUE_QUIET_MS = 250
"""Time without force after which a new force counts as a new cue."""
COUNT_EVERY_MS = 1000
"""The shortest time between two events "alarm_count" of one check."""
_OF_MOTION = ("release", "slow")
"""Responses to a robot that moves. They do not count once the robot has halted on its own."""
_COMMON = (
    *("tick", "live", "fault_active", "pedal", "console_alive"),
    *("golden_cue", "halted_ms", "golden_halted_ms"),
)
_EVENTS = {
    "unintended": "unintended_motion",
    "loss": "loss_of_motion",
    "false_report": "false_report",
}
"""Event for each distance that exceeds the limit, named as in `ravenjax.outcomes.events`."""
SEEN = ("known", "unintended", "unintended_off", "loss")
"""Distances that a person may see: of the reported tip from the golden run's, and of the true tip.
"""


class Trip(NamedTuple):
    """A trip of a check since the last reading."""

    check: Check
    # ms of the session: exact for a check's first trip, otherwise the time of the reading.
    ms: int
    # Whether it has tripped more often so far than in the golden run.
    beyond_golden: bool
    announced: bool  # the first after `QUIET_MS` without one
    count: int  # in the session so far


class Trips:
    """Counts the trips of each check. Call `look` every few milliseconds."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._earlier: dict[str, int] = {}  # trips before the robot's last restart
        self._last: dict[str, int] = {}  # tick of each check's last trip

    def look(
        self, tick: int, robot_tick: int, outcomes: Json, golden: Json | None = None
    ) -> list[Trip]:
        """Return each check that tripped since the last reading, the earliest first.

        tick, robot_tick: ms of session and robot. outcomes, golden: `check_*` columns of robot and
        golden run so far. Without a golden run every trip counts.
        """
        trips = []
        for name in checks.check_names(outcomes):
            count, before = int(outcomes[f"check_{name}_count"]), self._counts.get(name, 0)
            self._counts[name] = count
            if count <= before:
                continue
            ms = tick
            if before == 0 and (first := int(outcomes.get(f"check_{name}_first_ms", -1))) >= 0:
                ms = tick - (robot_tick - first)
            usual = 0 if golden is None else int(golden[f"check_{name}_count"])
            announced = ms - self._last.get(name, -math.inf) > QUIET_MS
            total = self._earlier.get(name, 0) + count
            trips.append(Trip(ROBOT.check(name), ms, count > usual, announced, total))
            self._last[name] = tick
        return sorted(trips, key=lambda trip: trip.ms)

    def reset(self) -> None:
        for name, count in self._counts.items():
            self._earlier[name] = self._earlier.get(name, 0) + count
        self._counts = {}


class SlowdownDetector:
    """Running means of the hands' speed as tip motion, mm/s, both hands together.

    Hands also slow down where they arrive, so a slow-down counts only if it lasts longer than a tip
    is held at a target. Its time is that of its beginning.
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._before: list[float] | None = None
        self.usual = self.present = 0.0
        # mm/s; the hands are slow below this limit.
        self._limit = 0.0
        # The tick since which the hands are slow.
        self._since = _QUICK
        self.slowed = -1
        """Tick at which a lasting slow-down began; -1 without one."""

    def step(self, tick: int, hands: list[float]) -> None:
        """Take the hands' positions of a tick: um before scaling, three numbers a hand."""
        before, self._before = self._before, hands
        if before is None:
            return
        # um/ms is mm/s
        speed = self._scale * math.dist(hands, before)
        self.usual += _USUAL * (speed - self.usual)
        self.present += _PRESENT * (speed - self.present)
        if self.present >= self._limit:
            self._since, self.slowed = _QUICK, -1
        elif self._since == _QUICK:
            self._since = tick
        elif self._since >= 0 and tick - self._since >= SLOW_FOR_MS:
            self.slowed = self._since

    def strike(self) -> None:
        """Measure slow-downs against the usual speed before the hazard that becomes active now."""
        self._limit = SLOW_SHARE * self.usual if self.usual > MOVING_MM_S else 0.0
        self._since = _SLOW_AT_STRIKE if self.present < self._limit else _QUICK
        self.slowed = -1

    def jump(self) -> None:
        """Ignore the next step of the hands, because they were moved to another position."""
        self._before = None


class Judge:
    """The judge of one session."""

    def __init__(
        self,
        scenario: Scenario,
        hazards: Sequence[Armable],
        cue_on: bool,
        record: Callable[..., None],
    ) -> None:
        """record: receives the tick, the kind and the content of each event."""
        self.scenario, self.hazards = scenario, tuple(hazards)
        self.cue_on = cue_on
        """Whether the operator feels forces. The instructor may change it at any time."""
        self._tell = record
        self._episode: Episode | None = None
        self._over: list[Episode] = []
        self._trips = Trips()
        # Counts of trips not reported yet, and the tick of each check's last report.
        self._alarms: dict[str, int] = {}
        self._counted_at: defaultdict[str, int] = defaultdict(int)
        self._slowdown = SlowdownDetector(scenario.scale)
        self._columns: tuple[int, ...] = ()
        self._arms: tuple[_Arm, ...] = ()
        self._pedal = False
        # Whether the robot followed when the hazard became active, and the pedal is held since.
        self._was_down = False
        self._pressed = False  # whether the operator pressed the E-stop
        # Whether the operator has given the seat away or left, and nobody has driven since.
        self._walked = False
        self._live = False
        # The last ticks of session and robot.
        self._ticks = (0, 0)
        # Whether the cue has acted in the golden run since the activation.
        self._golden_cue = False
        # ms so far, of robot and golden run.
        self._halted = self._halted_at_strike = (0, 0)

    # --- calls of the session ---

    def armed(self, number: int, tick: int) -> None:
        """Begin an episode: a hazard is armed before this tick."""
        self.disarmed(tick)
        self._episode = Episode(self.hazards[number], self.scenario.harm, tick, self.cue_on)
        row = self._episode.row()
        known = {name: row[name] for name in KNOWN_WHEN_ARMED}
        self._tell(tick, "hazard_armed", number=number, row=known)

    def disarmed(self, tick: int) -> None:
        """End the episode of the present hazard, if there is one."""
        episode, self._episode = self._episode, None
        if episode is None:
            return
        self._over.append(episode)
        row = episode.row()
        names = ("number", "check_response", "motion_hazard", "halted", "outcome", "score")
        self._tell(tick, "hazard_over", **{name: row.get(name) for name in names})
        known = {name: value for name, value in row.items() if value is not None}
        self._tell(tick, "hazard_row", row=known)

    def restarted(self, tick: int) -> None:
        """Reset what depends on the robot, which was homed again without any fault."""
        self.disarmed(tick)
        self._trips.reset()
        self._slowdown.jump()
        self._pressed = False
        for arm in self._arms:
            arm.reset()

    def close(self, tick: int, reason: str = "end") -> None:
        for name, count in self._alarms.items():
            self._tell(tick, "alarm_count", check=name, count=count)
        self.interrupted(tick, reason)
        self.disarmed(tick)

    def lifted(self, tick: int, why: str) -> None:
        """Take a pedal that comes up without the operator's foot. It is not a release."""
        self._pedal = False
        if why != "silent" or not self._walked:
            self.interrupted(tick, why)

    def walked_away(self) -> None:
        """Take an operator who gives the seat away or leaves.

        The silence until the next pedal-down interrupts no hazard, so that leaving avoids no score.
        """
        self._walked = True

    def stood_by(self) -> None:
        """Reset the trips: a waiting robot, at rest and without a hazard, was restarted."""
        self._trips.reset()

    def command(self, message: Command, tick: int) -> None:
        """Take a command of the operator other than motion."""
        do = message.get("do")
        if do == "estop":
            self._pressed = True
            self._respond(tick, "stop")
        elif do == "restart" and not self._live:
            self._respond(tick, "restart")
        elif do == "note" and "convert" in str(message.get("text", "")).lower():
            self._respond(tick, "convert")

    def step(
        self, tick: int, frame: Frame, outcomes: Json | None = None, golden: Json | None = None
    ) -> None:
        """Judge one tick. outcomes, golden: see `look`; outcomes None: not read in this tick."""
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
        self._slowdown.step(tick, [x for arm in self._arms for x in row[arm.hand]])
        episode = self._episode
        if episode is not None and active and not episode.struck:
            self._was_down = was_live and self._pedal
            episode.struck_ms = tick
            self._slowdown.strike()
            self._pressed = self._golden_cue = False
            self._halted_at_strike = self._halted
            for arm in self._arms:
                # The depth at which the tip touches the tissue without the hazard.
                arm.depth_at_strike = max(row[arm.depth], 0.0)
            self._tell(tick, "hazard_struck", number=episode.hazard.number)
        self._halted = (int(halted[0]), int(halted[1]))
        self._golden_cue = self._golden_cue or golden_cue != 0.0
        if outcomes is not None:
            self.look(outcomes, golden)
        if self.cue_on and alive:
            self._feel(tick, row)
        if episode is not None and episode.struck:
            if not alive and not self._walked:
                self.interrupted(tick, "console")
            self._watch(tick, row, pedal, alive, episode)
        self._pedal = pedal != 0.0
        self._walked = self._walked and not self._pedal

    # --- rows and events ---

    def rows(self, **identity: Any) -> list[Json]:
        """Return a dict with the keys COLUMNS of each hazard. identity: of `recording.reader`."""
        episodes = self._over + ([] if self._episode is None else [self._episode])
        rows = [identity | episode.row() for episode in episodes]
        return [{column: row.get(column) for column in COLUMNS} for row in rows]

    def _struck_episode(self) -> Episode | None:
        return self._episode if self._episode is not None and self._episode.struck else None

    def look(self, outcomes: Json, golden: Json | None = None) -> None:
        """Record the trips of the robot's checks since the last reading.

        outcomes, golden: outcome columns of robot and golden run so far; golden None: there is no
        golden run. Call it before a hazard is disarmed, because the golden run restarts then.
        """
        tick, robot_tick = self._ticks
        episode = None if self._pressed else self._struck_episode()
        for trip in self._trips.look(tick, robot_tick, outcomes, golden):
            check, ms, is_first = trip.check, trip.ms, False
            if episode is not None and trip.beyond_golden:
                ms = max(ms, episode.struck_ms or 0)
                is_first = episode.trip(ms, check)
            is_told = check.response in verdict.TOLD
            is_new = is_first or trip.announced
            if is_told and not is_new and tick - self._counted_at[check.name] < COUNT_EVERY_MS:
                self._alarms[check.name] = trip.count
            elif is_told:
                self._counted_at[check.name] = tick
                self._alarms.pop(check.name, None)
                kind = "alarm" if is_new else "alarm_count"
                self._tell(tick, kind, check=check.name, count=trip.count)
            if episode is not None and is_first:
                number = episode.hazard.number
                self._tell(tick, check.response, number=number, check=check.name, ms=ms)
                if is_told:
                    self._know(tick, ms, check.name, episode)

    def _feel(self, tick: int, row: list[float]) -> None:
        episode = self._struck_episode()
        for arm in self._arms:
            if not any(row[arm.force]):
                continue
            if tick - arm.last_force > CUE_QUIET_MS:
                if episode is not None and episode.cue_ms is None and not self._golden_cue:
                    episode.feel(tick)
                number = -1 if episode is None or episode.cue_ms is None else episode.hazard.number
                self._tell(tick, "cue", number=number, arm=arm.name)
            arm.last_force = tick

    def _watch(
        self, tick: int, row: list[float], pedal: float, alive: float, episode: Episode
    ) -> None:
        for arm in self._arms:
            self._measure(tick, row, arm, episode)
        self._was_down = self._was_down and pedal != 0.0
        if self._was_down and not self._live and not episode.halted and not self._pressed:
            episode.halted = True
            self._know(tick, tick, "runlevel", episode)
        halted, golden_halted = (
            now - then for now, then in zip(self._halted, self._halted_at_strike, strict=True)
        )
        changed = halted != episode.halted_ms or golden_halted != episode.golden_halted_ms
        is_new = changed and not self._pressed and episode.halt(halted, golden_halted)
        if is_new and "loss" not in episode.first_ms:
            beyond, number = halted - golden_halted, episode.hazard.number
            self._tell(tick, _EVENTS["loss"], number=number, halted_ms=beyond)
        if self._pedal and not pedal and alive:
            self._respond(tick, "release")
        if pedal and self._live and self._slowdown.slowed >= 0:
            self._respond(tick, "slow", self._slowdown.slowed)

    def _measure(self, tick: int, row: list[float], arm: _Arm, episode: Episode) -> None:
        if episode.knowable_ms is None and any(row[place] >= SEEN_MM for place in arm.seen):
            self._know(tick, tick, "tip", episode)
        peaks, number = episode.peak_mm, episode.hazard.number
        for name, place in arm.distances:
            mm = row[place]
            # This is never true for NaN, which marks an unknown distance.
            if mm > peaks[name] and episode.exceed(tick, name, mm, arm.name):
                self._tell(tick, _EVENTS[name], number=number, arm=arm.name, mm=round(mm, 3))
        if not self._live:
            return
        unintended, depth = row[arm.unintended], row[arm.depth]
        if row[arm.error] > episode.peak_error_mm:
            episode.peak_error_mm = row[arm.error]
        if depth > episode.deepest_mm:
            episode.deepest_mm = depth
        # The fault drove the tip at most as deep as it moved it.
        episode.drive(tick, min(unintended, depth - arm.depth_at_strike))

    def _know(self, tick: int, at: int, by: str, episode: Episode) -> None:
        if episode.knowable_ms is None:
            episode.know(at, by)
            self._tell(tick, "knowable", number=episode.hazard.number, by=by, ms=at)

    def _respond(self, tick: int, what: str, at: int | None = None) -> None:
        """at: when the response began, if that was before this tick."""
        episode = self._struck_episode()
        if episode is None or (episode.halted and what in _OF_MOTION):
            return
        was_answered = episode.answer()[0] in episode.responses
        if not episode.respond(tick if at is None else at, what):
            return
        counts = not was_answered or episode.answer()[0] == what
        if counts and (what != "slow" or what in episode.hazard.right_response):
            ms, is_right = episode.reaction_ms(what), episode.right(what)
            number = episode.hazard.number
            self._tell(tick, "response", number=number, what=what, ok=is_right, ms=ms)

    def interrupted(self, tick: int, by: str) -> None:
        """Record that others cut off the active hazard, if it is not decided yet."""
        episode = self._episode
        if episode is not None and episode.interrupt(tick):
            self._tell(tick, "interrupted", number=episode.hazard.number, by=by)


class _Arm:
    def __init__(self, frame: Frame, name: str) -> None:
        places = frame.layout.places
        self.name = name

        def start(channel: str) -> int:
            return places[f"{name}/{channel}_mm"].start

        self.error, self.depth, self.unintended = map(start, ("error", "depth", "unintended"))
        self.seen = tuple(map(start, SEEN))
        self.distances = tuple((channel, start(channel)) for channel in PEAKS)
        self.force, self.hand = places[f"{name}/force"], places[f"{name}/hand"]
        self.reset()

    def reset(self) -> None:
        self.last_force = -CUE_QUIET_MS - 1
        self.depth_at_strike = 0.0
