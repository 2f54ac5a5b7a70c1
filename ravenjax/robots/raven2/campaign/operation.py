"""Computes which milliseconds of a campaign belong to which phase of the planned motion.

If the file has one scale and one packet length for all runs, they are used; otherwise the defaults
are. Phases belong to the plan and are the same for all runs. Noise, drawn packets, cues and faults
do not change them.
"""

import numpy as np

from ravenjax.numbers import Vec, at_once
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.campaign import hands, pedal
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import kinematics, scene
from ravenjax.robots.raven2.geometry.mapping import position_from_itp

WINDOW = 20
"""Milliseconds over which a speed is averaged, because a recording's rows are rounded."""


def phase_intervals(config: RavenConfig) -> dict[str, np.ndarray]:
    """Return the intervals of each phase, int64 [intervals, 2]: first tick, first tick after.

    Raises UserError if the operator's file cannot be used.
    """
    motion, ticks = hands.operator_motion(config), config.campaign.ticks
    written = max(1, int(_number(config, "network.cycles_per_packet", 1)))
    cycles = 1 if config.random_packets else written
    motion = motion.first(-(-ticks // cycles))
    row = np.arange(ticks) // cycles
    obeyed = _number(
        config, "control.state_machine.plc_obeyed", config.campaign.software == "raven2"
    )
    down = pedal.planned_pedal_down(
        config.campaign.software, motion.surgeon_mode > 0, cycles, bool(obeyed), ticks
    )
    scale = _number(config, "operator.scale", config.operator.scale)
    follows = np.isin(np.arange(len(motion)), row[down]) & (motion.surgeon_mode > 0)
    follows |= config.campaign.console == "absolute"  # absolute positions have no clutch
    # The way of the tips that the operator asks for, m, ITP axes; [rows, arms, 3]
    steps = np.diff(motion.position_um, axis=0, prepend=motion.position_um[:1]) * (scale * 1e-6)
    way = np.cumsum(np.where(follows[:, None, None], steps, 0.0), axis=0)
    rows = np.arange(len(way))
    before, after = np.maximum(rows - WINDOW // 2, 0), np.minimum(rows + WINDOW // 2, len(rows) - 1)
    far = np.linalg.norm(way[after] - way[before], axis=2).max(axis=1)
    speed = (far / np.maximum(after - before, 1))[row]
    fast = down & (speed > np.median(speed[down])) if down.any() else down
    deep = np.any(
        [_depth(motion, i, arm, way[:, i]) > 0.0 for i, arm in enumerate(motion.arms)], axis=0
    )
    masks = {
        "pedal_down": down,
        "pedal_up": ~down,
        "fast": fast,
        "slow": down & ~fast,
        "in_tissue": deep[row],
    }
    return {name: _stretches(mask) for name, mask in masks.items()}


def _number(config: RavenConfig, path: str, usual: float) -> float:
    axis = config.parameters.get(path)
    return usual if axis is None or axis.kind != "fixed" else float(axis.values[0])


def _depth(motion: Motion, i: int, arm: ArmName, way: np.ndarray) -> np.ndarray:
    """Return the depth of a tip below the tissue's surface after `way` [rows, 3], m."""
    with at_once():
        start = kinematics.forward_pose(arm, Vec(map(np.float64, motion.start_jpos[i]))).position
        tip = start + position_from_itp(arm, Vec(way.T))
        return np.asarray(scene.tissue_depth(arm, tip))


def _stretches(mask: np.ndarray) -> np.ndarray:
    """Return begin and end of each run of true ticks in a mask [ticks], int64 [stretches, 2]."""
    return np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
