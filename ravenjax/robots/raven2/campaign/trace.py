"""Computes time series of a run that the tick does not compute, and the base frames of the arms."""

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
    """Return the distance between the tips of two arms (mm), and for each arm the measured and the
    desired position of the tip [ticks, 3] (m), and the rotations [ticks, 3, 3] of the jaws of the
    robot and of its nominal model.
    """
    more = {}
    if len(setup.arms) > 1:
        more["tip_distance_mm"] = np.asarray(signals["tip_distance"]) * 1e3
    for arm, software in zip(setup.arms, signals["control"].arms, strict=True):
        more[f"{arm}/position"] = stack(software.pos.position_um) * 1e-6
        more[f"{arm}/position_d"] = stack(software.pos_d.position_um) * 1e-6
        more[f"{arm}/tip_rotation"] = jaw_rotation(arm, series[f"{arm}/link_jpos"])
        more[f"{arm}/model_rotation"] = jaw_rotation(arm, series[f"{arm}/model_jpos"])
    return more


def arm_bases(setup: RavenSetup) -> dict[str, Base]:
    """Return the pose of each arm's frame 0 in the world: position (m) and quaternion."""
    return {arm: Base(*scene.base_pose(arm)) for arm in setup.arms}
