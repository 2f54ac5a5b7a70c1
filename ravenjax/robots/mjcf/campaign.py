"""Campaigns of an arm from an MJCF file: its campaign tables, motion, parameters and series."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import dataclasses
import functools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import Field, model_validator

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.location import Complaint
from ravenjax.campaign.file.section import Section
from ravenjax.campaign.prepared import Prepared, shared_choices, shared_parameters
from ravenjax.errors import UserError
from ravenjax.mechanics import mechanism
from ravenjax.numbers import Vec
from ravenjax.numbers.setup import Injection, Precision
from ravenjax.robots.mjcf import loop
from ravenjax.robots.mjcf.loop import UNLIMITED, ArmSetup, Params
from ravenjax.stages import detectors
from ravenjax.stages.acted import add_action as acted
from ravenjax.store.motion.resampling import continuous_turns

__all__ = ["Config", "Params", "acted", "prepare"]


class Operator(Section):
    """[operator]: set points of all joints."""

    motion: Literal["sines", "tip"] = "sines"
    """sines: of all joints, around the start; tip: set points that move the tip along a path"""
    tip: tuple[tuple[float, ...], ...] = ()
    """of motion tip: [s, x, y, z] of each place in the frame of the file, m; rests at both ends.
    With an orientation: [s, x, y, z, qw, qx, qy, qz], a quaternion in the same frame"""
    file: Path | None = None
    """of motion tip: CSV file with a header and these columns, instead of the key tip"""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """seed of the frequency and the direction of each joint"""
    amplitude: float = Field(default=0.05, gt=0.0, le=0.5)
    """amplitude, as a share of the joint's range; of one turn without a range"""
    hz: float = Field(default=0.2, gt=0.0, le=50.0)
    """mean frequency, Hz; each joint has 0.5 to 1.5 times as much"""

    @model_validator(mode="after")
    def _fits(self) -> "Operator":
        keys = self.model_dump(exclude_defaults=True).keys() - {"motion"}
        path_keys = keys & {"tip", "file"}
        has_path_alone = len(path_keys) == 1 and keys == path_keys
        keys_fit = has_path_alone if self.motion == "tip" else not path_keys
        if not keys_fit:
            raise ValueError("motion 'tip' takes tip or file; 'sines' takes seed, amplitude and hz")
        # All rows have 4 numbers, or 8 with a quaternion, which may not be zero.
        sizes = {len(row) for row in self.tip}
        has_orientations = all(any(row[4:]) for row in self.tip)
        if sizes not in (set(), {4}) and not (sizes == {8} and has_orientations):
            raise ValueError("tip: expected rows of [time_s, x, y, z]; qw, qx, qy, qz may follow")
        return self


class Config(CampaignConfig):
    """A whole campaign file of an arm."""

    operator: Operator = Operator()
    changeable: ClassVar[str] = (
        "lower|upper|tracking|velocity|watchdog|sensor|effort|k|gravity|coasting"
    )

    def with_files(self, folder: Path) -> CampaignConfig:
        """Return the campaign with absolute paths of Python files, and the tip's path of `file`."""
        config, file = super().with_files(folder), self.operator.file
        if file is None:
            return config
        try:
            rows = np.loadtxt(folder / file, delimiter=",", skiprows=1, ndmin=2)
            operator = Operator(motion="tip", tip=rows.tolist())
        except (OSError, ValueError, UserError) as error:
            raise UserError(f"operator.file {file}: {error}") from None
        return config.model_copy(update={"operator": operator})

    @property
    def operator_label(self) -> str:
        """Name of the operator's motion in tables."""
        return self.operator.motion

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield (heading, text) of what the file says about robot and operator."""
        yield from super().lines()
        arm, operator = self._arm, self.operator
        yield (
            "joints, rad or m",
            ", ".join(
                f"{joint} ({kind or 'passive'}, {low:.4g} to {high:.4g})"
                for joint, kind, _, low, high in self._joints()
            ),
        )
        home = mechanism.tip_position(arm.mechanism, arm.home)
        # `+ 0` writes 0 for -0.
        position = ", ".join(f"{round(float(x), 4) + 0:g}" for x in home)
        yield "tip", f"site {arm.tip}, at {position} m in the home position"
        yield "tick", f"{arm.period_ms} ms, time steps of the model: {arm.steps}"
        sines = f"sines of {operator.amplitude:g} of the ranges, {operator.hz:g} Hz at the mean"
        yield "operator", f"tip through {len(operator.tip)} places" if operator.tip else sines

    def complaints(self) -> Iterator[Complaint]:
        """Yield (key, message) of mistakes, as `CampaignConfig.complaints` does."""
        yield from super().complaints()
        for number, detector in enumerate(self.detector):
            if detector.file is None:
                yield ("detector", number, "kind"), "an arm supports only detectors with a file"
        # Without a fault, a campaign may serve only to list parameters, so it needs no gains.
        motors = self._without_gain("motor")
        if motors and any(group.fault for group in self.group):
            reason = f"a <motor> alone does not hold its joint ({', '.join(motors)}) at a set point"
            message = f"expected a gain: {reason}; write kp, and kd for damping"
            yield ("parameters", f"kp.{motors[0]}"), message

    def notices(self) -> Iterator[Complaint]:
        """Yield (key, message) of what a user may not expect, as `CampaignConfig.notices` does."""
        yield from super().notices()
        axes = self.axes_by_path
        # A path is a check's name, or also names a joint: `tracking`, `tracking.elbow`. The joints'
        # ranges, which the model has, are the limits of `joint_limit`.
        limited = {path.partition(".")[0] for path in axes}
        for name in sorted(self.robot.checks.keys() - {"joint_limit"} - limited):
            yield ("parameters", name), f"the check {name} has no limit, so it never trips"
        slides = self.robot.linear
        has_both_kinds = 0 < len(slides) < len(self.robot.joints)
        for name in ("tracking", "velocity", "sensor"):
            if has_both_kinds and name in axes:
                yield (
                    ("parameters", name),
                    "one number limits rotating joints, in rad, and sliding joints, in m; write a"
                    f" limit for each joint, such as {name}.{slides[0]}",
                )
        tip = self.operator.tip
        if tip and tip[-1][0] > self.campaign.duration_s:
            yield ("operator", "tip"), "the run ends before the time of the path's last place"
        for joint in self._without_gain("velocity", "motor"):
            yield ("parameters", f"kp.{joint}"), "no gain: nothing holds the joint at its set point"
        robot = "campaign", "robot"
        for joint, _, home, low, high in self._joints():
            if not low <= home <= high:
                yield robot, f"home of {joint} is {home:.4g}, not in {low:.4g} to {high:.4g}"
        arm = self._arm
        step_ms = arm.mechanism.timestep * 1e3
        # A time step of 1 ms may be rounded.
        if step_ms < 0.999:
            message = f"time steps of {step_ms:g} ms, but the controller runs once in"
            yield robot, f"{message} {arm.period_ms} ms"
        if arm.integrator:
            yield (
                robot,
                f"the model has integrator {arm.integrator}; this has no effect, because an arm"
                " moves with the integrator implicitfast",
            )

    @property
    def _arm(self) -> Any:
        robot: Any = self.robot
        return robot.arm

    def _joints(self) -> Iterator[Any]:
        # Yields each joint's name, kind of actuator, home and range.
        arm = self._arm
        return zip(self.robot.joints, arm.kinds, arm.home, arm.lower, arm.upper, strict=True)

    def _without_gain(self, *kinds: str) -> list[str]:
        # Returns the joints whose actuator is of one of these kinds and for which no kp is written.
        return [
            joint
            for joint, kind, *_ in self._joints()
            if kind in kinds and not self.axes_by_path.keys() & {"kp", f"kp.{joint}"}
        ]

    def deciding(self) -> dict[str, Any]:
        """See `CampaignConfig.deciding`. The code hash has the content of the MJCF file."""
        tables = super().deciding()
        tables["campaign"]["robot"] = Path(self.campaign.robot).name
        return tables | {"operator": self.operator.model_dump(exclude_defaults=True)}


def prepare(
    config: Any, varied: Mapping[str, np.ndarray], injection: Injection, precision: Precision
) -> Prepared:
    """Return setup, default parameters and motion of a campaign. varied: values of the parameters
    that differ between runs, which are not needed.
    """
    arm, unlimited = config.robot.arm, Vec.full(len(config.robot.joints), UNLIMITED)
    setup = ArmSetup(robot=config.robot, **shared_choices(config, injection, precision))
    move = _along if config.operator.tip else _sines
    # The set points of each joint in each tick.
    columns = move(config.operator, config.robot, config.campaign.ticks)
    thresholds = tuple(thresholds for _, _, thresholds in config.detectors)
    params = Params(
        start=Vec(float(column[0]) for column in columns),
        lower=arm.lower.map(max, -UNLIMITED),
        upper=arm.upper.map(min, UNLIMITED),
        tracking=unlimited,
        velocity=unlimited,
        watchdog=UNLIMITED,
        sensor=unlimited,
        sensor_ms=0.0,
        effort=unlimited,
        effort_ms=0.0,
        kp=arm.stiffness,
        kd=arm.damping,
        gravity=1.0,
        coasting=0.9,
        detectors=dataclasses.replace(detectors.watch_params(setup), thresholds=thresholds),
        **shared_parameters(config),
    )
    return Prepared(loop, setup, params, columns)


RAMP_S = 0.5
"""Time in which the motion starts."""


def _sines(operator: Operator, robot, ticks: int) -> tuple[np.ndarray, ...]:
    """Return the set points of each joint, float32 [ticks]: sines around its home position."""
    arm = robot.arm
    rng = np.random.default_rng(operator.seed)
    time_s = np.arange(ticks) * robot.period_ms / 1e3
    # The amplitude grows smoothly from 0 to its value.
    share = np.clip(time_s / RAMP_S, 0, 1)
    share = share**2 * (3 - 2 * share)
    columns = []
    for home, low, high in zip(arm.home, arm.lower, arm.upper, strict=True):
        amplitude = operator.amplitude * (high - low if np.isfinite(high - low) else 2 * np.pi)
        # The sign is the direction in which the joint begins to move.
        hz = operator.hz * rng.uniform(0.5, 1.5) * rng.choice((-1, 1))
        # Moved away from the ends of the range, so that the sine stays inside.
        middle = np.clip(home, low + amplitude, high - amplitude)
        sine = np.sin(2 * np.pi * hz * time_s)
        columns.append((middle + amplitude * share * sine).astype(np.float32))
    return tuple(columns)


TOLERANCE = 1e-2
"""Largest distance of the tip of the set points from its path, mm, and largest angle, degrees."""
LEVER_M = 0.1
"""Distance that counts as much as an angle of 1 rad."""
DAMPING_M, STEP_M, TRIES = 0.1, 2e-2, 200
"""Damping of the inverse kinematics for each metre that is left, longest way of the tip in one of
its iterations, and the number of iterations.
"""


@functools.lru_cache(maxsize=8)
def _along(operator: Operator, robot: Any, ticks: int) -> tuple[np.ndarray, ...]:
    """Return the set points of each joint that move the tip along its path, float32 [ticks].
    Each tick's joints are found by damped least squares, from the tick before. Raises UserError.
    """
    from scipy.interpolate import CubicSpline

    arm, rows = robot.arm, np.array(operator.tip)
    if any(not c.limit for c in arm.mechanism.constraints):
        raise UserError("operator.motion: 'tip' needs an arm without coupled joints; write 'sines'")
    rows[:, 4:] = continuous_turns(rows[:, 4:])
    try:
        path = CubicSpline(rows[:, 0], rows[:, 1:], bc_type="clamped")
    except ValueError as error:
        raise UserError(f"operator.tip, times and places: {error}") from None
    path = path(np.clip(np.arange(ticks) * robot.period_ms / 1e3, *rows[[0, -1], 0]))
    path[:, 3:] /= np.linalg.norm(path[:, 3:], axis=1, keepdims=True)

    model = mujoco.MjModel.from_xml_path(robot.files[0])
    data, site = mujoco.MjData(model), model.site(arm.tip).id
    driven = np.array([kind != "" for kind in arm.kinds])
    weights = np.outer([1.0] * 3 + [LEVER_M] * 3, driven)
    ways, quat, turn, found, left = np.zeros_like(weights), np.zeros(4), np.zeros(3), [], []
    # A straight arm cannot begin to move along itself.
    joints = np.array(arm.home) + 1e-2 * driven
    for goal in path:
        for _ in range(TRIES):
            data.qpos[:] = joints
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, ways[:3], ways[3:], site)
            off = goal[:3] - data.site_xpos[site]
            if len(goal) > 3:
                frame = data.site_xmat[site]
                mujoco.mju_mat2Quat(quat, frame)
                mujoco.mju_subQuat(turn, goal[3:], quat)
                off = np.append(off, LEVER_M * frame.reshape(3, 3) @ turn)
            if (distance := math.hypot(*off)) < 1e-8:
                break
            rows = (ways * weights)[: len(off)]
            square = rows @ rows.T + DAMPING_M * distance * np.eye(len(off))
            step = rows.T @ np.linalg.solve(square, off * min(1.0, STEP_M / distance))
            joints = np.clip(joints + step, arm.lower, arm.upper)
        found.append(joints)
        left.append(math.hypot(*off[3:]) / LEVER_M)
    columns = tuple(np.array(found, np.float32).T)
    tip = mechanism.tip_position(arm.mechanism, Vec(columns))
    apart = np.sqrt(sum((x - y) ** 2 for x, y in zip(tip, path.T[:3], strict=True)))
    off = np.maximum(apart * 1e3, np.degrees(left))
    if off[tick := off.argmax()] > TOLERANCE:
        turned = f" and {np.degrees(left[tick]):.3g} degrees" * (len(goal) > 3)
        raise UserError(
            f"operator.tip: the tip cannot reach {path[tick].round(4).tolist()} m at"
            f" {tick * robot.period_ms} ms: it"
            f" stays {apart[tick] * 1e3:.3g} mm{turned} away, with each joint in its range"
        )
    return columns
