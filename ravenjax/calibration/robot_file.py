"""A calibrated robot as a file: what a campaign draws its robots from by `[parameters] from = "my_robot.toml"`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ravenjax.robots.raven2.arms import ArmName


def text(values: Mapping[str, np.ndarray], arm: ArmName, parameter_set: str, log: Path) -> str:
    """TOML of numbers [n] by path in `PlantParams`; the n-th of all belong to one robot."""
    number = len(next(iter(values.values())))
    rows = [
        f"# {number} robots that {log.name} leaves likely: the n-th values of all lists belong to one. In a campaign:",
        '# [parameters] from = "this file". Written by `ravenjax calibrate`.',
        "",
        "[campaign]",
        f'parameter_set = "{parameter_set}"',
        "",
        "[parameters]",
    ]
    for path, draws in values.items():
        listed = ", ".join(
            f"{value:.6g}" if "." in f"{value:.6g}" or "e" in f"{value:.6g}" else f"{value:.1f}"
            for value in draws.tolist()
        )
        rows.append(f'"plant.{arm}.{path}" = {{ together = [{listed}] }}')
    return "\n".join(rows) + "\n"
