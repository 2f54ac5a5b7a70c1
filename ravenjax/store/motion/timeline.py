"""Computes, for each tick of a run, the row of a recording and whether the pedal is down."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.motions import MOTION_S, PEDAL_DOWN_S
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.vocabulary import TICK_S

RUN_UP_S = 0.5
"""Time from rest to full speed of the replay, and from full speed to rest, s."""

SLOWEST = 100.0
"""Largest permitted value of the option `slow_down`."""

REST_TICKS, RUN_UP_TICKS = round(MOTION_S / TICK_S), round(RUN_UP_S / TICK_S)


class Timeline(NamedTuple):
    """The replayed row of the recording, and the state of the pedal, in each tick (1 ms)."""

    row: np.ndarray  # [ticks] fractional row of the recording, counted from the first replayed row
    pedal: np.ndarray  # [ticks] 1 down, 0 up; the pedal is up before the motion begins
    # Time at which the recording ended and the hands stopped or reversed, s; None: it did not end.
    end_s: float | None
    turns: int  # number of reversals of the replay direction


def natural_ticks(rows: int, slow_down: float) -> int:
    """Return the number of ticks that replay `rows` rows once, without slowing down at the end."""
    steady = math.floor((rows - 1 - _ramp(slow_down)[-1]) * slow_down)
    return REST_TICKS + RUN_UP_TICKS + max(0, steady)


def make_timeline(path: Path, rows: int, ticks: int | None, options: ReplayOptions) -> Timeline:
    """Return the timeline for replaying `rows` rows in `ticks` ms; None: until the rows end. Raise
    UserError if the rows end earlier and the options do not state what the hands do then.
    """
    slow_down, natural = options.slow_down, natural_ticks(rows, options.slow_down)
    ticks = natural if ticks is None else ticks
    if ticks <= REST_TICKS:
        raise UserError(
            f"{path}: the campaign ends after {ticks * TICK_S:g} s, but the hands rest for the"
            f" first {MOTION_S:g} s, so nothing would move. Write a longer campaign.duration_s"
        )
    pedal = (np.arange(ticks) >= round(PEDAL_DOWN_S / TICK_S)).astype(float)
    if ticks <= natural:
        run_up = _ramp(slow_down)
        steady_ticks = np.arange(1, natural - REST_TICKS - RUN_UP_TICKS + 1)
        steady = run_up[-1] + steady_ticks / slow_down
        row = np.concatenate([np.zeros(REST_TICKS), run_up, steady])[:ticks]
        return Timeline(np.minimum(row, rows - 1), pedal, None, 0)
    if options.at_end == "refuse":
        # In the run-up, the mean speed is half of the full speed. The ratio is rounded up to 0.01.
        ticks_at_full_speed = ticks - REST_TICKS - RUN_UP_TICKS / 2 + 1
        slower = math.ceil(ticks_at_full_speed / (rows - 1) * 100) / 100
        raise UserError(
            f"{path}: the replay ends after {natural * TICK_S:.3f} s ({rows * TICK_S:.3f} s of the"
            f" recording, with {MOTION_S:g} s of rest and {RUN_UP_S:g} s of acceleration), but the"
            f" campaign lasts {ticks * TICK_S:g} s. Write campaign.duration_s ="
            f" {natural * TICK_S:.3f} or less, operator.at_end = "
            '"hold" (the hands slow down and rest) or "reverse" (backwards and forwards again)'
            + (f", or operator.slow_down = {slower:g}" if slower <= SLOWEST else "")
        )
    forwards = _rest_to_rest(rows - 1, slow_down)
    end = REST_TICKS + len(forwards)
    turns = max(0, math.ceil((ticks - end) / len(forwards))) if options.at_end == "reverse" else 0
    passes = (forwards[::-1] if turn % 2 else forwards for turn in range(turns + 1))
    row = np.concatenate([np.zeros(REST_TICKS), *passes])
    # The hands rest in the last row until the campaign ends.
    row = np.pad(row, (0, max(0, ticks - len(row))), "edge")[:ticks]
    return Timeline(np.clip(row, 0.0, rows - 1), pedal, end * TICK_S, turns)


def _ramp(slow_down: float, ticks: int = RUN_UP_TICKS) -> np.ndarray:
    """Return how many rows [ticks] were replayed after each tick of a run-up, with fractions.

    Full speed is 1 / slow_down rows per tick. After a fraction x of the run-up, the speed is 10 x^3
    - 15 x^4 + 6 x^5 of full speed, and the rows are the integral of the speed.
    """
    fraction = np.arange(1, ticks + 1) / ticks
    return ticks / slow_down * fraction**4 * (2.5 - 3.0 * fraction + fraction**2)


def _rest_to_rest(rows: int, slow_down: float) -> np.ndarray:
    """Return the fractional row after each tick from rest in row 0 to rest in row `rows`. The
    motion accelerates to 1 / slow_down rows per tick, continues at this speed and slows down.
    """
    up = _ramp(slow_down, min(RUN_UP_TICKS, max(1, math.floor(rows * slow_down))))
    # Few rows do not suffice for full speed: half of them are for the acceleration.
    up *= min(1.0, rows / 2.0 / up[-1])
    steady_rows = rows - 2.0 * up[-1]
    # Without the 1e-9, a rounding error could add a tick.
    ticks = math.ceil(steady_rows * slow_down - 1e-9)
    steady = up[-1] + steady_rows * np.arange(1, ticks + 1) / max(1, ticks)
    # The hands slow down as they accelerated, in reverse order. The last row is `rows`.
    down = rows - np.concatenate([up[:-1][::-1], [0.0]])
    return np.concatenate([up, steady, down])
