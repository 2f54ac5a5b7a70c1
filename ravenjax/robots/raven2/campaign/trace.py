"""Converts the signals of a run's ticks into its time series."""

from typing import Any

import numpy as np

from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.store.logs.topics import Base

_SOFTWARE = ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d")
"""Signals of the control software that the time series has under their own names."""


def trace_series(
    setup: RavenSetup, signals: Any, golden: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return the time series of a run from its signals and the golden run's series [ticks,
    numbers].

    Names, axes, units and meanings are in `store.logs.time_series`.
    """
    control = signals.control
    out: dict[str, np.ndarray] = {
        "runlevel": control.runlevel,
        "surgeon_mode": control.surgeon_mode,
        "last_seq": control.last_seq,
        "soft_estopped": control.soft_estopped,
        "pins_out": control.pins_out,
        "plc_runlevel": signals.plc.runlevel,
        "brakes": signals.plc.brakes,
        "packet_received": signals.packet.received,
    }
    for slot, active in enumerate(signals.fault_active):
        out[f"fault{slot}_active"] = active
    if len(setup.arms) > 1:
        out["tip_distance_mm"] = signals.tip_distance * 1e3
    for i, arm in enumerate(setup.arms):
        out |= {f"{arm}/{name}": values for name, values in _arm(signals, i, arm).items()}
    if golden is not None:
        tips = golden.reshape(len(golden), len(setup.arms), 2, 3)
        out |= {f"{arm}/golden_tip": tips[:, i, 0] for i, arm in enumerate(setup.arms)}
    return {name: np.asarray(values) for name, values in out.items()}


def arm_bases(setup: RavenSetup) -> dict[str, Base]:
    """Return position and orientation of each arm's base in the world."""
    return {arm: Base(*scene.base_pose(arm)) for arm in setup.arms}


def _touched(touch: Any) -> dict[str, np.ndarray]:
    if touch is None:
        return {}
    sizes = ("tissue", "vessel", "instrument")
    return {"contact_force": _stack(touch.force)} | {
        f"contact_{name}_n": np.asarray(getattr(touch, name)) for name in sizes
    }


def _arm(signals: Any, i: int, arm: str) -> dict[str, np.ndarray]:
    software, plant = signals.control.arms[i], signals.plant[i]
    model, cue = signals.nominal[i], signals.haptics[i]
    direction, link_jpos, model_jpos = _stack(cue.direction), _stack(plant.jpos), _stack(model.jpos)
    return {
        "enc_val_cnt": _stack(software.enc_val),
        **{name: _stack(getattr(software, name)) for name in _SOFTWARE},
        "current_cmd_cnt": _stack(software.current_cmd),
        "dac_cnt": _stack(software.current_cmd_written),
        "boards_cnt": _stack(signals.boards[i]),
        **_pose(software.pos, ""),
        **_pose(software.pos_d, "_d"),
        "link_jpos": link_jpos,
        "link_jvel": _stack(plant.jvel),
        "motor_mpos": _stack(plant.mpos),
        "motor_mvel": _stack(plant.mvel),
        "cable_tension": _stack(plant.tension),
        "tip": _stack(signals.tip[i]),
        "tip_rotation": jaw_rotation(arm, link_jpos),
        "model_position": _stack(model.tip_position),
        "model_rotation": jaw_rotation(arm, model_jpos),
        "model_jpos": model_jpos,
        "tip_error_mm": np.asarray(cue.distance) * 1e3,
        "haptic_force": direction * np.asarray(cue.force[0])[:, None],
        "cue_force": _stack(cue.force),
        "tissue_depth_mm": np.asarray(signals.depth[i]) * 1e3,
    } | _touched(plant.touch)


def _pose(pose: Any, ending: str) -> dict[str, np.ndarray]:
    rotation = np.stack([_stack(row) for row in pose.rotation], axis=1)
    return {f"position{ending}": _stack(pose.position_um) * 1e-6, f"rotation{ending}": rotation}


def _stack(numbers: Any) -> np.ndarray:
    return np.stack([np.asarray(x) for x in numbers], axis=-1)
