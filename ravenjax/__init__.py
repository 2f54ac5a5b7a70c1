"""A virtual Raven-II surgical robot, its control software, faults and haptics; thousands of runs in
parallel.

    import ravenjax as rj

    campaign = rj.Campaign.from_toml("quick")    # or rj.Campaign(name=.., group=[rj.Group(..)])
    results = campaign.run()                     # rates, worst runs, figures, SQL
    config = rj.load_campaign("quick.toml", overrides=["campaign.duration_s=1"])
    table = rj.run(config)                       # pandas: one row a run
    one = rj.simulate(config, 17)                # xarray.Dataset: time series of run 17
    chain = rj.explain(config, 17)               # pandas: which signal its fault reached when
    checks = rj.counterfactual(config)           # pandas: what further checks would have seen
    position, rotation = rj.forward_kinematics(jpos, "gold")
    software = rj.ControlSoftware()              # drive the control software alone

What `__all__` names here is public. Every other module and name is internal and may change with any
version. Names are imported when they are first used, so that `import ravenjax` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ravenjax.api import (
        calibrate_monitor,
        check_monitor,
        counterfactual,
        explain,
        open_results,
        run,
        simulate,
    )
    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.campaign.loading import load_campaign
    from ravenjax.errors import StoreError, UserError
    from ravenjax.notebook.axes import choice, loguniform, normal, phase, together, uniform
    from ravenjax.notebook.campaign import Campaign
    from ravenjax.notebook.results import CampaignResults
    from ravenjax.notebook.tables import (
        Detector,
        Fault,
        Group,
        Hand,
        Haptics,
        Limits,
        Operator,
        Outcomes,
        OwnCheck,
        OwnStages,
        Reaction,
        Run,
        Start,
        Stop,
    )
    from ravenjax.numbers.setup import Precision
    from ravenjax.robots.raven2.console.packet import Packet
    from ravenjax.robots.raven2.geometry.arrays import (
        forward_kinematics,
        gravity_torque,
        inverse_kinematics,
        joint_from_motor,
        motor_from_joint,
    )
    from ravenjax.robots.raven2.hardware.virtual_robot import VirtualRobot
    from ravenjax.robots.raven2.software.control_software import ControlSoftware

__version__ = "0.1.0"

_HOMES = {
    "load_campaign": "ravenjax.campaign.loading",
    "run": "ravenjax.api",
    "simulate": "ravenjax.api",
    "explain": "ravenjax.api",
    "counterfactual": "ravenjax.api",
    "calibrate_monitor": "ravenjax.api",
    "check_monitor": "ravenjax.api",
    "open_results": "ravenjax.api",
    "Campaign": "ravenjax.notebook.campaign",
    "CampaignResults": "ravenjax.notebook.results",
    "Detector": "ravenjax.notebook.tables",
    "Fault": "ravenjax.notebook.tables",
    "Group": "ravenjax.notebook.tables",
    "Hand": "ravenjax.notebook.tables",
    "Haptics": "ravenjax.notebook.tables",
    "Limits": "ravenjax.notebook.tables",
    "Operator": "ravenjax.notebook.tables",
    "Outcomes": "ravenjax.notebook.tables",
    "OwnCheck": "ravenjax.notebook.tables",
    "OwnStages": "ravenjax.notebook.tables",
    "Reaction": "ravenjax.notebook.tables",
    "Run": "ravenjax.notebook.tables",
    "Start": "ravenjax.notebook.tables",
    "Stop": "ravenjax.notebook.tables",
    "choice": "ravenjax.notebook.axes",
    "loguniform": "ravenjax.notebook.axes",
    "normal": "ravenjax.notebook.axes",
    "phase": "ravenjax.notebook.axes",
    "together": "ravenjax.notebook.axes",
    "uniform": "ravenjax.notebook.axes",
    "forward_kinematics": "ravenjax.robots.raven2.geometry.arrays",
    "inverse_kinematics": "ravenjax.robots.raven2.geometry.arrays",
    "motor_from_joint": "ravenjax.robots.raven2.geometry.arrays",
    "joint_from_motor": "ravenjax.robots.raven2.geometry.arrays",
    "gravity_torque": "ravenjax.robots.raven2.geometry.arrays",
    "ControlSoftware": "ravenjax.robots.raven2.software.control_software",
    "VirtualRobot": "ravenjax.robots.raven2.hardware.virtual_robot",
    "Packet": "ravenjax.robots.raven2.console.packet",
    "Precision": "ravenjax.numbers.setup",
    "CampaignConfig": "ravenjax.campaign.file.config",
    "UserError": "ravenjax.errors",
    "StoreError": "ravenjax.errors",
}

__all__ = [
    "Campaign",
    "CampaignConfig",
    "CampaignResults",
    "ControlSoftware",
    "Detector",
    "Fault",
    "Group",
    "Hand",
    "Haptics",
    "Limits",
    "Operator",
    "Outcomes",
    "OwnCheck",
    "OwnStages",
    "Packet",
    "Precision",
    "Reaction",
    "Run",
    "Start",
    "Stop",
    "StoreError",
    "UserError",
    "VirtualRobot",
    "calibrate_monitor",
    "check_monitor",
    "choice",
    "counterfactual",
    "explain",
    "forward_kinematics",
    "gravity_torque",
    "inverse_kinematics",
    "joint_from_motor",
    "load_campaign",
    "loguniform",
    "motor_from_joint",
    "normal",
    "open_results",
    "phase",
    "run",
    "simulate",
    "together",
    "uniform",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(
            f"module 'ravenjax' has no attribute {name!r}; it has {', '.join(__all__)}"
        )
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
