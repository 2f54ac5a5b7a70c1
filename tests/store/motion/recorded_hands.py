"""Made-up recordings of hands near the home tips, and what a motion of them does."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.errors import UserError
from ravenjax.robots.raven2.geometry import limits
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.store.motion import replay
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.reach import Bounds

HOME_MM = np.array([-77.946997893, -25.265555299, 13.225627957])  # gold's tip at home, frame 0
ROWS = 3000
PER_MM = {"um": 1e3, "mm": 1.0, "m": 1e-3}


def circle(time_s):
    """mm from home: once round in 3 s, 6 by 20 mm."""
    phase = 2.0 * np.pi * np.asarray(time_s) / 3.0
    return np.stack([3.0 * (1.0 - np.cos(phase)), 10.0 * np.sin(phase), 0.0 * phase], axis=1)


def table(time_s, path=circle, unit="um", arms=("gold",)):
    """Positions at these times, without a time column; green mirrored."""
    columns = {}
    for arm in arms:
        place = (
            (HOME_MM + path(time_s)) * ([1, 1, 1] if arm == "gold" else [1, -1, 1]) * PER_MM[unit]
        )
        columns |= {f"{arm}_{axis}_{unit}": place[:, i] for i, axis in enumerate("xyz")}
    return pd.DataFrame(columns)


def recording(unit="um", arms=("gold",), rows=ROWS):
    """A slow circle, a row a millisecond, with its times."""
    time_s = np.arange(rows) * 1e-3
    return table(time_s, unit=unit, arms=arms).assign(time_s=time_s)


def play(path, arms=("gold",), ticks=None, scale=0.1, bounds=None, **options):
    """What is made of a file."""
    soft = limits.soft_limits("r_grasper")
    usual = Bounds(soft.lower[:5], soft.upper[:5])
    return replay.replay_motion(
        path, arms, ReplayOptions(**options), ticks, scale, bounds=bounds or usual
    )


def refused(path, *parts, **keys):
    """The message that refuses a file; each of `parts` must be in it."""
    with pytest.raises(UserError) as error:
        play(path, **keys)
    message = str(error.value)
    assert str(path) in message
    for part in parts:
        assert part in message, f"{part!r} is not in: {message}"
    return message


def tip_mm(motion, arm="gold", scale=0.1):
    """Tip path of a motion, relative to its start, mm."""
    return motion.position_um[:, motion.arms.index(arm)] @ np.array(ITP_AXES[arm]).T * scale * 1e-3
