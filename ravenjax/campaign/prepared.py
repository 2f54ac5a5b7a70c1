"""Defines the functions that a robot must provide, so that campaigns can use any robot.

A robot is a package or a single module that declares `ROBOT` (`ravenjax.vocabulary.robot.Robot`).
The module `campaign` of the package, or the single module itself, defines

    prepare(config, varied, injection, precision) -> Prepared
    more_series(setup, signals, series) -> {name: array [ticks] or [ticks, ...]}
        optional: time series of one run that are computed from its signals and series
    bases(setup) -> {arm: Base}
        optional: the base frames of the arms, in the world frame
    describe_figure() -> JSON
        optional: shapes for the explorer's page, see `campaign.figure` of the Raven-II
    clocks(program, columns, varied, runs) -> faults.clocks.Clocks
        optional: times of packets, and times in which the pedal is down
    phases(config) -> {phase: int [stretches, 2]}
        if `Robot.phases` is not empty: first and last tick of each stretch of a phase
    acted(program) -> (TickProgram, {action: number})
        optional: a program whose runs can contain an action, such as lifting the pedal, and the
        number of each action; see `stages.acted`. Action 1 is that of an operator who obeys the cue
    Params
        record of the parameters, with a `numbers.quantity` for each field
    Config
        optional: a subclass of `CampaignConfig` with additional sections

The tick is a `ravenjax.engines.interface.Loop`. It is written with `ravenjax.numbers`,
`ravenjax.faults` and any useful part of `ravenjax.stages`. Its outcomes become columns of
`ravenjax.store.schema`. Monitor, checks and faults compute most of these outcomes.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.interface import Loop
from ravenjax.numbers.setup import Injection, Precision, Setup
from ravenjax.stages.haptics import CueParams, HapticParams
from ravenjax.stages.monitor import MonitorParams
from ravenjax.store.motion.summary import MotionSummary


class Prepared(NamedTuple):
    """Result of the function `prepare(config, varied, injection, precision)` of a robot. varied:
    path -> values [runs] of the parameters that differ between runs; NaN means the robot's value.
    injection: `ravenjax.numbers.setup.Injection`. precision: `ravenjax.numbers.setup.Precision`.
    """

    loop: Loop
    setup: Setup
    params: Any  # the robot's parameters as plain numbers, with the file's values for all runs
    columns: tuple[np.ndarray, ...]  # columns of the operator's motion, [ticks] or longer
    motion: Any = None  # the same motion in the robot's own type
    operator: MotionSummary | None = None  # summary of a recorded motion
    # Parameters that are keys of random numbers, and their purpose. Runs have different keys.
    keys: Mapping[str, str] = {}


def shared_choices(config: Any, injection: Injection, precision: Precision) -> dict[str, Any]:
    """Return the fields of a `Setup` that follow from sections which all robots have."""
    return {
        "arms": config.campaign.arms,
        "precision": precision,
        "injection": injection,
        "cues": len(config.haptics.cues()),
        "detectors": tuple(use for _, use, _ in config.detectors),
        "harms": tuple(harm.use for harm in config.harm),
        "stages": config.stages,
    }


def shared_parameters(config: Any) -> dict[str, Any]:
    """Return the parameters of haptic cue and monitor that a campaign file sets. Lengths in m."""
    limits = config.outcomes
    return {
        "haptics": HapticParams(tuple(CueParams(*cue) for cue in config.haptics.cues())),
        "monitor": MonitorParams(
            jump_step=limits.jump_step_mm / 1e3,
            large_jump=limits.large_jump_mm / 1e3,
            limit=limits.limit_mm / 1e3,
        ),
    }
