"""Simulates many fault-free operations and returns the scores of candidate checks for each.

Each operator has a different motion. Each operation of an operator has a different robot.

A fault-free run equals its golden run, so each operation is computed once. Only a row of outcomes
is kept of each operation, without time series, so memory hardly grows with the number of
operations. A GPU computes all robots of an operator in parallel.
"""

import dataclasses
import math
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from ravenjax import interruption
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.fault_free import MS_PER_HOUR, fault_free_tables
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.memory_windows import take_rows
from ravenjax.campaign.plan import Plan
from ravenjax.engines.interface import NO_REFERENCE, Block, Kernel, TickProgram
from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.report import wording
from ravenjax.store.access import fault_free

CALIBRATION_STREAM, NEW_STREAM = 0, 1
"""Streams of operators. The two streams share no operator."""
MAX_PARALLEL_OPERATORS = 32
"""Largest number of operators whose operations are computed in parallel."""


@dataclasses.dataclass(frozen=True)
class OperationDesign:
    """The random design of the operations."""

    motions: tuple[str, ...]  # generated motions; each operator has one of them
    robots: int  # number of operations per operator, each with a different robot
    length_s: float  # duration of an operation
    seed: int
    stream: int = CALIBRATION_STREAM

    def operator(self, number: int) -> tuple[str, int]:
        """Return motion and random seed of an operator. They depend only on number and design."""
        rng = np.random.default_rng([self.seed, self.stream, number])
        return self.motions[int(rng.integers(len(self.motions)))], int(rng.integers(2**31))


@dataclasses.dataclass(frozen=True, eq=False)
class OperatorScores:
    """The operations of one operator; arrays with one entry per operation."""

    operator: int
    motion: str
    seed: int
    score: np.ndarray  # float32 [operations, detectors], maximum; NaN for a failed run
    hours: np.ndarray  # time in which the detectors were active


def fault_free_campaign(config: CampaignConfig, design: OperationDesign) -> CampaignConfig:
    """Return `config` as a fault-free campaign with the duration of the design's operations.

    If the design has several robots, or a parameter has a list, robots are drawn at random. Groups,
    [reaction] and [stop] are left out.
    """
    has_list = any(axis.kind == "list" for axis in config.parameters.values())
    # 0: no robots are drawn, so the campaign has one run.
    drawn_robots = design.robots if design.robots > 1 or has_list else 0
    raw = config.model_dump(mode="json")
    settings = {"name": "fault_free", "duration_s": design.length_s, "observe_ms": None}
    return validate_tables(fault_free_tables(raw, drawn_robots, **settings))


def campaign_of_operator(
    campaign: CampaignConfig, design: OperationDesign, number: int
) -> CampaignConfig:
    """Return `campaign` with the motion and the random seed of the operator `number`."""
    motion, seed = design.operator(number)
    # The table `operator` depends on the robot, so its type is not known.
    config: Any = campaign
    settings = config.campaign.model_copy(update={"seed": seed})
    operator = config.operator.model_copy(update={"motion": motion, "seed": seed})
    return config.model_copy(update={"campaign": settings, "operator": operator})


def require_runnable(config: CampaignConfig, design: OperationDesign) -> None:
    """Raise UserError unless `config` can run as fault-free operations of different operators."""
    # A robot that does not list its motions may have those of the design.
    names = config.generated_motions() or design.motions
    robot_varies = (
        config.campaign.noise
        or config.random_packets
        or any(axis.drawn for axis in config.parameters.values())
    )
    # The template writes the first reason why the campaign cannot run, or nothing.
    template = wording.text_templates(__package__).get_template("unrunnable.txt.j2")
    problem = template.render(
        config=config,
        design=design,
        operator=config.model_dump(mode="json").get("operator") or {},
        names=names,
        unknown=[motion for motion in design.motions if motion not in names],
        same_for_every_seed=[motion for motion in design.motions if motion in fault_free.UNVARIED],
        robots_are_equal=design.robots > 1 and not robot_varies,
        describe_unknown_name=describe_unknown_name,
    )
    if problem:
        raise UserError(problem.strip())


class OperationRunner:
    """Computes operations of a campaign. The code is compiled once."""

    def __init__(self, config: CampaignConfig, design: OperationDesign, engine: str):
        """Choose an engine. Raise UserError for a campaign that cannot run without faults."""
        require_runnable(config, design)
        self.config, self.design = fault_free_campaign(config, design), design
        self._first = plan.make_plan(campaign_of_operator(self.config, design, 0))
        self._engine = compile_cache.cached_engine(engine, self._first.program.setup.precision)
        self.engine = f"{self._engine.name} on {self._engine.device}"
        self.detectors = tuple(name for name, *_ in config.detectors)
        self._thread_data, self._compile_lock = threading.local(), threading.Lock()

    def compute(self, numbers: Sequence[int]) -> Iterator[OperatorScores]:
        """Yield the scores of these operators in order. Several are computed in parallel. Closing
        the iterator cancels operators that have not begun.
        """
        # Enough operators to fill all lanes that the engine computes at the same time. While their
        # operations are computed, one more thread plans the next operator.
        parallel_lanes = self._kernel(self._first).branches
        operators = min(MAX_PARALLEL_OPERATORS, math.ceil(parallel_lanes / self.design.robots))
        threads = 1 + max(self._engine.threads, operators)
        with ThreadPoolExecutor(threads) as pool:
            pending: deque[Future[OperatorScores]] = deque()
            try:
                for number in numbers:
                    pending.append(pool.submit(self._operator, number))
                    # Two operators per thread keep all threads busy. More would use memory.
                    if len(pending) == 2 * threads:
                        yield interruption.wait_for_result(pending.popleft())
                while pending:
                    yield interruption.wait_for_result(pending.popleft())
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def _operator(self, number: int) -> OperatorScores:
        # Computes all operations of the operator `number`, in blocks that fill the kernel's lanes.
        planned = plan.make_plan(campaign_of_operator(self.config, self.design, number))
        assert planned.runs == self.design.robots
        kernel = self._kernel(planned)
        scores, hours = [], []
        for first in range(0, planned.runs, kernel.lanes):
            rows = np.arange(first, min(first + kernel.lanes, planned.runs))
            block_scores, block_hours = self._block(planned, kernel, rows)
            scores.append(block_scores)
            hours.append(block_hours)
        motion, seed = self.design.operator(number)
        return OperatorScores(number, motion, seed, np.concatenate(scores), np.concatenate(hours))

    def _block(
        self, planned: Plan, kernel: Kernel, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the runs `rows` of a plan, without faults. Return scores [rows, detectors], NaN
        for failed runs, and the hours [rows] in which the detectors were active.
        """
        lanes = kernel.size(len(rows))
        block = Block(*planned.lanes(rows, lanes, harmless=True), NO_REFERENCE)
        # The kernel may have more lanes than rows. The additional lanes are not used.
        outcomes = take_rows(kernel.run(block, planned.columns).outcomes, slice(len(rows)))
        columns = [outcomes[f"detector{d}_score"] for d in range(len(self.detectors))]
        scores = np.stack(columns, axis=1).astype(np.float32)
        scores[outcomes["failed_ms"] >= 0] = np.nan
        # Detectors are active from `armed_after` (ms) on. If robots differ, the latest time counts.
        active_ms = outcomes["pedal_down_ms"] - int(planned.numbers("detectors.armed_after").max())
        return scores, np.maximum(active_ms, 0) / MS_PER_HOUR

    def _kernel(self, planned: Plan) -> Kernel:
        """Return the compiled kernel of a plan's program.

        A kernel is used again for an equal program, as operators with generated motions have. Each
        thread has a separate kernel, so that a GPU can compute several blocks in parallel.
        """
        kernels: list[tuple[TickProgram, Kernel]] = self._thread_data.__dict__.setdefault(
            "kernels", []
        )
        for program, kernel in kernels:
            if program == planned.program:
                return kernel
        # With the lock, only the first thread compiles, and the others find its code in the cache.
        with self._compile_lock:
            kernel = self._engine.compile(planned.program, self.design.robots)
            rows = np.arange(min(planned.runs, kernel.lanes))
            lanes = kernel.size(len(rows))
            kernel.prepare(Block(*planned.lanes(rows, lanes, harmless=True), None), planned.columns)
        kernels.append((planned.program, kernel))
        return kernel
