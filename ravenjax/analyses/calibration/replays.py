"""Replays a log of joint positions with many sets of robot parameters at once.

A replay simulates an arm whose controller follows the log's desired joint positions. This module
defines the functions of `ravenjax.engines.interface.Loop`, so every engine can run replays. The
input has seven columns of desired joint positions, one row per control cycle. The output contains
the joint positions computed from simulated motor encoders.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ravenjax import threads
from ravenjax.analyses.calibration import parameters, position_loop
from ravenjax.analyses.calibration.fit import Predictor
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.parameters import Unknown
from ravenjax.analyses.calibration.position_loop import Controller, LoopParams, LoopState
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, TickProgram
from ravenjax.numbers import paths
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Scalar, Vec, record, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup


@dataclasses.dataclass(frozen=True)
class ReplaySetup(RavenSetup):
    """Settings that select the code of a replay of one arm."""

    controller: Controller = position_loop.RAVEN2
    shifted: bool = False  # True: the controller may receive the desired joints with a delay
    # True: encoders and DAC use whole counts. Without whole counts, a replay has a derivative.
    whole_counts: bool = True


@record
class ReplayParams:
    """Parameters of one replay."""

    loop: LoopParams
    first: Vec  # joints at the start of the log, rad and m


def init(setup: ReplaySetup, params: ReplayParams) -> LoopState:
    """Return the state at rest with brakes off. The motors show the first measured positions."""
    (arm,), links = setup.arms, params.first
    plant = robot.init(setup, arm, params.loop.plant, links)
    # Gravity stretches the cables, so motors and links differ. One correction by the difference,
    # links + (links - shown), makes the motors show the measured positions.
    shown = _joints_of_motors(setup, plant, False)
    plant = robot.init(setup, arm, params.loop.plant, links * 2.0 - shown)
    plant = replace(plant, brakes=replace(plant.brakes, engaged=jnp.int32(0)))
    return position_loop.start_state(setup, setup.controller, plant, setup.whole_counts)


def advance(
    setup: ReplaySetup,
    params: ReplayParams,
    faults: Any,
    state: LoopState,
    now: Scalar,
    motion: tuple[Any, ...],
    golden: Any,
) -> tuple[LoopState, tuple[Scalar, ...], tuple[()]]:
    """Compute one cycle, as a function of `ravenjax.engines.interface.Loop`.

    Faults and golden runs are not used.
    """
    (arm,), (tool,) = setup.arms, setup.tools
    row = Vec(column[now] for column in motion)
    # A delay of 0.3 ms gives 0.7 of this cycle's desired joints and 0.3 of the last cycle's.
    if setup.shifted:
        before = Vec(column[jnp.maximum(now - 1, 0)] for column in motion)
        row = row - (row - before) * params.loop.setpoint_delay

    def desired(insertion: Scalar) -> Vec:
        return transmission.motor_from_joint(arm, tool, row, insertion, setup.software)

    state, _, _ = position_loop.advance_cycle(
        setup, arm, setup.controller, params.loop, state, desired, whole_counts=setup.whole_counts
    )
    return state, tuple(_joints_of_motors(setup, state.plant, setup.whole_counts)), ()


def _joints_of_motors(setup: ReplaySetup, plant: robot.PlantState, whole_counts: bool) -> Vec:
    """Return joint positions computed from the motors' encoders, rad and m."""
    motors = position_loop.read_encoders(setup, plant, whole_counts)
    return transmission.joint_from_motor(setup.arms[0], setup.tools[0], motors, setup.software)


def series_length(setup: ReplaySetup) -> int:
    """Return the number of output values per cycle, one per joint."""
    return position_loop.JOINTS


def outcomes(setup: ReplaySetup, params: ReplayParams, state: LoopState) -> dict[str, Any]:
    """Return the number of simulated ticks, the only outcome of a replay."""
    return {"ticks": state.plant.tick}


def setup_of(
    setup: RavenSetup, arm: ArmName, controller: Controller, wanted: Sequence[Unknown]
) -> ReplaySetup:
    """Return the settings that replays of one arm need to estimate `wanted`."""
    fields = {field for unknown in wanted for field in unknown.fields}
    return ReplaySetup(
        software=setup.software,
        arms=(arm,),
        tools=(setup.tools[setup.arms.index(arm)],),
        precision=setup.precision,
        controller=controller,
        command_delay=parameters.LONGEST_DELAY_MS if parameters.COMMAND_DELAY in fields else 0,
        shifted=parameters.SETPOINT_DELAY in fields,
    )


def make_predictor(
    setup: ReplaySetup, base: LoopParams, wanted: Sequence[Unknown], log: JointLog
) -> Predictor:
    """Return a predictor that replays a log from its beginning and its first measured joints."""
    # Only the paths of these values are used: steps of 0 serve as well as others.
    varied = parameters.values_by_path(base, wanted, np.zeros((1, len(wanted))))
    replay = _replays(setup, base, tuple(varied), log)
    return lambda steps: replay(parameters.values_by_path(base, wanted, steps), len(steps))


def replay_robots(setup: ReplaySetup, several: Sequence[LoopParams], log: JointLog) -> np.ndarray:
    """Replay a log with several robots. Return joints [robots, n, 7] at n samples, rad and m."""
    robots = [dict(paths.path_leaves(params, setup)) for params in several]
    columns = {path: np.array([float(robot[path]) for robot in robots]) for path in robots[0]}
    # Parameters that are equal in all robots are compiled as constants.
    varied = {path: column for path, column in columns.items() if (column != column[0]).any()}
    return _replays(setup, several[0], tuple(varied), log)(varied, len(several))


def _replays(
    setup: ReplaySetup, base: LoopParams, varied: tuple[str, ...], log: JointLog
) -> Callable[[Mapping[str, np.ndarray], int], np.ndarray]:
    """Return a function that replays a log, compiled once for the parameters that vary. Its
    arguments are arrays [count] by the path of a parameter, and count, the number of parameter
    sets. It returns joint positions [count, n, 7].
    """
    # A joint without a measured start begins at its desired position.
    first = np.where(np.isnan(log.start), log.desired[0], log.start)
    # The parameters of a program must be plain numbers.
    plain = jax.tree.map(lambda x: float(x) if isinstance(x, jax.Array) else x, base)
    params = ReplayParams(plain, Vec(np.float32(x) for x in first))
    names = tuple(f"loop.{path}" for path in varied)
    program = TickProgram(__name__, setup, params, names, len(log.desired))
    motion = tuple(np.ascontiguousarray(column, np.float32) for column in log.desired.T)
    engine = selection.select_engine("simd", setup.precision)
    compiled = functools.cache(functools.partial(engine.compile, program))

    def replay(values: Mapping[str, np.ndarray], count: int) -> np.ndarray:
        kernel = compiled(count)
        columns = {f"loop.{path}": np.asarray(values[path], np.float32) for path in varied}

        def replay_block(start: int) -> np.ndarray:
            # Replays the parameter sets from number `start`, one in each lane of the kernel.
            # Returns joints [sets, n, 7] at the times of the log's n samples.
            set_count = min(kernel.lanes, count - start)
            # `size` rounds up to whole vectors. Lanes that are left over repeat the last set.
            set_of_lane = np.minimum(start + np.arange(kernel.size(set_count)), count - 1)
            of_block = {path: column[set_of_lane] for path, column in columns.items()}
            # A kernel names its time series `reference`: here the joints [cycles, 7, lanes].
            joints = kernel.run(Block(of_block, (), None), motion).reference
            return np.moveaxis(joints[log.cycles, :, :set_count], -1, 0).astype(np.float64)

        return np.concatenate(threads.map_in_threads(replay_block, range(0, count, kernel.lanes)))

    return replay
