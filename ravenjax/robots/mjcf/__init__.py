"""Reads an arm from an MJCF file: mechanism, actuators, ranges, and the declaration of a robot."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import dataclasses
import functools
import math
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ravenjax.errors import UserError
from ravenjax.mechanics.mechanism import Mechanism, read_mechanism
from ravenjax.numbers import Vec
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.seams import Seam, SeamChannel
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import ARM, Channel, Site

TICK_S = 1e-3

SITES = {
    "packet": ("L1", "set points from the network, before the checks"),
    "encoder": ("L2", "joint positions as checks and controller read them"),
    "command": ("L3", "set points of the controller, after the joint limits"),
    "torque": ("L4", "forces of the controller, after the checks"),
    "actuator": ("L5", "forces of the actuators, within their range"),
}
"""Layer and place of each fault site, in the order of the tick."""
LAYERS = {
    "L1": "network",
    "L2": "encoders",
    "L3": "set points",
    "L4": "control output",
    "L5": "actuators",
}
CHECKS = {
    check.name: check
    for check in (
        Check("tracking", "rad or m", "encoder too far from the set point, stops", "stop"),
        Check("velocity", "rad/s or m/s", "encoder too fast, stops", "stop"),
        Check("watchdog", "ms", "no packet for too long, stops", "stop"),
        Check("joint_limit", "rad or m", "set point clipped to the joint's range", "limit"),
    )
}


@dataclasses.dataclass(frozen=True, eq=False)
class Arm:
    """A fixed base, hinges and slides, and at most one actuator for each joint.

    Vectors have one number per joint, in rad or m, and Nm or N. An actuator exerts `gain` control +
    `bias` - `stiffness` position - `damping` velocity.
    """

    mechanism: Mechanism
    tip: str  # name of its site
    home: Vec  # of the first keyframe, or of the model
    lower: Vec  # range of the joint, infinite without one
    upper: Vec
    kinds: tuple[str, ...]  # position, velocity or motor; "": no actuator
    gain: Vec
    bias: Vec
    stiffness: Vec
    damping: Vec
    control: tuple[Vec, Vec]  # least and largest control
    force: tuple[Vec, Vec]  # least and largest force


@dataclasses.dataclass(frozen=True, eq=False)
class ArmRobot(Robot):
    """The declaration of an arm from an MJCF file."""

    arm: Any = None


def read_robot(file: Path, name: str = "", package: str = "ravenjax.robots.mjcf") -> ArmRobot:
    """Return the robot of an MJCF file. Its tip is the site `tip`, or the last site.

    name, package: of a Python module that declares it. Raises UserError that names what the
    simulation does not have.
    """
    return _read(file, file.stat().st_mtime_ns, name or str(file), package)


@functools.lru_cache(maxsize=16)
def _read(file: Path, changed_ns: int, name: str, package: str) -> ArmRobot:
    try:
        files = tuple(dict.fromkeys(mujoco.mju_getXMLDependencies(str(file))))
        arm, joints = _arm(mujoco.MjModel.from_xml_path(str(file)))
    except (UserError, ValueError, mujoco.FatalError) as error:
        raise UserError(f"robot {str(file)!r}: {error}") from None
    slides = [link.slide for link in arm.mechanism.links]
    linear = tuple(joint for joint, slide in zip(joints, slides, strict=True) if slide)

    def channels(site: str) -> tuple[Channel, ...]:
        units = ("N m", "N") if site in ("torque", "actuator") else ("rad", "m")
        above = (ARM, "goal") if site == "packet" else (ARM,)
        return tuple(
            Channel(joint, (*above, k), "float", units[slides[k]])
            for k, joint in enumerate(joints)
            if arm.kinds[k] or site == "encoder"
        )

    lost = (Channel("lost", (ARM, "lost"), "bool", "1", usual=0),)

    def signal(field: str, site: str, *against: str) -> Signal:
        units = tuple((c.name, c.unit) for c in channels(site))
        layer, where = SITES[site]
        return Signal(field, layer, where, units[0][1], joints, units, against=against)

    return ArmRobot(
        name=name,
        title=f"arm {file.stem}",
        package=package,
        arms=("arm",),
        joints=joints,
        linear=linear,
        sites={
            site: Site(site, layer, True, channels(site) + lost * (site == "packet"), where)
            for site, (layer, where) in SITES.items()
        },
        layers=LAYERS,
        checks=CHECKS,
        run_levels=("stopped", "running"),
        live="no check has stopped the arm",
        seams={
            site: Seam(
                *(site, layer, True),
                tuple(SeamChannel(c.name, c.unit, "", c.path) for c in channels(site)),
                where,
            )
            for site, (layer, where) in SITES.items()
        },
        signals=(
            signal("jpos", "encoder", "jpos_d"),
            signal("jpos_d", "command"),
            signal("tau_d", "torque"),
        ),
        files=files,
        arm=arm,
    )


def _arm(model: mujoco.MjModel) -> tuple[Arm, tuple[str, ...]]:
    sites = [model.site(k).name for k in range(model.nsite)]
    if not sites:
        raise UserError('expected a site at the tip, such as <site name="tip"/> in the last body')
    tip = "tip" if "tip" in sites else sites[-1]
    mechanism = dataclasses.replace(read_mechanism(model, tip), timestep=TICK_S)
    numbers = [link.number for link in mechanism.links]
    names = [re.sub(r"\W", "_", link.joint) or f"joint{link.number}" for link in mechanism.links]
    if not numbers or len({*names}) < len(names):
        raise UserError(f"expected joints with names that differ, got {', '.join(names) or 'none'}")
    n, infinite = len(numbers), math.inf
    columns = {
        "lower": np.where(model.jnt_limited, model.jnt_range[:, 0], -infinite)[numbers],
        "upper": np.where(model.jnt_limited, model.jnt_range[:, 1], infinite)[numbers],
        "home": (model.key_qpos[0] if model.nkey else model.qpos0)[model.jnt_qposadr[numbers]],
        **{name: np.zeros(n) for name in ("gain", "bias", "stiffness", "damping")},
    }
    control, force = ([np.full(n, -infinite), np.full(n, infinite)] for _ in range(2))
    capped = model.jnt_actfrclimited[numbers].astype(bool)
    for side in (0, 1):
        force[side][capped] = model.jnt_actfrcrange[numbers][capped, side]
    kinds = [""] * n
    for a in range(model.nu):
        place = _driven(model, a, numbers, kinds)
        gear, gain = model.actuator_gear[a, 0], model.actuator_gainprm[a, 0]
        bias = model.actuator_biasprm[a, :3] * (model.actuator_biastype[a] != 0)
        kinds[place] = "position" if bias[1] else "velocity" if bias[2] else "motor"
        # The control of a motor is its force; that of a servo is in the joint's unit.
        unit = gear * gain if kinds[place] == "motor" else 1.0 / gear
        columns["gain"][place] = gear * gain / unit
        columns["bias"][place] = gear * bias[0]
        columns["stiffness"][place], columns["damping"][place] = -(gear**2) * bias[1:]
        for least, largest, limited, reach, factor in (
            (*control, model.actuator_ctrllimited, model.actuator_ctrlrange, unit),
            (*force, model.actuator_forcelimited, model.actuator_forcerange, gear),
        ):
            if limited[a]:
                low, high = sorted(reach[a] * factor)
                least[place], largest[place] = max(low, least[place]), min(high, largest[place])
    vectors = {name: Vec(column.tolist()) for name, column in columns.items()}
    pairs = [(Vec(low.tolist()), Vec(high.tolist())) for low, high in (control, force)]
    return Arm(mechanism, tip, kinds=tuple(kinds), control=pairs[0], force=pairs[1], **vectors), (
        *names,
    )


def _driven(model: mujoco.MjModel, a: int, numbers: list[int], kinds: list[str]) -> int:
    """Return the place of the joint that actuator `a` drives. Raises UserError."""
    name = model.actuator(a).name or f"number {a}"
    kinds_of = (model.actuator_trntype, model.actuator_dyntype, model.actuator_gaintype)
    if any(kind[a] != 0 for kind in kinds_of) or model.actuator_biastype[a] not in (0, 1):
        raise UserError(
            f"actuator {name}: expected one of <position>, <velocity> and <motor> on a joint,"
            " without dynamics"
        )
    place = numbers.index(int(model.actuator_trnid[a, 0]))
    if kinds[place]:
        raise UserError(f"actuator {name}: its joint has another one; expected one for each joint")
    return place
