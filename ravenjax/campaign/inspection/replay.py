"""One run again, alone, with everything that crossed the seams of the tick as time series."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import compile_cache, outcomes
from ravenjax.campaign.faults import run_id
from ravenjax.campaign.file.config import CampaignConfig, validated
from ravenjax.campaign.plan import make_plan
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.store import manifest, schema
from ravenjax.store.logs.topics import Base

LANES = 16
"""Lanes of a replay's block: one vector, so that the run takes the same vector code as in its
campaign.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Replay:
    """One run, computed again."""

    row: pd.Series  # the run's row of the result table, computed anew
    series: dict[
        str, np.ndarray
    ]  # name -> [ticks] or [ticks, ...], those of `ravenjax.store.logs.time_series`
    golden: dict[str, Any]  # the golden run's outcomes, as the engine counts them
    bases: dict[str, Base]  # of each arm, in the world
    engine: str  # engine and device, in words


class Replayer:
    """Runs rows of one campaign again, one after the other: planned and compiled once."""

    def __init__(self, config: CampaignConfig, engine: str = "auto") -> None:
        """Raises UserError for a campaign or an engine that cannot be run."""
        compile_cache.enable()
        self.config = config
        self._plan = make_plan(config)
        self._ids = self._plan.rows.numbers("run_id")
        program = self._plan.program
        backend = selection.select(engine, program.setup.precision, compile_cache.objects())
        self.engine = f"{backend.name} on {backend.device}"
        self._tracer = backend.tracer(program, LANES)
        self._robot = config.robot.part("campaign")
        self._bases = self._robot.bases(program.setup) if hasattr(self._robot, "bases") else {}

    @staticmethod
    def of_folder(folder: Path, engine: str = "auto") -> Replayer:
        """Of the campaign that a result folder holds, on the engine that computed it if "auto".

        Raises StoreError as `manifest.read`, and UserError.
        """
        record = manifest.read(folder)
        if engine == "auto":
            # A GPU's results come again on a CPU, to the bit where that fuses multiply-adds.
            engine = "auto" if record.engine == "cuda" else record.engine
        return Replayer(validated(record.config), engine)

    def index(self, run: str | int) -> int:
        """Index of a run by its id, the beginning of its id, or its index. Raises UserError."""
        return find(self._ids, run)

    def replay(self, run: str | int) -> Replay:
        """Run one row; `run` as for `index`. Raises UserError."""
        row, program = self.index(run), self._plan.program
        varied, harmless = self._plan.lanes([row], LANES, harmless=True)
        _, faults = self._plan.lanes([row], LANES)
        end = int(self._plan.ends[row])
        ends = np.full(LANES, end)
        golden, result, signals = self._tracer.run(
            Block(varied, harmless, None, ends=ends),
            Block(varied, faults, None, ends=ends),
            self._plan.columns,
        )
        own, fault_free = (
            {name: values[:1] for name, values in one.outcomes.items()} for one in (result, golden)
        )
        if program.ends:
            own[schema.OBSERVED] = self._plan.ends[[row]]
        series = self._robot.series(program.setup, signals, np.asarray(golden.reference)[:, :, 0])
        frame = outcomes.frame(
            self.config, self._plan.rows.take(slice(row, row + 1)), own, fault_free
        )
        return Replay(
            row=frame.iloc[0],
            series={name: values[:end] for name, values in series.items()},
            golden={name: values[0].item() for name, values in fault_free.items()},
            bases=self._bases,
            engine=self.engine,
        )


def replay(config: CampaignConfig, run: str | int, engine: str = "auto") -> Replay:
    """Run one row of a campaign: `run` is its run id (or the beginning of one that no other has)
    or its index.
    """
    return Replayer(config, engine).replay(run)


def find(ids: np.ndarray, run: str | int) -> int:
    """Index of a run by id, beginning of an id, or index; `ids` as in the fault table. Raises
    UserError.
    """
    if isinstance(run, int) or (run.isdecimal() and len(run) < run_id.DIGITS):
        index = int(run)
        if not 0 <= index < len(ids):
            raise UserError(f"run {index}: the campaign has runs 0..{len(ids) - 1}")
        return index
    matches = run_id.beginning(ids, run)
    if len(matches) != 1:
        problem = "no run has this id" if not len(matches) else f"{len(matches)} runs begin so"
        raise UserError(f"run {run!r}: {problem}; expected a run_id of the result table")
    return int(matches[0])
