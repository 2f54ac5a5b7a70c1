"""The operator's motion in a campaign: a generated motion, or a replayed recording."""

import dataclasses

import numpy as np

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import limits
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import teleoperation
from ravenjax.store.motion import replay as recorded
from ravenjax.store.motion.reach import Bounds
from ravenjax.store.motion.summary import MotionSummary


def operator_replay(config: RavenConfig) -> recorded.OperatorReplay | None:
    """Return the replay of a recorded operator during a run; None for a generated motion.

    Raises UserError for a file that the campaign cannot use.
    """
    operator, arms, ticks = config.operator, config.campaign.arms, config.campaign.ticks
    if operator.file is None:
        return None
    bounds = operator_bounds(config)
    return recorded.replay_motion(
        operator.file, arms, operator.options, ticks, operator.scale, bounds=bounds
    )


def operator_bounds(config: RavenConfig) -> Bounds:
    """Return the limits to which the control software clamps the operator's commands."""
    soft = limits.soft_limits(config.tools[0], config.campaign.software)
    given = config.limits.si()
    pairs = zip(JOINTS, zip(soft.lower[:5], soft.upper[:5], strict=True), strict=False)
    lower, upper = zip(*(given.get(joint, pair) for joint, pair in pairs), strict=True)
    if config.campaign.console == "absolute":
        return Bounds(lower, upper)
    jaws = teleoperation.params(RavenSetup(software=config.campaign.software))
    ends = float(jaws.grasp_min_mrad), float(jaws.grasp_max_mrad)
    return Bounds(lower, upper, (float(jaws.grasp_gain), *ends))


def scale_hands(replay: recorded.OperatorReplay, scales: np.ndarray | None) -> MotionSummary:
    """Return the summary of a replay with the teleoperation scales that a campaign varies.

    Raises UserError if a scale moves the replay beyond the limits.
    """
    if scales is None or np.isnan(scales).all():
        return replay.summary
    used = np.where(np.isnan(scales), replay.summary.scale, scales)
    recorded.require_scales(replay, used)
    return replay.summary.model_copy(update={"scales": (float(used.min()), float(used.max()))})


def operator_motion(config: RavenConfig) -> Motion:
    """Return the operator's motion, one row per tick of the run."""
    operator, arms = config.operator, config.campaign.arms
    if (replay := operator_replay(config)) is not None:
        return replay.motion
    name = operator.motion or "suture"
    generated = motions.generate_motion(
        name, config.campaign.duration_s, arms, operator.seed
    ).first(config.campaign.ticks)
    start = operator.start.si()
    starts = (
        tuple(start.get(joint, q) for joint, q in zip(JOINTS, jpos, strict=True))
        for jpos in generated.start_jpos
    )
    return dataclasses.replace(generated, start_jpos=tuple(starts))
