"""The robots that a campaign draws: the kinematic errors of each arm, as parameters with a
distribution.
"""

from __future__ import annotations

from collections.abc import Sequence

from ravenjax.campaign.file.axis import Axis
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED


def axes(arms: Sequence[ArmName]) -> dict[str, Axis]:
    """Path -> distribution of every kinematic error; each arm has its own."""
    return {
        f"plant.{arm}.kinematic_errors.{path}": Axis(kind="normal", values=(0.0, deviation))
        for arm in arms
        for path, deviation in MEASURED.items()
    }
