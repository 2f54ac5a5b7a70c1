"""The file that a campaign draws its robots from."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import virtual_log

from ravenjax.analyses.calibration import parameters, robot_file
from ravenjax.campaign import loading
from ravenjax.robots.raven2.plant import robot


def content(draws: np.ndarray) -> dict:
    wanted = parameters.unknowns((0, 3))
    base = parameters.believed(robot.params(virtual_log.SETUP, "gold"), wanted)
    values = parameters.values(base, wanted, draws[:, None] * np.ones(len(wanted)))
    return tomllib.loads(robot_file.text(values, "gold", "power_consistent", Path("log.bag")))


def test_every_parameter_of_the_robot_is_one_of_a_campaign(tmp_path) -> None:
    import tiny_campaign

    robots = content(np.array([-1.0, 0.0, 2.0]))
    raw = tiny_campaign.tables(runs=203)
    raw["group"], raw["parameters"] = raw["group"][1:], robots["parameters"]
    raw["campaign"] |= robots["campaign"]
    config = loading.from_dict(raw)
    assert {one.kind for one in config.parameters.values()} == {"together"}
    names = {path.rpartition(".")[0] for path in config.parameters if path.startswith("plant.")}
    assert {
        "plant.gold.actuators.gain",
        "plant.gold.cable_stiffness",
        "plant.gold.cable_damping",
    } < names


def test_a_command_is_late_by_whole_cycles_and_the_logs_shift_is_no_robots() -> None:
    robots = content(np.array([-2.0, 0.0, 1.0, 9.0]))["parameters"]
    # a median of 1 ms times exp(0.7 steps), at most what a replay can tell
    assert robots["usb.command_delay"]["together"] == [0, 1, 2, parameters.LONGEST_DELAY_MS]
    assert not [path for path in robots if parameters.SETPOINT_DELAY in path]
    (gain,) = (
        values["together"] for path, values in robots.items() if path.endswith("gain.shoulder")
    )
    np.testing.assert_allclose(gain, np.exp(0.1 * np.array([-2.0, 0.0, 1.0, 9.0])), rtol=1e-5)
