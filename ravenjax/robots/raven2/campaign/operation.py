"""Computes which milliseconds of a campaign belong to which phase of the planned motion.

If the file has one scale and one packet length for all runs, they are used; otherwise the defaults
are. Phases belong to the plan and are the same for all runs. Noise, drawn packets, cues and faults
do not change them.
"""

import numpy as np

from ravenjax.numbers import Vec, run_eagerly
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.campaign import hands, pedal
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import kinematics, scene
from ravenjax.robots.raven2.geometry.mapping import position_from_itp

WINDOW = 20
"""Milliseconds over which a speed is averaged, because a recording's rows are rounded."""


def phase_intervals(config: RavenConfig) -> dict[str, np.ndarray]:
    """Return phase -> its intervals, int64 [intervals, 2]: first tick, first tick after.

    Raises UserError if the operator's file cannot be used.
    """
    motion, ticks = hands.operator_motion(config), config.campaign.ticks
    packet_cycles = max(1, int(_number(config, "network.cycles_per_packet", 1)))
    cycles = 1 if config.random_packets else packet_cycles
    motion = motion.first(-(-ticks // cycles))
    row = np.arange(ticks) // cycles
    obeyed = _number(
        config, "control.state_machine.plc_obeyed", config.campaign.software == "raven2"
    )
    pedal_down = pedal.planned_pedal_down(
        config.campaign.software, motion.surgeon_mode > 0, cycles, bool(obeyed), ticks
    )
    scale = _number(config, "operator.scale", config.operator.scale)
    moves_tip = np.isin(np.arange(len(motion)), row[pedal_down]) & (motion.surgeon_mode > 0)
    moves_tip |= config.campaign.console == "absolute"  # absolute positions have no clutch
    # Commanded path of the tips, m, ITP axes; [rows, arms, 3]
    steps = np.diff(motion.position_um, axis=0, prepend=motion.position_um[:1]) * (scale * 1e-6)
    path = np.cumsum(np.where(moves_tip[:, None, None], steps, 0.0), axis=0)
    rows = np.arange(len(path))
    before, after = np.maximum(rows - WINDOW // 2, 0), np.minimum(rows + WINDOW // 2, len(rows) - 1)
    distance = np.linalg.norm(path[after] - path[before], axis=2).max(axis=1)
    speed = (distance / np.maximum(after - before, 1))[row]
    fast = pedal_down & (speed > np.median(speed[pedal_down])) if pedal_down.any() else pedal_down
    in_tissue = np.any(
        [_depth(motion, i, arm, path[:, i]) > 0.0 for i, arm in enumerate(motion.arms)], axis=0
    )
    masks = {
        "pedal_down": pedal_down,
        "pedal_up": ~pedal_down,
        "fast": fast,
        "slow": pedal_down & ~fast,
        "in_tissue": in_tissue[row],
    }
    return {name: _true_intervals(mask) for name, mask in masks.items()}


def _number(config: RavenConfig, path: str, default: float) -> float:
    axis = config.parameters.get(path)
    return default if axis is None or axis.kind != "fixed" else float(axis.values[0])


def _depth(motion: Motion, i: int, arm: ArmName, path: np.ndarray) -> np.ndarray:
    """Return the depth [rows] of a tip below the tissue, m. path: from the start, [rows, 3], m."""
    with run_eagerly():
        start = kinematics.forward_pose(arm, Vec(map(np.float64, motion.start_jpos[i]))).position
        tip = start + position_from_itp(arm, Vec(path.T))
        return np.asarray(scene.tissue_depth(arm, tip))


def _true_intervals(mask: np.ndarray) -> np.ndarray:
    """Return [begin, end) of each interval of true ticks in `mask`, int64 [intervals, 2]."""
    return np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
