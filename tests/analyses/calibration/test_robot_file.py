"""The file that a campaign draws its robots from."""

import tomllib
from pathlib import Path

import numpy as np
import virtual_log

from ravenjax.analyses.calibration import parameters
from ravenjax.robots.raven2.plant import robot


def content(draws: np.ndarray) -> dict:
    wanted = parameters.select_unknowns((0, 3))
    base = parameters.prior_robot(robot.params(virtual_log.SETUP, "gold"), wanted)
    values = parameters.values_by_path(base, wanted, draws[:, None] * np.ones(len(wanted)))
    return tomllib.loads(
        parameters.format_robot_file(values, "gold", "power_consistent", Path("log.bag"))
    )


def test_a_command_is_late_by_whole_cycles_and_the_logs_shift_is_no_robots() -> None:
    robots = content(np.array([-2.0, 0.0, 1.0, 9.0]))["parameters"]
    # a median of 1 ms times exp(0.7 steps), at most what a replay can tell
    assert robots["usb.command_delay"]["together"] == [0, 1, 2, parameters.LONGEST_DELAY_MS]
    assert not [path for path in robots if parameters.SETPOINT_DELAY in path]
    (gain,) = (
        values["together"] for path, values in robots.items() if path.endswith("gain.shoulder")
    )
    np.testing.assert_allclose(gain, np.exp(0.1 * np.array([-2.0, 0.0, 1.0, 9.0])), rtol=1e-5)
