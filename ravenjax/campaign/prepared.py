"""What a robot makes of a campaign: everything that `plan` cannot know."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.interface import Loop
from ravenjax.numbers.setup import Setup
from ravenjax.store.motion.summary import MotionSummary


class Prepared(NamedTuple):
    """Returned by `prepare(config, varied, injection, precision)` of a robot's part `campaign`.

    varied: path -> values [runs] of the parameters that differ between runs, NaN where a run has the robot's own;
    injection: `ravenjax.numbers.setup.Injection`; precision: `ravenjax.numbers.setup.Precision`.
    """

    loop: Loop
    setup: Setup  # the robot's own
    params: Any  # its parameters, plain numbers, with whatever the file sets for all runs
    columns: tuple[np.ndarray, ...]  # of the operator's motion, [ticks] or longer
    motion: Any = None  # the same as the robot has it
    operator: MotionSummary | None = None  # what became of a recorded one
    noise_key: str = ""  # parameter that draws a run's noise; "": the campaign has none
