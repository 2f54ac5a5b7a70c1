"""Computes single runs again, with all signals of the tick as time series."""

import numbers
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd

from ravenjax.campaign import compile_cache, memory_windows, outcomes
from ravenjax.campaign.faults import run_id
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.plan import make_plan
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError, format_value
from ravenjax.stages.recorded import read_series
from ravenjax.store import manifest, schema
from ravenjax.store.logs.topics import Base

LANES = 16
"""Number of copies of a run that are computed together, if the engine is not portable: the last
digits then depend on the number of runs in a block.

16 numbers fill one SIMD vector, so the replay uses the same vector instructions as the campaign.
"""


class Replay(NamedTuple):
    """One run, computed again."""

    row: pd.Series  # the run's row of the result table, computed again
    # Time series by name, [ms] or [ms, ...]; `ravenjax.store.logs.time_series` lists them. The
    # numbers of a tick are those of each of its milliseconds.
    series: dict[str, np.ndarray]
    golden: dict[str, Any]  # outcomes of the golden run, as the engine returned them
    bases: dict[str, Base]  # base of each arm in the world frame
    engine: str  # names of engine and device


class PlannedCampaign:
    """A planned campaign, and the engine that computes some of its runs again."""

    def __init__(self, config: CampaignConfig, engine: str = "auto"):
        """Raise UserError if the campaign or the engine cannot be run."""
        self.config, self.plan = config, make_plan(config)
        self.backend = compile_cache.cached_engine(engine, self.plan.program.setup.precision)
        self.engine = f"{self.backend.name} on {self.backend.device}"

    @classmethod
    def of_folder(cls, folder: Path, engine: str = "auto") -> Self:
        """Return the campaign of a result folder; "auto" means the engine that computed it. Raises
        StoreError as `manifest.read_manifest`, and UserError.
        """
        record = manifest.read_manifest(folder)
        config = validate_tables(record.config, folder / manifest.FILE)
        return cls(config, original_engine(record, engine))

    def index(self, run: Any) -> int:
        """Return a run's index by its id, the id's beginning, or its index. Raises UserError."""
        return find_run(self.plan.rows["run_id"].to_numpy(), run)


def original_engine(record: manifest.Manifest, engine: str) -> str:
    """Replace "auto" by the engine that computed a folder. If that engine needs a GPU, "auto"
    stays, and means the fastest engine of this machine. Its results equal those of the GPU in all
    bits if the CPU has fused multiply-add instructions.
    """
    stays = engine != "auto" or selection.engine_properties(record.engine).needs_gpu
    return engine if stays else record.engine


class Replayer(PlannedCampaign):
    """Computes single runs of a campaign again, with their time series."""

    def __init__(self, config: CampaignConfig, engine: str = "auto"):
        """Raise UserError if the campaign or the engine cannot be run."""
        super().__init__(config, engine)
        program = self.plan.program
        self._lanes = 1 if selection.engine_properties(self.backend.name).portable else LANES
        self._tracer = self.backend.tracer(program, self._lanes)
        # A robot need not define the base frames of its arms.
        find_bases = getattr(config.robot.part("campaign"), "bases", lambda _: {})
        self._bases = find_bases(program.setup)

    def replay(self, run: Any) -> Replay:
        """Compute a run again. run: its id, the id's beginning, or its index. Raises UserError."""
        row, program = self.index(run), self.plan.program
        # The golden run has the run's parameters, but no faults.
        varied, harmless = self.plan.lanes([row], self._lanes, harmless=True)
        _, faults = self.plan.lanes([row], self._lanes)
        end, tick_ms = int(self.plan.ends[row]), self.plan.tick_ms
        ends = np.full(self._lanes, end)
        golden, result, signals = self._tracer.run(
            Block(varied, harmless, None, ends=ends),
            Block(varied, faults, None, ends=ends),
            self.plan.columns,
        )
        # All lanes compute the same run, so the first lane suffices.
        computed, fault_free = (
            memory_windows.take_rows(block.outcomes, slice(1)) for block in (result, golden)
        )
        # Only a campaign whose runs may end early has the column with the length of a run.
        if program.ends:
            computed[schema.OBSERVED] = self.plan.ends[[row]] * tick_ms
        # [ticks, numbers] of the first lane.
        reference = np.asarray(golden.reference)[:, :, 0]
        series = read_series(self.config.robot, program, signals, reference)
        stored = outcomes.select_golden_outcomes(self.plan.shape, fault_free)
        fault_row = self.plan.rows.iloc[row : row + 1]
        columns = outcomes.result_columns(self.config, fault_row, computed, stored)
        # Series have a value per tick, and are repeated to a value per millisecond.
        return Replay(
            row=pd.DataFrame(columns).iloc[0],
            series=memory_windows.take_rows(series, np.arange(end * tick_ms) // tick_ms),
            golden={name: values[0].item() for name, values in fault_free.items()},
            bases=self._bases,
            engine=self.engine,
        )


def find_run(ids: np.ndarray, run: Any) -> int:
    """Return the index of a run by its id, the beginning of its id, or its index. ids: run ids of
    the fault table. Raises UserError.
    """
    if isinstance(run, bool) or not isinstance(run, str | numbers.Integral):
        raise UserError(
            f"run {format_value(run)}: expected its index (a whole number) or its run_id (text)"
        )
    # A text of decimal digits is an index, unless it is as long as a whole id.
    if not isinstance(run, str) or (run.isdecimal() and len(run) < run_id.DIGITS):
        if not 0 <= int(run) < len(ids):
            raise UserError(f"run {run}: expected an index in 0..{len(ids) - 1}")
        return int(run)
    texts = run_id.format_run_ids(ids).to_pylist()
    matches = [row for row, text in enumerate(texts) if text.startswith(run)]
    if len(matches) != 1:
        problem = f"{len(matches)} run ids begin so" if matches else "no run has this id"
        raise UserError(f"run {run!r}: {problem}; expected a run_id of the result table")
    return matches[0]
