"""Runs the virtual robot with the 2015 fork's controller and a recorded robot's desired motion.

The public recording (CSLDepend/raven2_sim) has 21 s of a real gold arm in teleoperation: motors of
shoulder, elbow and insertion at 1 kHz, and their DAC commands. The desired motion is computed by
inverting the PD law: mpos_d = mpos + (tau + KD mvel) / KP. RAVENJAX_DATA names the folder of the
recording. One recording is not a sample, so errors have no interval.
"""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import Controller, LoopState
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

DATA, FILE = "RAVENJAX_DATA", "recording_gold_joints123.parquet"
JOINTS = ("shoulder", "elbow", "insertion")
SETUP = RavenSetup(software="fork2015", precision=REFERENCE)
ARM, TOOL = "gold", "r_grasper"
TOOL_POSE = (0.0, 0.0, math.radians(45), math.radians(45))
"""rad. The recording lacks the tool joints, which are held at home."""
KP, KD = np.array((0.3, 0.3, 0.15)), np.array((0.008, 0.008, 0.012))  # raven2: params/r2params.yaml
TOOL_KP, TOOL_KD = (0.09, 0.05, 0.02, 0.02), (0.001, 0.0, 0.0, 0.0)  # of the fork
CONTROLLER = Controller(Vec((*KP, *TOOL_KP)), Vec((*KD, *TOOL_KD)), Vec.full(7, 0.0), filtered=True)
"""The fork's controller without the integral at the tool, as the recording has no tool joints."""

Rows = Literal["asked", "dac"]
"""Input of motors 1-3: desired angles (rad) in closed loop, or DAC counts in open loop."""
Run = Callable[[jax.Array, jax.Array, jax.Array], tuple[jax.Array, jax.Array, jax.Array, jax.Array]]


class JointRecording(NamedTuple):
    """Joints 1-3 of the recorded arm, each [T, 3]."""

    angle: np.ndarray  # rad, motors
    speed: np.ndarray  # rad/s, motors
    dac: np.ndarray  # counts

    @property
    def asked(self) -> np.ndarray:
        """Return the desired motor angles (rad) that the PD law implies."""
        torque = -self.dac / np.array(transmission.COUNTS_PER_NM[:3])
        return self.angle + (torque + KD * self.speed) / KP


def locate(name: str) -> Path | None:
    """Return a public recording by the name of its file; None if it is not available."""
    folder = os.environ.get(DATA)
    path = Path(folder or ".") / name
    return path if folder and path.is_file() else None


def read(path: Path) -> JointRecording:
    """Read the recording, without its first row."""
    table = pd.read_parquet(path).iloc[1:]
    angle, speed, dac = (
        table[[form.format(joint) for joint in JOINTS]].to_numpy(float)
        for form in ("mpos_{}_deg", "mvel_{}_deg_s", "dac_{}")
    )
    return JointRecording(np.radians(angle), np.radians(speed), dac)


def motors(three: Any, still: bool = False) -> Vec:
    """Return seven motors from three. The tool's motors follow the insertion."""
    pose = Vec((0.0, 0.0, 0.0, *((0.0,) * 4 if still else TOOL_POSE)))
    tool = transmission.motor_from_joint(ARM, TOOL, pose, three[2], "fork2015")[3:]
    return Vec((three[0], three[1], three[2], *tool))


def started(params: robot.PlantParams, angle: np.ndarray, speed: np.ndarray) -> robot.PlantState:
    """Return the state with brakes off and motors at `angle` (rad, 3) and `speed` (rad/s, 3)."""
    slack = transmission.joint_from_motor(ARM, TOOL, motors(angle), "fork2015")
    stretch = robot.init(SETUP, ARM, params, slack).stretch
    jpos0 = slack - transmission.joint_from_motor(ARM, TOOL, stretch, "fork2015")
    state = robot.init(SETUP, ARM, params, jpos0)
    mvel = motors(speed, still=True)
    jvel = transmission.joint_from_motor(ARM, TOOL, mvel, "fork2015")
    return replace(state, mvel=mvel, jvel=jvel, brakes=replace(state.brakes, engaged=jnp.int32(0)))


def closed_loop(
    asked: np.ndarray, angle: np.ndarray, speed: np.ndarray, parameter_set: str
) -> dict[str, np.ndarray]:
    """Run the fork's loop on the virtual robot for desired motor angles (rad, [T, 3]), from motors
    at `angle` (rad, [3]) and `speed` (rad/s, [3]). Return mpos and mvel (rad, rad/s), jpos (rad and
    m, of the links) and dac (counts), [T, 7] each. Needs 64-bit numbers.
    """
    run = jax.jit(loop("asked", robot.params(SETUP, ARM, parameter_set)))
    found = run(*map(jnp.asarray, (angle, speed, asked)))
    return dict(zip(("mpos", "jpos", "dac", "mvel"), map(np.asarray, found), strict=True))


def loop(rows: Rows, params: robot.PlantParams, cables: Any = 1.0) -> Run:
    """Return a function (first angle, first speed [3], rows [T, 3]) -> (mpos, jpos, dac, mvel),
    each [T, 7], to be compiled. `cables`: factor on stiffness and damping of every cable; use 0
    with `position_loop.bare_rotors`.
    """
    of_loop = replace(position_loop.params(params), cables=cables)

    def tick(state: LoopState, row: jax.Array):
        def desired(insertion: jax.Array) -> Vec:
            return motors((row[0], row[1], insertion)).replace(2, row[2])

        def written(counts: Vec) -> Vec:
            return Vec((*row, *counts[3:])) if rows == "dac" else counts

        state, out, cycle = position_loop.advance_cycle(
            SETUP, ARM, CONTROLLER, of_loop, state, desired, written
        )
        return state, tuple(map(jnp.stack, (out.mpos, out.jpos, cycle.counts, cycle.speed)))

    def run(angle, speed, rows):
        start = position_loop.start_state(SETUP, CONTROLLER, started(params, angle, speed))
        return jax.lax.scan(tick, start, rows)[1]

    return run


TO_JOINT = np.array((180.0 / math.pi, 180.0 / math.pi, 1e3)) / np.array(transmission.TR[:3])
"""deg, deg and mm of the joint per rad of its motor."""
UNITS = {"shoulder": "deg", "elbow": "deg", "insertion": "mm"}


def second_half(log: JointRecording) -> JointRecording:
    """Return the half of the recording to which no parameter of any set was fitted here."""
    return JointRecording(*(part[len(log.angle) // 2 :] for part in log))
