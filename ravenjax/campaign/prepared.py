"""What a robot makes of a campaign: everything that `plan` cannot know.

A robot is a package, or one module, that declares `ROBOT` (`ravenjax.vocabulary.robot.Robot`). Its
part `campaign`, a module of the package or the one module itself, has

    prepare(config, varied, injection, precision) -> Prepared
    series(setup, signals, golden) -> {name: array [ticks] or [ticks, ...]}     of a trace
    bases(setup) -> {arm: Base}             optional: where the arms stand in the world
    clocks(program, columns, varied, runs) -> faults.clocks.Clocks      optional: when packets come, the pedal is down
    phases(config) -> {phase: int [stretches, 2]}       where `Robot.phases` names any: stretches of their ticks
    explained(program) -> TickProgram       optional: the same runs, each compared with its golden run at every seam
    watched(program) -> TickProgram         optional: the same runs; signals: what their `detectors` remember, `live`
    Params                                  record of the parameters, a `numbers.quantity` at each field
    Config                                  optional: a subclass of `CampaignConfig` with sections of its own

golden: series of the golden run, [ticks, numbers]. The tick itself is a
`ravenjax.engines.interface.Loop`, written with `ravenjax.numbers`, `ravenjax.faults` and whatever
of `ravenjax.stages` the robot has use for; its outcomes are the columns of `ravenjax.store.schema`,
most of which the monitor, the checks and the faults give.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.interface import Loop
from ravenjax.numbers.setup import Setup
from ravenjax.store.motion.summary import MotionSummary


class Prepared(NamedTuple):
    """Returned by `prepare(config, varied, injection, precision)` of a robot's part `campaign`.

    varied: path -> values [runs] of the parameters that differ between runs, NaN where a run has
    the robot's own; injection: `ravenjax.numbers.setup.Injection`; precision:
    `ravenjax.numbers.setup.Precision`.
    """

    loop: Loop
    setup: Setup  # the robot's own
    params: Any  # its parameters, plain numbers, with whatever the file sets for all runs
    columns: tuple[np.ndarray, ...]  # of the operator's motion, [ticks] or longer
    motion: Any = None  # the same as the robot has it
    operator: MotionSummary | None = None  # what became of a recorded one
    keys: Mapping[
        str, str
    ] = {}  # parameters that each run's id gives, and what each draws: a run draws its own
