"""Converts the signals of a run's ticks into its time series."""

from operator import attrgetter
from typing import Any

import numpy as np

from ravenjax.bundled import resources
from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.store.logs.topics import Base

_SERIES = resources.read_tables(__file__, "trace.toml")


def trace_series(
    setup: RavenSetup, signals: Any, golden: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return the time series of a run from its signals and the golden series [ticks, numbers].

    Names, axes, units and meanings are in `store.logs.time_series`.
    """
    out = {name: attrgetter(path)(signals) for name, path in _SERIES["run"].items()}
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


def _arm(signals: Any, i: int, arm: str) -> dict[str, np.ndarray]:
    # Returns one arm's time series, arrays [ticks, ...] in SI units or in the unit of the name.
    places = {
        "software": signals.control.arms[i],
        "plant": signals.plant[i],
        "model": signals.nominal[i],
        "cue": signals.haptics[i],
    }
    software, plant, _, cue = places.values()
    out = {
        name: _stack(getattr(places[place], field))
        for place, series in _SERIES["arm"].items()
        for name, field in series.items()
    }
    out["boards_cnt"], out["tip"] = _stack(signals.boards[i]), _stack(signals.tip[i])
    out["haptic_force"] = out["haptic_force"] * np.asarray(cue.force[0])[:, None]
    for ending, pose in (("", software.pos), ("_d", software.pos_d)):
        out[f"position{ending}"] = _stack(pose.position_um) * 1e-6
        out[f"rotation{ending}"] = np.stack([_stack(row) for row in pose.rotation], axis=1)
    out["tip_rotation"] = jaw_rotation(arm, out["link_jpos"])
    out["model_rotation"] = jaw_rotation(arm, out["model_jpos"])
    out["tip_error_mm"] = np.asarray(cue.distance) * 1e3
    out["tissue_depth_mm"] = np.asarray(signals.depth[i]) * 1e3
    if (touch := plant.touch) is not None:
        out["contact_force"] = _stack(touch.force)
        for name in ("tissue", "vessel", "instrument"):
            out[f"contact_{name}_n"] = np.asarray(getattr(touch, name))
    return out


def _stack(numbers: Any) -> np.ndarray:
    return np.stack([np.asarray(x) for x in numbers], axis=-1)
