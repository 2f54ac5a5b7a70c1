"""Converts the signals of a run's ticks to time series, for every robot.

`Robot.series` has a path for each series, such as jpos = "control.arms.ARM.jpos". A path begins
with a signal of the loop's `name_signals`, here control. ARM stands for each arm, so this path
gives gold/jpos and green/jpos. Values are in SI units, or in mm if a name ends in _mm. A
series without a signal is left out. `store.logs.time_series` describes the series.
"""

from typing import Any, cast

import numpy as np

from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import ARM


def read_series(
    robot: Robot, program: Any, signals: Any, golden: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return the time series of a run, arrays [ticks, ...], such as runlevel and gold/jpos.

    program: the campaign's `engines.interface.TickProgram`. signals: all signals of the run's
    ticks. golden: `stages.monitor.reference_series` of the golden run, [ticks, numbers].
    """
    setup = program.setup
    named = program.loop.name_signals(setup, signals)
    out = {f"fault{slot}_active": values for slot, values in enumerate(named["fault_active"])}
    of_arm = {name: path for name, path in robot.series.items() if ARM in path}
    of_robot = {name: path for name, path in robot.series.items() if ARM not in path}
    owners = [("", -1, of_robot), *((f"{arm}/", i, of_arm) for i, arm in enumerate(setup.arms))]
    for prefix, arm, paths in owners:
        for name, path in paths.items():
            signal, *steps = path.split(".")
            value = named[signal]
            # A field that this robot or campaign does not have gives None, and no series.
            for step in steps:
                value = value[arm] if step == ARM else cast(Any, getattr(value, step, None))
            if value is not None:
                out[prefix + name] = stack(value) * 1e3 if name.endswith("_mm") else stack(value)
    for arm in setup.arms:
        # So far haptic_force is a direction. The first haptic set gives its magnitude.
        out[f"{arm}/haptic_force"] = out[f"{arm}/haptic_force"] * out[f"{arm}/cue_force"][:, :1]
    # The robot's module may have a function for further series.
    out |= getattr(robot.part("campaign"), "more_series", lambda *_: {})(setup, named, out)
    if golden is not None:
        # [ticks, arms, tips, axes]. Tip 0 is the true tip, tip 1 the measured tip.
        tips = golden.reshape(len(golden), len(setup.arms), 2, 3)
        out |= {f"{arm}/golden_tip": tips[:, i, 0] for i, arm in enumerate(setup.arms)}
    return {name: np.asarray(values) for name, values in out.items()}


def stack(numbers: Any) -> np.ndarray:
    """Return nested tuples of arrays [ticks] as one array [ticks, ...]."""
    if isinstance(numbers, tuple | list):
        return np.stack([stack(part) for part in numbers], axis=1)
    return np.asarray(numbers)
