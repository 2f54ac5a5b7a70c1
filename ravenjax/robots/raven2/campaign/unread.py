"""Parameters of a Raven that nothing reads in some campaigns."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ravenjax.numbers import paths
from ravenjax.robots.raven2.arms import ARMS, JOINTS
from ravenjax.robots.raven2.plant import parameter_sets

if TYPE_CHECKING:
    from ravenjax.robots.raven2.campaign.sections import RavenCampaign


class Unread(NamedTuple):
    """A parameter that nothing reads in some campaigns."""

    path: str  # without arm, joint or axis
    component: str  # "": all of its numbers
    where: Callable[[RavenCampaign], bool]
    why: str


_INCREMENTS = (
    'nothing reads it with console = "absolute": remove it, or take console = "increments"'
)
_ABSOLUTE = 'nothing reads it but with console = "absolute": remove it, or set that in [campaign]'

UNREAD = (
    *(
        Unread(f"operator.{name}", "", lambda campaign: campaign.console != "absolute", _ABSOLUTE)
        for name in ("start_position", "start_quat", "start_grasp")
    ),
    *(
        Unread(
            f"control.teleoperation.{name}",
            "",
            lambda campaign: campaign.console == "absolute",
            _INCREMENTS,
        )
        for name in ("grasp_gain", "grasp_min_mrad", "grasp_max_mrad")
    ),
    Unread(
        "control.overdrive.policy",
        "",
        lambda campaign: campaign.software == "fork2015",
        "nothing reads it: the 2015 fork has no policy",
    ),
    Unread(
        "plant.cable_strength",
        "",
        lambda campaign: not parameter_sets.tells_tension(campaign.parameter_set),
        "nothing reads it: the tension of this parameter_set is no real one; take parameter_set ="
        ' "power_consistent"',
    ),
    Unread(
        "control.overdrive.dac_max",
        "grasp2",
        lambda campaign: True,
        "nothing reads it: the original's check never looks at grasp2",
    ),
)
"""Found by tracing the tick: no other parameter is without influence (`test_unread.py`)."""


def why(path: str, campaign: RavenCampaign) -> str:
    """Why nothing reads the parameter of that path; "" where something does."""
    last = path.rpartition(".")[2]
    plain = paths.plain(path, ARMS, JOINTS)
    rows = (
        row
        for row in UNREAD
        if row.path == plain and row.component in ("", last) and row.where(campaign)
    )
    return next((row.why for row in rows), "")
