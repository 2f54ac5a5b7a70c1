"""The operator of a campaign: a generated motion, or a recorded one as it is replayed."""

from __future__ import annotations

import dataclasses

import numpy as np

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import limits
from ravenjax.store.motion import replay as recorded
from ravenjax.store.motion.reach import Bounds
from ravenjax.store.motion.replay import OperatorReplay
from ravenjax.store.motion.summary import MotionSummary


def operator_replay(config: RavenConfig, ticks: int | None = None) -> OperatorReplay | None:
    """What becomes of a recorded operator in `ticks` ms, by default those of a run; None for a
    generated motion.

    Raises UserError for a file that cannot be used as the campaign has it.
    """
    operator = config.operator
    if operator.file is None:
        return None
    ticks, bounds = ticks or config.campaign.ticks, operator_bounds(config)
    return recorded.replay(
        operator.file, config.campaign.arms, operator.options, ticks, operator.scale, bounds=bounds
    )


def operator_bounds(config: RavenConfig) -> Bounds:
    """Soft limits of the positioning joints, the roll and the wrist in a campaign."""
    soft = limits.soft_limits(config.tools[0], config.campaign.software)
    own = config.limits.si()
    pairs = zip(JOINTS, zip(soft.lower[:5], soft.upper[:5], strict=True), strict=False)
    lower, upper = zip(*(own.get(joint, pair) for joint, pair in pairs), strict=True)
    return Bounds(lower, upper)


def scaled(replay: OperatorReplay, scales: np.ndarray | None) -> MotionSummary:
    """The summary of a replay whose teleoperation scale a campaign varies; UserError where that
    leaves the limits.
    """
    if scales is None or np.isnan(scales).all():
        return replay.summary
    some = np.where(np.isnan(scales), replay.summary.scale, scales)
    recorded.require_scales(replay, some)
    return replay.summary.model_copy(update={"scales": (float(some.min()), float(some.max()))})


def operator_motion(config: RavenConfig) -> Motion:
    """The operator's motion, one row a tick of the run."""
    operator, arms = config.operator, config.campaign.arms
    if (replay := operator_replay(config)) is not None:
        return replay.motion
    name = operator.motion or "suture"
    generated = motions.generate(name, config.campaign.duration_s, arms, operator.seed).first(
        config.campaign.ticks
    )
    start = operator.start.si()
    begins = (
        tuple(start.get(joint, q) for joint, q in zip(JOINTS, jpos, strict=True))
        for jpos in generated.start_jpos
    )
    return dataclasses.replace(generated, start_jpos=tuple(begins))
