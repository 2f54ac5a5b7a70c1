"""Computes which milliseconds of a run belong to which phase of the planned motion.

Phases follow from the plan, so they are the same for all runs of a campaign: noise, drawn packets,
cues and faults do not change them. If a scale or a packet length varies, its default is used.
"""

import math

import numpy as np

from ravenjax.numbers import Vec, run_eagerly
from ravenjax.robots.raven2.campaign import hands, pedal
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import kinematics, scene
from ravenjax.robots.raven2.geometry.mapping import position_from_itp

SPEED_WINDOW = 20
"""Rows over which a speed is averaged, because the positions of a recording are rounded."""


def phase_intervals(config: RavenConfig) -> dict[str, np.ndarray]:
    """Return the intervals of each phase, int64 [intervals, 2]: first tick, first tick after it. In
    phase `fast`, the commanded speed is above its median over pedal-down; `slow` is the rest of
    pedal-down. Raises UserError if the operator's file cannot be used.
    """
    motion, ticks = hands.operator_motion(config), config.campaign.ticks
    packet_cycles = max(1, int(_fixed_number(config, "network.cycles_per_packet", default=1)))
    cycles = 1 if config.random_packets else packet_cycles
    motion = motion.first_rows(math.ceil(ticks / cycles))
    row = np.arange(ticks) // cycles  # of the motion, in each tick
    obeys_plc = _fixed_number(
        config, "control.state_machine.plc_obeyed", default=config.campaign.software == "raven2"
    )
    pedal_down = pedal.planned_pedal_down(
        config.campaign.software, motion.surgeon_mode > 0, cycles, bool(obeys_plc), ticks
    )
    scale = _fixed_number(config, "operator.scale", default=config.operator.scale)
    moves_tip = np.isin(np.arange(len(motion)), row[pedal_down]) & (motion.surgeon_mode > 0)
    moves_tip |= config.campaign.console == "absolute"  # absolute positions have no clutch
    # Commanded path of the tips, m, ITP axes; [rows, arms, 3]
    steps = np.diff(motion.position_um, axis=0, prepend=motion.position_um[:1]) * (scale * 1e-6)
    path = np.cumsum(np.where(moves_tip[:, None, None], steps, 0.0), axis=0)
    rows = np.arange(len(path))
    before = np.maximum(rows - SPEED_WINDOW // 2, 0)
    after = np.minimum(rows + SPEED_WINDOW // 2, len(rows) - 1)
    distance = np.linalg.norm(path[after] - path[before], axis=2).max(axis=1)
    # m per row of the motion, of the faster arm, in each tick
    speed = (distance / np.maximum(after - before, 1))[row]
    fast = pedal_down & (speed > np.median(speed[pedal_down])) if pedal_down.any() else pedal_down
    in_tissue = np.any(
        [_tissue_depth(motion, i, path[:, i]) > 0.0 for i in range(len(motion.arms))], axis=0
    )
    masks = {
        "pedal_down": pedal_down,
        "pedal_up": ~pedal_down,
        "fast": fast,
        "slow": pedal_down & ~fast,
        "in_tissue": in_tissue[row],
    }
    # [begin, end) of each interval of true ticks. With a zero at both ends, begins and ends of
    # intervals alternate.
    return {
        name: np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        for name, mask in masks.items()
    }


def _fixed_number(config: RavenConfig, path: str, default: float) -> float:
    # Returns the number that [parameters] sets for all runs; `default` without such a number.
    axis = config.parameters.get(path)
    return default if axis is None or axis.kind != "fixed" else float(axis.values[0])


def _tissue_depth(motion: Motion, arm_index: int, path: np.ndarray) -> np.ndarray:
    # Returns the depth [rows] of an arm's tip below the surface of the tissue, m. path:
    # displacement of the tip from its start, [rows, 3], m, ITP axes.
    arm, start_jpos = motion.arms[arm_index], motion.start_jpos[arm_index]
    with run_eagerly():
        start = kinematics.forward_pose(arm, Vec(map(np.float64, start_jpos))).position
        return np.asarray(scene.tissue_depth(arm, start + position_from_itp(arm, Vec(path.T))))
