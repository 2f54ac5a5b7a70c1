"""How well this machine keeps time: an empty loop, the compiled tick alone, and a session."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path

from ravenjax.train import launch, scenario
from ravenjax.train.realtime import clock
from ravenjax.train.realtime.clock import Clock, LoopTiming
from ravenjax.train.session import blueprint
from ravenjax.train.session.simulation import SimulatedRobot

COLUMNS = (
    "loop",
    "compute, us: p50 / p99 / p99.9",
    "with judge and log",
    "lateness, us",
    "late ticks",
    "of",
)
AIM_US = 100
"""p99.9 of a tick's compute time at most: a tenth of the cycle, so that a slower machine keeps
up too.
"""
SCENARIO = "first_steps"
TICK = "tick alone"


@dataclasses.dataclass(frozen=True)
class Measured:
    """One loop, for so many seconds."""

    loop: str
    timing: LoopTiming

    def row(self) -> tuple[str, ...]:
        """As `COLUMNS`."""
        timing = self.timing
        levels = {
            what: " / ".join(
                f"{timing.percentile(what, share):.0f}" for share in (0.5, 0.99, 0.999)
            )
            for what in ("compute", "whole", "lateness")
        }
        if not timing.whole.any():
            levels["whole"] = ""  # nothing follows
        return (self.loop, *levels.values(), f"{timing.late}", f"{timing.ticks}")


def measure(seconds: float, say: Callable[[str], None] = lambda _: None) -> list[Measured]:
    """The empty loop first and last; between them the compiled tick of the robot with nothing
    around it, and a session with its page and its recorder.

    The session is driven by commands that were recorded before, as many as a page sends.
    """
    setting = scenario.load(SCENARIO, [f"duration_s={seconds}", "task.targets=1000"])
    robot = SimulatedRobot(blueprint.make(scenario.campaign(setting, 0)))
    results = []
    for name, work in (("empty", lambda: None), (TICK, robot.step)):
        say(f"{name}: {seconds:g} s")
        results.append(Measured(name, _paced(seconds, work)))
    with tempfile.TemporaryDirectory() as place:
        driven = launch.SessionOptions(
            scenario=setting, folder=Path(place) / "driven", seed=0, script="none"
        )
        commands = launch.headless(driven).folder / launch.COMMANDS
        say(f"session: {seconds:g} s")
        driven = dataclasses.replace(driven, folder=Path(place) / "timed", script=str(commands))
        finished = launch.realtime(driven, linger_s=0.0, say=lambda _: None)
        assert finished.timing is not None
        results.append(Measured("session", finished.timing))
    return [*results, Measured("empty again", _paced(seconds, lambda: None))]


def verdict(measured: list[Measured]) -> list[tuple[str, str]]:
    """(state, sentence) of each thing that is asked for."""
    states = []
    for one in measured:
        if one.loop.startswith(("session", TICK)):
            slow = one.timing.percentile("compute", 0.999)
            sentence = f"99.9 % of ticks are computed within {slow:.0f} us, expected {AIM_US}"
            states.append(("ok" if slow <= AIM_US else "slow", f"{one.loop}: {sentence}"))
    idle = [one.timing for one in measured if one.loop.startswith("empty")]
    worst = max(timing.late / timing.ticks for timing in idle)
    empty = ", ".join(f"{timing.late}" for timing in idle)
    for one in measured:
        if one.loop.startswith("session"):
            late, ticks = one.timing.late, one.timing.ticks
            noise = 3 * max(1.0, (worst * ticks) ** 0.5)  # three standard deviations of a count
            sentence = f"{late} late ticks of {ticks}; the empty loops had {empty}"
            state = "ok" if late <= worst * ticks + noise else "late"
            states.append((state, f"{one.loop}: {sentence}"))
    return states


def _paced(seconds: float, work: Callable[[], None]) -> LoopTiming:
    with clock.realtime(), clock.no_collection():
        paced = Clock()
        for _ in range(round(seconds * 1000)):
            paced.wait()
            work()
            paced.done()
    return paced.timing
