"""A virtual Raven-II surgical robot, its control software, faults and haptics; thousands of runs in parallel.

    import ravenjax as rj

    config = rj.load_campaign("quick.toml", overrides=["campaign.duration_s=1"])
    table = rj.run(config)                       # one row a run
    one = rj.simulate(config, 17)                # xarray.Dataset: time series of run 17
    chain = rj.explain(config, 17)               # pandas: which signal its fault reached when
    position, rotation = rj.forward_kinematics(jpos, "gold")
    software = rj.ControlSoftware()              # drive the control software alone

What `__all__` names here is public. Every other module and name is internal and may change with any version.
Names are imported when they are first used, so that `import ravenjax` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ravenjax.api import explain, load_campaign, run, simulate
    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.errors import StoreError, UserError
    from ravenjax.numbers.setup import Precision
    from ravenjax.robots.raven2.console.packet import Packet
    from ravenjax.robots.raven2.geometry.arrays import (
        forward_kinematics,
        gravity_torque,
        inverse_kinematics,
        joint_from_motor,
        motor_from_joint,
    )
    from ravenjax.robots.raven2.software.control_software import ControlSoftware

__version__ = "0.1.0"

_HOMES = {
    "load_campaign": "ravenjax.api",
    "run": "ravenjax.api",
    "simulate": "ravenjax.api",
    "explain": "ravenjax.api",
    "forward_kinematics": "ravenjax.robots.raven2.geometry.arrays",
    "inverse_kinematics": "ravenjax.robots.raven2.geometry.arrays",
    "motor_from_joint": "ravenjax.robots.raven2.geometry.arrays",
    "joint_from_motor": "ravenjax.robots.raven2.geometry.arrays",
    "gravity_torque": "ravenjax.robots.raven2.geometry.arrays",
    "ControlSoftware": "ravenjax.robots.raven2.software.control_software",
    "Packet": "ravenjax.robots.raven2.console.packet",
    "Precision": "ravenjax.numbers.setup",
    "CampaignConfig": "ravenjax.campaign.file.config",
    "UserError": "ravenjax.errors",
    "StoreError": "ravenjax.errors",
}

__all__ = [
    "CampaignConfig",
    "ControlSoftware",
    "Packet",
    "Precision",
    "StoreError",
    "UserError",
    "explain",
    "forward_kinematics",
    "gravity_torque",
    "inverse_kinematics",
    "joint_from_motor",
    "load_campaign",
    "motor_from_joint",
    "run",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ravenjax' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
