"""Computes the time series of a run that are no signals of its ticks, and the arms' bases."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages.recorded import stack
from ravenjax.store.logs.topics import Base


def more_series(
    setup: RavenSetup, signals: Mapping[str, Any], series: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return further time series; see `campaign.prepared`."""
    out = {}
    if len(setup.arms) > 1:
        out["tip_distance_mm"] = np.asarray(signals["tip_distance"]) * 1e3
    for arm, software in zip(setup.arms, signals["control"].arms, strict=True):
        for ending, pose in (("", software.pos), ("_d", software.pos_d)):
            out[f"{arm}/position{ending}"] = stack(pose.position_um) * 1e-6
        for of, jpos in (("tip", "link_jpos"), ("model", "model_jpos")):
            out[f"{arm}/{of}_rotation"] = jaw_rotation(arm, series[f"{arm}/{jpos}"])
    return out


def arm_bases(setup: RavenSetup) -> dict[str, Base]:
    """Return position and orientation of each arm's base in the world."""
    return {arm: Base(*scene.base_pose(arm)) for arm in setup.arms}
