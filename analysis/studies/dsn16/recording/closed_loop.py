"""The virtual robot in the closed loop of the 2015 fork, asked for what a recorded one was asked
for.

The public recording (CSLDepend/raven2_sim) holds 21 s of a real gold arm in pedal-down
teleoperation: motors of shoulder, elbow and insertion at 1 kHz, and their DAC. What the robot was
asked to do is not in it, but its PD law can be inverted: mpos_d = mpos + (tau + KD mvel) / KP. It
lies where the environment variable RAVENJAX_DATA says.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import Controller, LoopState
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

DATA, FILE = "RAVENJAX_DATA", "recording_gold_joints123.parquet"
JOINTS = ("shoulder", "elbow", "insertion")
SETUP = RavenSetup(software="fork2015", precision=REFERENCE)
ARM, TOOL = "gold", "r_grasper"
TOOL_POSE = (
    0.0,
    0.0,
    math.radians(45),
    math.radians(45),
)  # rad; the recording has no tool joints: held at home
KP, KD = np.array((0.3, 0.3, 0.15)), np.array((0.008, 0.008, 0.012))  # raven2: params/r2params.yaml
TOOL_KP, TOOL_KD = (0.09, 0.05, 0.02, 0.02), (0.001, 0.0, 0.0, 0.0)  # of the fork
CONTROLLER = Controller(Vec((*KP, *TOOL_KP)), Vec((*KD, *TOOL_KD)), Vec.full(7, 0.0), filtered=True)
"""Without the integral that `position_loop.FORK2015` has at the tool: the recording has no tool
joints to drive.
"""

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
    """Brakes off, motors at `angle` (rad, 3) and `speed` (rad/s, 3), links where loaded cables
    then hold them.
    """
    slack = transmission.joint_from_motor(ARM, TOOL, motors(angle), "fork2015")
    stretch = robot.init(SETUP, ARM, params, slack).stretch
    jpos0 = slack - transmission.joint_from_motor(ARM, TOOL, stretch, "fork2015")
    state = robot.init(SETUP, ARM, params, jpos0)
    mvel = motors(speed, still=True)
    jvel = transmission.joint_from_motor(ARM, TOOL, mvel, "fork2015")
    return replace(state, mvel=mvel, jvel=jvel, brakes=replace(state.brakes, engaged=jnp.int32(0)))


def closed_loop(
    asked: np.ndarray,
    first_angle: np.ndarray,
    first_speed: np.ndarray,
    parameter_set: str = "traj3",
) -> dict[str, np.ndarray]:
    """The fork's loop on the virtual robot: filtered encoders, PD, truncation; `asked` motor angles
    (rad, [T, 3]).

    mpos and mvel [T, 7] (rad, rad/s), jpos [T, 7] (rad and m, of the links), dac [T, 7] (counts).
    Needs 64 bits.
    """
    run = jax.jit(loop("asked", robot.params(SETUP, ARM, parameter_set)))
    mpos, jpos, counts, speed = run(
        jnp.asarray(first_angle), jnp.asarray(first_speed), jnp.asarray(asked)
    )
    return {
        name: np.asarray(x)
        for name, x in (("mpos", mpos), ("jpos", jpos), ("dac", counts), ("mvel", speed))
    }


def loop(rows: Rows, params: robot.PlantParams, cables: Any = 1.0) -> Run:
    """(first angle, first speed [3], rows [T, 3]) -> (mpos, jpos, dac, mvel), each [T, 7], to be
    compiled.

    rows: what is in them; the tool's motors are held at home by their controller. cables: times the
    stiffness and damping of every cable; 0 with `replay.bare_rotors`.
    """
    of_loop = replace(position_loop.params(params), cables=cables)
    pose = Vec((0.0, 0.0, 0.0, *TOOL_POSE))

    def tick(state: LoopState, row: jax.Array):
        def desired(insertion: jax.Array) -> Vec:
            tool = transmission.motor_from_joint(ARM, TOOL, pose, insertion, "fork2015")[3:]
            return Vec((row[0], row[1], row[2], *tool))

        def written(counts: Vec) -> Vec:
            return Vec((*row, *counts[3:])) if rows == "dac" else counts

        state, out, cycle = position_loop.cycle(
            SETUP, ARM, CONTROLLER, of_loop, state, desired, written
        )
        return state, (
            jnp.stack(out.mpos),
            jnp.stack(out.jpos),
            jnp.stack(cycle.counts),
            jnp.stack(cycle.speed),
        )

    def run(angle, speed, rows):
        start = position_loop.start(SETUP, ARM, CONTROLLER, started(params, angle, speed))
        return jax.lax.scan(tick, start, rows)[1]

    return run


def tips(mpos: np.ndarray) -> np.ndarray:
    """Tip (m) of forward-coupled motor angles, tool joints ideal."""

    def tip(three):
        jpos = transmission.joint_from_motor(ARM, TOOL, motors(three), "fork2015")
        return jnp.stack(kinematics.forward(ARM, Vec((*jpos[:3], *TOOL_POSE))).position)

    return np.asarray(jax.jit(jax.vmap(tip))(jnp.asarray(mpos)))
