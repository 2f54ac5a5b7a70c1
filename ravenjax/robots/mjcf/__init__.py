"""Reads an arm from an MJCF file: mechanism, actuators, ranges, and the declaration of a robot."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import dataclasses
import functools
import math
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ravenjax import resources
from ravenjax.errors import UserError
from ravenjax.mechanics.mechanism import Mechanism, read_mechanism
from ravenjax.numbers import Vec
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.seams import Seam, SeamChannel
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import ARM, PARAMETER, Channel, ChannelRange, Site

_TABLES = resources.read_tables(__file__, "declaration.toml")
SITES = _TABLES["sites"]
"""Layer and place of each fault site, in the order of the tick; the site is the layer's code."""
CHECKS = {name: Check(name, *row) for name, row in _TABLES["checks"].items()}


@dataclasses.dataclass(frozen=True, eq=False)
class Arm:
    """A fixed base, hinges and slides, and at most one actuator for each joint.

    Vectors have one number per joint, in rad or m, and Nm or N. A servo exerts `gain` k control +
    `bias` - `stiffness` position - `damping` velocity, where k is `stiffness` of a position servo
    and `damping` of a velocity servo. A motor exerts `gain` control + `bias`.
    """

    mechanism: Mechanism
    period_ms: int  # of the controller
    steps: int  # time steps of the model in each period
    integrator: str  # of the model, if a tick replaces it
    tip: str  # name of its site
    kinds: tuple[str, ...]  # position, velocity or motor; "": no actuator
    home: Vec  # of the first keyframe, or of the model
    lower: Vec  # range of the joint, infinite without one
    upper: Vec
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

    name, package: those of a Python module that declares the robot. Raises UserError for features
    of the model that are not simulated.
    """
    # A changed file has another time, so `_read` does not return its stored result.
    return _read(file, file.stat().st_mtime_ns, name or str(file), package)


@functools.lru_cache(maxsize=16)
def _read(file: Path, changed_ns: int, name: str, package: str) -> ArmRobot:
    try:
        files = tuple(dict.fromkeys(mujoco.mju_getXMLDependencies(str(file))))
        arm, joints = _arm(mujoco.MjModel.from_xml_path(str(file)))
    except (UserError, ValueError, mujoco.FatalError) as error:
        raise UserError(f"robot {str(file)!r}: {error}") from None
    slides = [link.slide for link in arm.mechanism.links]

    def channels(site: str) -> tuple[Channel, ...]:
        if site == PARAMETER:
            return ()
        units = ("N m", "N") if site in ("torque", "actuator") else ("rad", "m")
        above = (ARM, "goal") if site == "packet" else (ARM,)
        return tuple(
            Channel(joint, (*above, k), "float", units[slides[k]])
            for k, joint in enumerate(joints)
            # Joints without an actuator have sensors only.
            if arm.kinds[k] or site in ("encoder", "sensor")
        ) + ((Channel("lost", (ARM, "lost"), "bool", "1", usual=0),) if site == "packet" else ())

    def signal(field: str, site: str, *against: str) -> Signal:
        units = tuple((c.name, c.unit) for c in sites[site].channels)
        return Signal(field, site, sites[site].where, units[0][1], joints, units, against=against)

    sites = {
        site: Site(site, site, site != PARAMETER, channels(site), where)
        for site, (_, where) in SITES.items()
    }

    limits = {"torque": arm.force, "actuator": arm.force}
    spans = (
        ChannelRange(site.name, "arm", joint, channel.unit, low[k], low[k], high[k], high[k])
        for site in sites.values()
        for low, high in [limits.get(site.name, (arm.lower, arm.upper))]
        for channel in site.channels
        for k, joint in enumerate(joints)
        if joint == channel.name
    )
    return ArmRobot(
        name=name,
        title=file.name,
        package=package,
        arms=("arm",),
        joints=joints,
        linear=tuple(joint for joint, slide in zip(joints, slides, strict=True) if slide),
        sites=sites,
        layers={site: layer for site, (layer, _) in SITES.items()},
        checks=CHECKS,
        run_levels=("stopped", "running"),
        live="no check has stopped the arm",
        seams={
            name: Seam(
                *(name, name, True),
                tuple(SeamChannel(c.name, c.unit, name, (name, *c.path)) for c in site.channels),
                site.where,
            )
            for name, site in sites.items()
            if site.channels
        },
        ranges={one[:3]: one for one in spans if math.isfinite(one.high - one.low)},
        series=_TABLES["series"],
        signals=(
            signal("jpos", "encoder", "jpos_d"),
            signal("jpos_d", "command"),
            signal("tau_d", "torque"),
        ),
        files=files,
        period_ms=arm.period_ms,
        arm=arm,
    )


def _arm(model: mujoco.MjModel) -> tuple[Arm, tuple[str, ...]]:
    # Returns the arm, and the names of its joints.
    sites = [model.site(k).name for k in range(model.nsite)]
    if not sites:
        raise UserError('expected a site at the tip, such as <site name="tip"/> in the last body')
    tip = "tip" if "tip" in sites else sites[-1]
    mechanism = read_mechanism(model, tip)
    numbers = [link.number for link in mechanism.links]
    names = [re.sub(r"\W", "_", link.joint) or f"joint{link.number}" for link in mechanism.links]
    if not numbers or len({*names}) < len(names):
        raise UserError(f"expected joints with names that differ, got {', '.join(names) or 'none'}")
    reach = np.where(model.jnt_limited, model.jnt_range.T, [[-math.inf], [math.inf]])[:, numbers]
    home = (model.key_qpos[0] if model.nkey else model.qpos0)[model.jnt_qposadr[numbers]]
    gain, constant, stiffness, damping = np.zeros((4, len(numbers)))
    control, force = np.full((2, 2, len(numbers)), [[-math.inf], [math.inf]])
    capped = model.jnt_actfrclimited[numbers] > 0
    force[:, capped] = model.jnt_actfrcrange[numbers][capped].T
    kinds = [""] * len(numbers)
    for a in range(model.nu):
        k = _driven(model, a, numbers, kinds)
        gear, factor = model.actuator_gear[a, 0], model.actuator_gainprm[a, 0]
        bias = model.actuator_biasprm[a, :3] * (model.actuator_biastype[a] != 0)
        kinds[k] = "position" if bias[1] else "velocity" if bias[2] else "motor"
        # MuJoCo: gear (factor control + bias[0] + gear (bias[1] position + bias[2] velocity)). The
        # control of `Arm` is this control times `unit`: a motor's force, or a servo's joint goal.
        # `Arm` writes its force as gain control, for a servo times the stiffness or the damping.
        unit = gear * factor if kinds[k] == "motor" else 1.0 / gear
        constant[k] = gear * bias[0]
        stiffness[k], damping[k] = -(gear**2) * bias[1:]
        force_per_control = gear * factor / unit
        gain[k] = force_per_control / (stiffness[k] or damping[k] or 1.0)
        if model.actuator_ctrllimited[a]:
            control[:, k] = sorted(model.actuator_ctrlrange[a] * unit)
        if model.actuator_forcelimited[a]:
            force[:, k] = np.clip(sorted(model.actuator_forcerange[a] * gear), *force[:, k])
    if not any(kinds):
        raise UserError('expected an actuator, such as <position joint="elbow" kp="100"/>')
    columns = home, *reach, gain, constant, stiffness, damping
    vectors = [Vec(column.tolist()) for column in columns]
    bounds = [(Vec(low.tolist()), Vec(high.tolist())) for low, high in (control, force)]
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    integrator = integrator if integrator != "IMPLICITFAST" else ""
    # The fields of `Arm` in order.
    first_fields = mechanism, *_period(model), integrator, tip, tuple(kinds)
    return Arm(*first_fields, *vectors, *bounds), tuple(names)


LONGEST_MS = 100
"""Longest period of a controller."""


def _period(model: mujoco.MjModel) -> tuple[int, int]:
    """Return the controller's period, ms, and its number of time steps of the model. The period is
    the model's number `period_ms`. Without this number, the period is the shortest whole number of
    milliseconds that consists of whole time steps. Raises UserError.
    """
    step_ms = model.opt.timestep * 1e3
    # If a step is n / d ms, as 2 / 5 ms, then d steps are n ms. No smaller number is whole.
    period = float(Fraction(step_ms).limit_denominator(LONGEST_MS).numerator)
    if "period_ms" in (model.numeric(k).name for k in range(model.nnumeric)):
        period = float(model.numeric("period_ms").data[0])
    steps = round(period / step_ms)
    if period % 1 or not 1 <= period <= LONGEST_MS or abs(steps * step_ms / period - 1) > 1e-5:
        raise UserError(
            f"got a period of {period:g} ms and time steps of {step_ms:g} ms, expected a period of"
            f" whole milliseconds, at most {LONGEST_MS}, that consists of whole time steps. Write"
            ' another <option timestep="0.001"/>, or, for example, <custom><numeric'
            ' name="period_ms" data="2"/></custom>'
        )
    return int(period), steps


def _driven(model: mujoco.MjModel, a: int, joints: list[int], kinds: list[str]) -> int:
    """Return the index in `joints` of the joint that actuator `a` drives. Raises UserError. joints:
    numbers in the model. kinds: kind of the actuator found so far for each of them; "": none.
    """
    name = model.actuator(a).name or f"number {a}"
    # Type 0 is: transmission to a joint, no dynamics, fixed gain, no bias. Bias type 1 is affine.
    types = model.actuator_trntype, model.actuator_dyntype, model.actuator_gaintype
    if any(types_of[a] != 0 for types_of in types) or model.actuator_biastype[a] not in (0, 1):
        raise UserError(
            f"actuator {name}: expected one of <position>, <velocity> and <motor> on a joint,"
            " without dynamics"
        )
    index = joints.index(int(model.actuator_trnid[a, 0]))
    if kinds[index]:
        raise UserError(f"actuator {name}: its joint has two actuators, expected only one")
    return index
