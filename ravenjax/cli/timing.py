"""Measures how late ticks start on this machine, in an empty loop and in a training session."""

import tempfile
from pathlib import Path

from ravenjax.train import launch, scenario
from ravenjax.train.protocol import Say
from ravenjax.train.realtime import clock

COLUMNS = (
    "loop",
    "compute, us: p50 / p99 / p99.9",
    "with judge and log",
    "lateness, us",
    "late ticks",
    "of",
)
MAX_TICK_US = 100
"""Time within which 99.9 % of ticks should be computed, us."""
SCENARIO = "first_steps"
EMPTY, SESSION = "empty", "session"


def measure_timing(seconds: float, say: Say) -> dict[str, clock.LoopTiming]:
    """Measure the ticks of an empty loop and of a training session, for `seconds` each, and return
    the timings by the names EMPTY and SESSION. The session has recorder and page, and a simulated
    operator moves the robot. say: prints a line.
    """
    # More targets than the operator can reach, so that the task does not end the session early.
    chosen = scenario.load_scenario(SCENARIO, [f"duration_s={seconds}", "task.targets=1000"])
    say(f"{EMPTY}: {seconds:g} s")
    with clock.use_realtime_priority(), clock.no_collection():
        loop_clock = clock.Clock()
        for _ in range(round(seconds * 1000)):
            loop_clock.wait()
            loop_clock.done()
    measured = {EMPTY: loop_clock.timing}
    say(f"{SESSION}: {seconds:g} s")
    with tempfile.TemporaryDirectory() as folder:
        options = launch.SessionOptions(
            scenario=chosen, folder=Path(folder) / "timed", seed=0, script="none"
        )
        finished = launch.run_realtime(options, linger_s=0.0, say=lambda _: None)
        assert finished.timing is not None
        measured[SESSION] = finished.timing
    return measured


def timing_row(loop: str, timing: clock.LoopTiming) -> tuple[str, ...]:
    """Return the measured values of one loop as a row of a table with the columns `COLUMNS`."""
    percentiles = [
        " / ".join(f"{timing.percentile(duration, share):.0f}" for share in (0.5, 0.99, 0.999))
        for duration in ("compute", "whole", "lateness")
    ]
    # The empty loop has no judge and no log, so it has no time "with judge and log".
    if not timing.whole.any():
        percentiles[1] = ""
    return (loop, *percentiles, f"{timing.late}", f"{timing.ticks}")


def timing_verdict(measured: dict[str, clock.LoopTiming]) -> list[tuple[str, str]]:
    """Return (state, sentence) for each requirement; state is "ok" if the loop meets it."""
    empty, session = measured[EMPTY], measured[SESSION]
    slowest_us = session.percentile("compute", 0.999)
    # Late ticks that the machine itself causes: the session has as large a share as the empty loop.
    expected_late = empty.late / empty.ticks * session.ticks
    # Three standard deviations of a Poisson count, of at least 1, are allowed in addition.
    allowed_late = expected_late + 3 * max(1.0, expected_late**0.5)
    return [
        (
            "ok" if slowest_us <= MAX_TICK_US else "slow",
            f"99.9 % of ticks take up to {slowest_us:.0f} us, expected at most {MAX_TICK_US} us",
        ),
        (
            "ok" if session.late <= allowed_late else "late",
            f"{session.late} of {session.ticks} ticks were late; of the empty loop {empty.late}",
        ),
    ]
