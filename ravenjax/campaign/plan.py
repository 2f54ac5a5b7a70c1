"""Converts a checked campaign file into a fault table, a program of the tick, and its inputs."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design, run_id, span, table
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.memory_windows import take_rows
from ravenjax.campaign.prepared import Prepared
from ravenjax.engines.interface import TickProgram
from ravenjax.errors import UserError
from ravenjax.faults.clocks import Clocks
from ravenjax.faults.fault import Faults, FaultSlot
from ravenjax.numbers import paths
from ravenjax.numbers.setup import CAMPAIGN, Precision, Setup
from ravenjax.store import schema
from ravenjax.store.motion.summary import MotionSummary


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """All inputs of a campaign's computation. Nothing is compiled yet."""

    config: CampaignConfig
    rows: pd.DataFrame  # the fault table, one row per run
    program: TickProgram
    motion: Any  # the operator's motion, in the robot's own type
    operator: MotionSummary | None  # summary of a recorded motion; None for a generated motion
    columns: tuple[np.ndarray, ...]  # the motion's columns, float32 [ticks]
    # Parameters that are keys of random numbers, and their purpose. Runs have different keys.
    keys: Mapping[str, str]
    faults: dict[str, np.ndarray]  # arrays of `table.fault_arrays`, [runs, slots]
    varied: dict[str, np.ndarray]  # path -> [runs]
    # Number of each run's golden run, int32 [runs], in order of first use. Runs with the same
    # golden run have the same number.
    golden: np.ndarray

    @property
    def runs(self) -> int:
        """Number of runs, which is the number of rows of the fault table."""
        return len(self.rows)

    def row_fields(self, rows: slice | np.ndarray) -> dict[str, Any]:
        """Return the fields that have one entry per run, for these rows."""
        return {
            "rows": self.rows.iloc[rows],
            "faults": take_rows(self.faults, rows),
            "varied": take_rows(self.varied, rows),
            "golden": self.golden[rows],
        }

    def take(self, rows: slice | np.ndarray) -> "Plan":
        """Return a plan of only these rows."""
        return dataclasses.replace(self, **self.row_fields(rows))

    @cached_property
    def acts(self) -> np.ndarray:
        """The first tick in which a fault of each run may act, see `span`; int32 [runs]."""
        return span.first_active_ticks(self.faults, self.program.ticks)

    @cached_property
    def ends(self) -> np.ndarray:
        """The first tick after each run's observed time, see `span`; int32 [runs]."""
        observe = self.config.campaign.observe_ms
        return span.observation_ends(
            self.faults, self.program.ticks, observe and observe // self.tick_ms, self.clocks
        )

    @cached_property
    def shape(self) -> schema.Shape:
        """Counts and names on which the columns of the result table depend."""
        config, setup = self.config, self.program.setup
        return schema.Shape(
            robot=config.campaign.robot,
            arms=setup.arms,
            joints=setup.joints,
            slots=setup.injection.slots,
            cues=setup.cues,
            checks=tuple(config.robot.checks),
            parameters=tuple(table.varied_parameters(self.rows)),
            stages=setup.stages,
            detectors=tuple(use.thresholds for use in setup.detectors),
            harms=tuple(harm.name for harm in setup.harms),
            observes=self.program.ends,
            own_checks=config.own_checks,
            stops=config.stops,
        )

    @property
    def tick_ms(self) -> int:
        """Duration of a tick."""
        return self.program.setup.period_ms

    @property
    def clocks(self) -> Clocks | None:
        """Times of packets and of the pressed pedal; None if no trigger counts these."""
        triggers = self.program.setup.injection.triggers
        return self.any_clocks if "packet" in triggers or "pedal" in triggers else None

    @cached_property
    def any_clocks(self) -> Clocks | None:
        """Times of packets and of the pressed pedal; None if the robot does not provide them."""
        find = getattr(self.config.robot.part("campaign"), "clocks", None)
        return find and find(self.program, self.columns, self.varied, self.runs)

    def numbers(self, path: str) -> np.ndarray:
        """Return a parameter's value in each run, [runs]. path: the full path of one number."""
        for varied_path, values in self.varied.items():
            # A varied path may name several numbers, which include this one.
            if bounds.paths_overlap(self.config.robot, varied_path, path):
                return values
        robot_values = paths.named_numbers(self.program.params, self.program.setup, path)
        return np.full(self.runs, robot_values[path])

    def lanes(
        self, rows: Sequence[int] | np.ndarray, lanes: int, harmless: bool = False
    ) -> tuple[dict[str, Any], Faults]:
        """Return varied parameters and faults of a block of lanes, arrays [lanes]. rows: rows of
        the plan; the last row is repeated to fill the block. harmless: leave out all faults.
        """
        row_of_lane = np.asarray(rows)[np.minimum(np.arange(lanes), len(rows) - 1)]
        faults = take_rows(self.faults, row_of_lane)
        # The code 0 marks a slot without a fault.
        if harmless:
            faults["code"] = np.zeros_like(faults["code"])
        slots = tuple(
            FaultSlot(**take_rows(faults, np.s_[:, slot]))
            for slot in range(self.program.setup.injection.slots)
        )
        return take_rows(self.varied, row_of_lane), Faults(slots)


def make_plan(config: CampaignConfig, precision: Precision = CAMPAIGN) -> Plan:
    """Return the plan of a campaign. Raise UserError for a campaign that cannot be run."""
    loading.check_parameters(config)
    rows = design.table_columns(config)
    varied = table.varied_parameters(rows)
    injection = table.table_injection(rows, config.robot)
    robot: Prepared = config.robot.part("campaign").prepare(config, varied, injection, precision)
    if config.detector and not robot.setup.detectors:
        raise UserError(
            f"detector: robot {config.robot.name!r} supports no detectors: remove [[detector]]"
        )
    # Only the prepared robot tells which paths exist. Ranges were checked above.
    loading.check_parameters(config, known_parameters(robot.params, robot.setup))
    setup, campaign = robot.setup, config.campaign
    if setup.period_ms != config.robot.period_ms:
        raise UserError(
            f"robot {config.robot.name!r}: its setup has period_ms {setup.period_ms}, expected"
            f" {config.robot.period_ms}, as ROBOT declares"
        )
    values = _complete_values(varied, robot.params, setup)
    for path, purpose in robot.keys.items():
        values[path] = run_id.stream_keys(table.shared_ids(rows), purpose)
    return Plan(
        config=config,
        rows=rows,
        program=TickProgram(
            module=robot.loop.__name__,
            setup=setup,
            params=robot.params,
            varied=tuple(values),
            ticks=campaign.ticks,
            ends=campaign.observe_ms is not None,
        ),
        motion=robot.motion,
        operator=robot.operator,
        columns=tuple(np.ascontiguousarray(column) for column in robot.columns),
        keys=robot.keys,
        faults=table.fault_arrays(rows, injection, setup.period_ms),
        varied=values,
        golden=number_golden_runs(values, len(rows)),
    )


def known_parameters(params: Any, setup: Setup) -> list[str]:
    """Return every path that a campaign may vary: of a number or a vector, with or without arm."""
    known = []
    for number_path, _ in paths.path_leaves(params, setup):
        if number_path.startswith("start."):
            # The motion determines the pose in which a run begins.
            continue
        for path in (number_path, paths.without_arm(number_path, setup.arms)):
            known.append(path)
            vector_path, _, last = path.rpartition(".")
            if last in paths.path_words(setup.joints):
                known.append(vector_path)
    return list(dict.fromkeys(known))


def _complete_values(varied: dict[str, np.ndarray], params, setup: Setup) -> dict[str, np.ndarray]:
    # Returns varied values in the parameter's type. The robot's value replaces NaN. If a path names
    # numbers of different values, such as one per joint, the result has a path for each number.
    completed = {}
    for path, values in varied.items():
        unset = np.isnan(values)
        robot_values = paths.named_numbers(params, setup, path)
        # One path suffices if all its numbers are equal, or if no value is NaN.
        if len({float(value) for value in robot_values.values()}) == 1 or not unset.any():
            robot_values = {path: next(iter(robot_values.values()))}
        for number_path, value in robot_values.items():
            is_real = np.asarray(value).dtype.kind == "f"
            dtype = np.dtype(setup.precision.real if is_real else np.int32)
            numbers = np.where(unset, np.asarray(value, np.float64), values)
            completed[number_path] = numbers.astype(dtype)
    return completed


def number_golden_runs(varied: dict[str, np.ndarray], runs: int) -> np.ndarray:
    """Return the number of each run's golden run, int32 [runs]. Runs with equal varied parameters
    have the same golden run. varied: path -> values [runs].
    """
    golden = np.zeros(runs, np.int64)
    for values in varied.values():
        if (values != values[:1]).any():
            value_numbers, distinct_values = pd.factorize(values)
            # Each pair of an earlier number and a value gets a number, in order of first use.
            golden, _ = pd.factorize(golden * len(distinct_values) + value_numbers)
    return golden.astype(np.int32)
