"""The virtual robot in the closed loop of the 2015 fork, asked for what a recorded one was asked for.

The public recording (CSLDepend/raven2_sim) holds 21 s of a real gold arm in pedal-down teleoperation: motors of
shoulder, elbow and insertion at 1 kHz, and their DAC. What the robot was asked to do is not in it, but its PD law can
be inverted: mpos_d = mpos + (tau + KD mvel) / KP. It lies where the environment variable RAVENJAX_DATA says.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.estimator import LOW_PASS_INPUT, LOW_PASS_OUTPUT

DATA, FILE = "RAVENJAX_DATA", "recording_gold_joints123.parquet"
JOINTS = ("shoulder", "elbow", "insertion")
SETUP = RavenSetup(software="fork2015", precision=REFERENCE)
ARM, TOOL = "gold", "r_grasper"
TOOL_POSE = (0.0, 0.0, math.radians(45), math.radians(45))  # rad; the recording has no tool joints: held at home
KP, KD = np.array((0.3, 0.3, 0.15)), np.array((0.008, 0.008, 0.012))  # raven2: params/r2params.yaml
TOOL_KP, TOOL_KD = (0.09, 0.05, 0.02, 0.02), (0.001, 0.0, 0.0, 0.0)  # of the fork

Rows = Literal["asked", "dac"]
"""What drives motors 1-3: desired angles (rad) in closed loop, DAC counts in open loop."""
Run = Callable[[jax.Array, jax.Array, jax.Array], tuple[jax.Array, jax.Array, jax.Array, jax.Array]]


class JointRecording(NamedTuple):
    """Joints 1-3 of the recorded arm, each [T, 3]."""

    angle: np.ndarray  # rad, motors
    speed: np.ndarray  # rad/s, motors
    dac: np.ndarray  # counts

    @property
    def asked(self) -> np.ndarray:
        """Desired motor angles (rad) that its PD law implies."""
        torque = -self.dac / np.array(transmission.COUNTS_PER_NM[:3])
        return self.angle + (torque + KD * self.speed) / KP


def find(environment: Mapping[str, str] | None = None) -> Path | None:
    """The recording's file; None where it is not at hand."""
    return locate(FILE, environment)


def locate(name: str, environment: Mapping[str, str] | None = None) -> Path | None:
    """A public recording by the name of its file; None where it is not at hand."""
    folder = (os.environ if environment is None else environment).get(DATA)
    path = Path(folder or ".") / name
    return path if folder and path.is_file() else None


def read(path: Path) -> JointRecording:
    """The recording, without its first row."""
    table = pd.read_parquet(path).iloc[1:]
    angle = np.radians(table[[f"mpos_{joint}_deg" for joint in JOINTS]].to_numpy(float))
    speed = np.radians(table[[f"mvel_{joint}_deg_s" for joint in JOINTS]].to_numpy(float))
    return JointRecording(angle, speed, table[[f"dac_{joint}" for joint in JOINTS]].to_numpy(float))


def motors(three: np.ndarray, still: bool = False) -> Vec:
    """Seven motors from three: the tool's follow the insertion and hold its joints."""
    pose = Vec((0.0, 0.0, 0.0, *((0.0,) * 4 if still else TOOL_POSE)))
    tool = transmission.motor_from_joint(ARM, TOOL, pose, three[2], "fork2015")[3:]
    return Vec((three[0], three[1], three[2], *tool))


def started(params: robot.PlantParams, angle: np.ndarray, speed: np.ndarray) -> robot.PlantState:
    """Brakes off, motors at `angle` (rad, 3) and `speed` (rad/s, 3), links where loaded cables then hold them."""
    slack = transmission.joint_from_motor(ARM, TOOL, motors(angle), "fork2015")
    stretch = robot.init(SETUP, ARM, params, slack).stretch
    jpos0 = slack - transmission.joint_from_motor(ARM, TOOL, stretch, "fork2015")
    state = robot.init(SETUP, ARM, params, jpos0)
    mvel = motors(speed, still=True)
    jvel = transmission.joint_from_motor(ARM, TOOL, mvel, "fork2015")
    return replace(state, mvel=mvel, jvel=jvel, brakes=replace(state.brakes, engaged=jnp.int32(0)))


def closed_loop(
    asked: np.ndarray, first_angle: np.ndarray, first_speed: np.ndarray, parameter_set: str = "traj3"
) -> dict[str, np.ndarray]:
    """The fork's loop on the virtual robot: filtered encoders, PD, truncation; `asked` motor angles (rad, [T, 3]).

    mpos and mvel [T, 7] (rad, rad/s), jpos [T, 7] (rad and m, of the links), dac [T, 7] (counts). Needs 64 bits.
    """
    run = jax.jit(loop("asked", robot.params(SETUP, ARM, parameter_set)))
    mpos, jpos, counts, speed = run(jnp.asarray(first_angle), jnp.asarray(first_speed), jnp.asarray(asked))
    return {name: np.asarray(x) for name, x in (("mpos", mpos), ("jpos", jpos), ("dac", counts), ("mvel", speed))}


def loop(rows: Rows, params: robot.PlantParams, cables: Any = 1.0) -> Run:
    """(first angle, first speed [3], rows [T, 3]) -> (mpos, jpos, dac, mvel), each [T, 7], to be compiled.

    rows: what is in them; the tool's motors are held at home by their controller. cables: times the stiffness and
    damping of every cable; 0 with `replay.bare_rotors`.
    """
    reading, drive = (signs(ARM, TOOL, "fork2015") for signs in (transmission.encoder_signs, transmission.tau_signs))
    kp, kd = Vec((*KP, *TOOL_KP)), Vec((*KD, *TOOL_KD))

    def read(state):
        out = robot.observe(SETUP, ARM, params, state)
        return jnp.stack([s * e * transmission.ENCODER_RAD for s, e in zip(reading, out.enc_val, strict=True)])

    def tick(carry, row):
        state, raw, smooth = carry
        new = read(state)
        raw = jnp.stack([new, *raw[:3]])
        filtered = jnp.array(LOW_PASS_INPUT) @ raw + jnp.array(LOW_PASS_OUTPUT) @ smooth
        speed = (filtered - smooth[0]) / 1e-3
        smooth = jnp.stack([filtered, *smooth[:2]])
        pose = Vec((0.0, 0.0, 0.0, *TOOL_POSE))
        tool = transmission.motor_from_joint(ARM, TOOL, pose, filtered[2], "fork2015")[3:]
        desired = Vec((row[0], row[1], row[2], *tool))
        tau = (desired - Vec(filtered)) * kp - Vec(speed) * kd
        counts = (tau * transmission.COUNTS_PER_NM * drive).map(lambda x: jnp.trunc(x).astype(jnp.int32))
        if rows == "dac":
            counts = Vec((*(row[i].astype(jnp.int32) for i in range(3)), *counts[3:]))
        signal = replace(robot.nominal_signal(counts, jnp.int32(0)), cable_scale=Vec.full(len(counts), cables))
        state, out = robot.step(SETUP, ARM, params, state, signal)
        return (state, raw, smooth), (jnp.stack(out.mpos), jnp.stack(out.jpos), jnp.stack(counts), speed)

    def run(angle, speed, rows):
        start = started(params, angle, speed)
        history = jnp.stack([read(start)] * 4)
        return jax.lax.scan(tick, (start, history, history[:3]), rows)[1]

    return run


def tips(mpos: np.ndarray) -> np.ndarray:
    """Tip (m) of forward-coupled motor angles, tool joints ideal."""

    def tip(three):
        jpos = transmission.joint_from_motor(ARM, TOOL, motors(three), "fork2015")
        return jnp.stack(kinematics.forward(ARM, Vec((*jpos[:3], *TOOL_POSE))).position)

    return np.asarray(jax.jit(jax.vmap(tip))(jnp.asarray(mpos)))
