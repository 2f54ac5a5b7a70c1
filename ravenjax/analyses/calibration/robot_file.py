"""Writes calibrated robots as TOML, for `[parameters] from` of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ravenjax.analyses.calibration.parameters import COMMAND_DELAY, LONGEST_DELAY_MS, SETPOINT_DELAY
from ravenjax.robots.raven2.arms import ArmName

DELAY = "usb.command_delay"
"""Name of COMMAND_DELAY in a campaign, where it is in whole cycles."""


def format_robot_file(
    values: Mapping[str, np.ndarray], arm: ArmName, parameter_set: str, log: Path
) -> str:
    """Return TOML of numbers [n] by path in `LoopParams`. The n-th numbers together are one robot.

    SETPOINT_DELAY belongs to the log and is left out.
    """
    number = len(next(iter(values.values())))
    rows = [
        (
            f"# {number} robots that {log.name} leaves likely: the n-th values of all lists belong"
            " to one. In a campaign:"
        ),
        '# [parameters] from = "this file". Written by `ravenjax calibrate`.',
        "",
        "[campaign]",
        f'parameter_set = "{parameter_set}"',
        "",
        "[parameters]",
    ]
    for path, draws in values.items():
        if path == COMMAND_DELAY:
            cycles = np.clip(np.round(draws), 0, LONGEST_DELAY_MS).astype(int)
            rows.append(f'"{DELAY}" = {{ together = {cycles.tolist()} }}')
        elif path != SETPOINT_DELAY:
            listed = ", ".join(map(_decimal, draws.tolist()))
            rows.append(
                f'"plant.{arm}.{path.removeprefix("plant.")}" = {{ together = [{listed}] }}'
            )
    return "\n".join(rows) + "\n"


def _decimal(value: float) -> str:
    """Write a number so that TOML reads it as a float."""
    word = f"{value:.6g}"
    return word if "." in word or "e" in word else f"{value:.1f}"
