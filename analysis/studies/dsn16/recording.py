"""Runs the virtual robot in the closed loop of the 2015 fork with a recorded robot's desired
motion, and compares its errors with those of null models.

The public recording (CSLDepend/raven2_sim) holds 21 s of a real gold arm in pedal-down
teleoperation: motors of shoulder, elbow and insertion at 1 kHz, and their DAC. It lacks the desired
motion, but the PD law can be inverted: mpos_d = mpos + (tau + KD mvel) / KP. The environment
variable RAVENJAX_DATA names its folder. A single recording is no sample, so errors have no
interval.
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import Controller, LoopState
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup
from studies.study import Table

DATA, FILE = "RAVENJAX_DATA", "recording_gold_joints123.parquet"
JOINTS = ("shoulder", "elbow", "insertion")
SETUP = RavenSetup(software="fork2015", precision=REFERENCE)
ARM, TOOL = "gold", "r_grasper"
# rad; the recording lacks the tool joints, which are held at home.
TOOL_POSE = (
    0.0,
    0.0,
    math.radians(45),
    math.radians(45),
)
KP, KD = np.array((0.3, 0.3, 0.15)), np.array((0.008, 0.008, 0.012))  # raven2: params/r2params.yaml
TOOL_KP, TOOL_KD = (0.09, 0.05, 0.02, 0.02), (0.001, 0.0, 0.0, 0.0)  # of the fork
CONTROLLER = Controller(Vec((*KP, *TOOL_KP)), Vec((*KD, *TOOL_KD)), Vec.full(7, 0.0), filtered=True)
"""The fork's controller without the integral that `position_loop.FORK2015` has at the tool, because
the recording has no tool joints.
"""

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


def find(environment: Mapping[str, str] | None = None) -> Path | None:
    """Return the recording's file; None if it is not available."""
    return locate(FILE, environment)


def locate(name: str, environment: Mapping[str, str] | None = None) -> Path | None:
    """Return a public recording by the name of its file; None if it is not available."""
    folder = (os.environ if environment is None else environment).get(DATA)
    path = Path(folder or ".") / name
    return path if folder and path.is_file() else None


def read(path: Path) -> JointRecording:
    """Read the recording, without its first row."""
    table = pd.read_parquet(path).iloc[1:]
    angle = np.radians(table[[f"mpos_{joint}_deg" for joint in JOINTS]].to_numpy(float))
    speed = np.radians(table[[f"mvel_{joint}_deg_s" for joint in JOINTS]].to_numpy(float))
    return JointRecording(angle, speed, table[[f"dac_{joint}" for joint in JOINTS]].to_numpy(float))


def motors(three: np.ndarray, still: bool = False) -> Vec:
    """Return seven motors from three. The tool's motors follow the insertion and hold its
    joints.
    """
    pose = Vec((0.0, 0.0, 0.0, *((0.0,) * 4 if still else TOOL_POSE)))
    tool = transmission.motor_from_joint(ARM, TOOL, pose, three[2], "fork2015")[3:]
    return Vec((three[0], three[1], three[2], *tool))


def started(params: robot.PlantParams, angle: np.ndarray, speed: np.ndarray) -> robot.PlantState:
    """Return the state with brakes off and motors at `angle` (rad, 3) and `speed` (rad/s, 3).

    Links start where loaded cables then hold them.
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
    """Run the fork's loop on the virtual robot: filtered encoders, PD, truncation. `asked`: desired
    motor angles (rad, [T, 3]).

    Return mpos and mvel [T, 7] (rad, rad/s), jpos [T, 7] (rad and m, of the links), dac [T, 7]
    (counts). Needs 64-bit numbers.
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
    """Return a function (first angle, first speed [3], rows [T, 3]) -> (mpos, jpos, dac, mvel),
    each [T, 7], to be compiled.

    `rows`: the meaning of the rows. The tool's motors are held at home by their controller.
    `cables`: factor on stiffness and damping of every cable; use 0 with
    `position_loop.bare_rotors`.
    """
    of_loop = replace(position_loop.params(params), cables=cables)
    pose = Vec((0.0, 0.0, 0.0, *TOOL_POSE))

    def tick(state: LoopState, row: jax.Array):
        def desired(insertion: jax.Array) -> Vec:
            tool = transmission.motor_from_joint(ARM, TOOL, pose, insertion, "fork2015")[3:]
            return Vec((row[0], row[1], row[2], *tool))

        def written(counts: Vec) -> Vec:
            return Vec((*row, *counts[3:])) if rows == "dac" else counts

        state, out, cycle = position_loop.advance_cycle(
            SETUP, ARM, CONTROLLER, of_loop, state, desired, written
        )
        return state, (
            jnp.stack(out.mpos),
            jnp.stack(out.jpos),
            jnp.stack(cycle.counts),
            jnp.stack(cycle.speed),
        )

    def run(angle, speed, rows):
        start = position_loop.start_state(SETUP, CONTROLLER, started(params, angle, speed))
        return jax.lax.scan(tick, start, rows)[1]

    return run


HORIZONS_MS = (20, 50, 128)
EVERY_MS = 200
"""Time from one start to the next."""
CLOSED, OPEN, NO_LOOP = "closed loop", "open loop", "no loop"
"""Input of the robot: its desired motion, the recorded DAC, or none."""
HELD_POSITION, HELD_VELOCITY = "null: hold the position", "null: hold the velocity"
SETS = ("power_consistent", "traj3")
"""Parameter sets of the virtual robots that are compared."""
ROTORS = "null: bare rotors"


class Model(NamedTuple):
    """A virtual robot, or its rotors with every cable cut."""

    name: str
    params: robot.PlantParams
    cables: float  # factor on the stiffness and damping of every cable


def virtual_robots(setup: RavenSetup, arm: ArmName) -> list[Model]:
    """Return the virtual robot with each set, and the bare rotors of each."""
    sets = {name: robot.params(setup, arm, name) for name in SETS}
    robots = [Model(f"virtual robot, {name}", params, 1.0) for name, params in sets.items()]
    rotors = [
        Model(f"{ROTORS}, {name}", position_loop.bare_rotors(params), 0.0)
        for name, params in sets.items()
    ]
    return [*robots, *rotors]


class RecordedStretch(NamedTuple):
    """A part of a recording to which nothing was fitted; arrays [n, joints], with rows `period_ms`
    apart.
    """

    angle: np.ndarray  # measured at the motors, in the unit of its joint
    speed: np.ndarray  # per s, computed from the row and earlier ones
    period_ms: float
    units: dict[str, str]  # maps a joint to deg or mm

    def rows(self, horizon_ms: float) -> int:
        """Return the number of rows nearest to a horizon."""
        return round(horizon_ms / self.period_ms)

    @property
    def starts(self) -> np.ndarray:
        """Return the rows from which short predictions start. The longest prediction ends inside
        the part.
        """
        return np.arange(0, len(self.angle) - self.rows(max(HORIZONS_MS)), self.rows(EVERY_MS))


Ahead = Callable[[np.ndarray, int], np.ndarray]
"""Maps (starts [s], rows) to the joints of the next `rows` rows after each start, [s, rows,
joints].
"""


class Predictor(NamedTuple):
    """A robot or a null model that predicts a stretch."""

    loop: str
    model: str
    ahead: Ahead


class HorizonError(NamedTuple):
    """Absolute errors of one model at one horizon, by joint in the stretch's units."""

    loop: str
    model: str
    horizon_ms: int | None  # None: the whole stretch, from its beginning
    mean: np.ndarray
    largest: np.ndarray


def held(part: RecordedStretch) -> tuple[Predictor, Predictor]:
    """Return the two null models that need no robot."""

    def ahead(velocity: float) -> Ahead:
        def run(starts: np.ndarray, rows: int) -> np.ndarray:
            seconds = np.arange(1, rows + 1)[:, None] * part.period_ms * 1e-3
            return part.angle[starts, None] + velocity * part.speed[starts, None] * seconds

        return run

    return Predictor(NO_LOOP, HELD_POSITION, ahead(0.0)), Predictor(
        NO_LOOP, HELD_VELOCITY, ahead(1.0)
    )


def horizon_errors(part: RecordedStretch, models: Sequence[Predictor]) -> list[HorizonError]:
    """Return the errors of every model, and of the models of `held`, at every horizon and over the
    whole stretch.
    """
    ends = [part.rows(horizon) for horizon in HORIZONS_MS]
    errors = []
    for loop, model, ahead in (*models, *held(part)):
        short = ahead(part.starts, max(ends))
        for horizon, end in zip(HORIZONS_MS, ends, strict=True):
            errors.append(
                _error(loop, model, horizon, short[:, end - 1] - part.angle[part.starts + end])
            )
        whole = ahead(np.zeros(1, int), len(part.angle) - 1)[0]
        errors.append(_error(loop, model, None, whole - part.angle[1:]))
    return errors


def _error(loop: str, model: str, horizon_ms: int | None, apart: np.ndarray) -> HorizonError:
    return HorizonError(
        loop, model, horizon_ms, np.abs(apart).mean(axis=0), np.abs(apart).max(axis=0)
    )


TO_JOINT = np.array((180.0 / math.pi, 180.0 / math.pi, 1e3)) / np.array(transmission.TR[:3])
"""deg, deg and mm of the joint per rad of its motor."""
UNITS = {"shoulder": "deg", "elbow": "deg", "insertion": "mm"}
LOOPS: dict[Rows, str] = {"asked": CLOSED, "dac": OPEN}


def second_half(log: JointRecording) -> JointRecording:
    """Return the half of the recording to which no parameter of any set was fitted here."""
    return JointRecording(*(part[len(log.angle) // 2 :] for part in log))


def recorded_stretch(log: JointRecording) -> RecordedStretch:
    """Return all of `log`, at the joints."""
    return RecordedStretch(log.angle * TO_JOINT, log.speed * TO_JOINT, 1.0, UNITS)


def predictors_of(log: JointRecording) -> list[Predictor]:
    """Return every robot and its rotors in both loops. Needs 64-bit numbers."""
    models = virtual_robots(SETUP, ARM)
    predictors = []
    for rows, name in LOOPS.items():
        run = _compiled(rows)
        predictors += [
            Predictor(name, model.name, _ahead(log, rows, model, run)) for model in models
        ]
    return predictors


def _compiled(rows: Rows) -> Callable[..., jax.Array]:
    """Compile (parameters, cables, angles and speeds [s, 3], inputs [s, T, 3]) -> motors
    [s, T, 7].
    """

    def run(params, cables, angle, speed, inputs):
        return jax.vmap(loop(rows, params, cables))(angle, speed, inputs)[0]

    return jax.jit(run)


def _ahead(log: JointRecording, rows: Rows, model: Model, run: Callable[..., jax.Array]) -> Ahead:
    inputs = log.asked if rows == "asked" else log.dac

    def ahead(starts: np.ndarray, length: int) -> np.ndarray:
        windows = np.stack([inputs[start : start + length] for start in starts])
        motors = run(
            model.params,
            model.cables,
            *map(jnp.asarray, (log.angle[starts], log.speed[starts], windows)),
        )
        return np.asarray(motors)[:, :, :3] * TO_JOINT

    return ahead


PREDICTION_NOTE = (
    f"On the half of the recording that no parameter was fitted to. Every {EVERY_MS} ms a"
    " prediction starts from the recorded joints and speeds; whole: one prediction from the"
    " beginning of that half to its end. Closed loop: asked for what the recorded robot was asked"
    " for; open loop: the motors get the recorded DAC. A null model knows nothing of the arm; bare"
    " rotors are motors with viscous friction whose cables are all cut. Mean of the absolute"
    " errors, then the largest. One recording is no sample, so there is no interval."
)


def prediction_table(title: str, part: RecordedStretch, errors: Sequence[HorizonError]) -> Table:
    """Return a table with one row per model and horizon."""
    rows = tuple(
        (
            one.loop,
            one.model,
            "whole" if one.horizon_ms is None else one.horizon_ms,
            *(f"{mean:.3f}, {most:.2f}" for mean, most in zip(one.mean, one.largest, strict=True)),
        )
        for one in errors
    )
    heads = (f"{joint}, {unit}" for joint, unit in part.units.items())
    return Table(title, ("driven in", "model", "horizon, ms", *heads), rows, PREDICTION_NOTE)


def prediction_sentences(part: RecordedStretch, errors: Sequence[HorizonError]) -> Iterator[str]:
    """Say for each virtual robot in each loop where it predicts better than a held velocity, and
    than every null model.
    """
    by_name = {(one.loop, one.model, one.horizon_ms): one for one in errors}
    for (loop, model), mine in _robots(errors).items():
        where = []
        for one in mine:
            velocity = by_name[NO_LOOP, HELD_VELOCITY, one.horizon_ms]
            where.append(f"{_when(one)} at {_joints(part, one.mean < velocity.mean)}")
        best = sum(
            int((one.mean < np.min([null.mean for null in _nulls(errors, one)], axis=0)).sum())
            for one in mine
        )
        cells = len(mine) * len(part.units)
        yield (
            f"{model[0].upper()}{model[1:]}, {loop}: its mean error is smaller than that of a held"
            f" velocity {'; '.join(where)}. It is smaller than that of every null model in {best}"
            f" of {cells} comparisons, one a joint and horizon."
        )


def _robots(errors: Sequence[HorizonError]) -> dict[tuple[str, str], list[HorizonError]]:
    robots: dict[tuple[str, str], list[HorizonError]] = {}
    for one in errors:
        if not _is_null(one):
            robots.setdefault((one.loop, one.model), []).append(one)
    return robots


def _nulls(errors: Sequence[HorizonError], beside: HorizonError) -> list[HorizonError]:
    loops = (beside.loop, NO_LOOP)
    return [
        one
        for one in errors
        if _is_null(one) and one.horizon_ms == beside.horizon_ms and one.loop in loops
    ]


def _is_null(one: HorizonError) -> bool:
    return one.model.startswith("null")


def _when(one: HorizonError) -> str:
    return "over the whole" if one.horizon_ms is None else f"after {one.horizon_ms} ms"


def _joints(part: RecordedStretch, better: np.ndarray) -> str:
    """Write `every joint`, `no joint`, or `2 of 3 joints (shoulder, elbow)`."""
    names = [joint for joint, is_better in zip(part.units, better, strict=True) if is_better]
    if len(names) in (0, len(part.units)):
        return "every joint" if names else "no joint"
    return f"{len(names)} of {len(part.units)} joints ({', '.join(names)})"
