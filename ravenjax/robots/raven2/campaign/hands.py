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
    """Return the replay of a recorded motion during a run; None for a generated motion. Raises
    UserError for a recording that the campaign cannot use.
    """
    operator, arms, ticks = config.operator, config.campaign.arms, config.campaign.ticks
    if operator.file is None:
        return None
    return recorded.replay_motion(
        operator.file, arms, operator.options, ticks, operator.scale, bounds=operator_bounds(config)
    )


def operator_bounds(config: RavenConfig) -> Bounds:
    """Return the limits to which the control software clamps the operator's commands: those of the
    first five joints, which [limits] replaces in part, and of the jaws' opening.
    """
    # The control software applies the limits of the first arm's tool to both arms
    soft = limits.soft_limits(config.tools[0], config.campaign.software)
    default_ranges = zip(soft.lower[:5], soft.upper[:5], strict=True)
    ranges = dict(zip(JOINTS[:5], default_ranges, strict=True)) | config.limits.si()
    lower, upper = zip(*ranges.values(), strict=True)
    if config.campaign.console == "absolute":  # the opening is then not clamped
        return Bounds(lower, upper)
    jaws = teleoperation.params(RavenSetup(software=config.campaign.software))
    # Gain of the packets' increments, and bounds of the opening, mrad
    opening = float(jaws.grasp_gain), float(jaws.grasp_min_mrad), float(jaws.grasp_max_mrad)
    return Bounds(lower, upper, opening)


def summarize_replay(replay: recorded.OperatorReplay, scales: np.ndarray | None) -> MotionSummary:
    """Return the summary of a replay, with the range of the scales at which runs replay it.
    scales: teleoperation scale of each run [runs], NaN: the scale of the file; None: every run has
    the scale of the file. Raises UserError if a scale moves the replay beyond the limits.
    """
    if scales is None or np.isnan(scales).all():
        return replay.summary
    used_scales = np.where(np.isnan(scales), replay.summary.scale, scales)
    recorded.require_scales(replay, used_scales)
    scale_range = float(used_scales.min()), float(used_scales.max())
    return replay.summary.model_copy(update={"scales": scale_range})


def operator_motion(config: RavenConfig) -> Motion:
    """Return the operator's motion, recorded or generated, with one row per tick of the run. Joints
    in [operator.start] replace those of the home pose. Raises UserError for a recording that the
    campaign cannot use.
    """
    operator, campaign = config.operator, config.campaign
    if (replay := operator_replay(config)) is not None:
        return replay.motion
    name = operator.motion or "suture"
    generated = motions.generate_motion(name, campaign.duration_s, campaign.arms, operator.seed)
    start = tuple(operator.start.jpos().values())
    motion = generated.first_rows(campaign.ticks)
    return dataclasses.replace(motion, start_jpos=(start,) * len(campaign.arms))
