"""Defines the work that the benchmark measures: a campaign of one arm with one fault per run, and
blocks of its runs, all different. Their golden run is computed once for all runs.
"""

import dataclasses
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy as np

from ravenjax.campaign import loading, plan
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines.interface import Block, Kernel
from ravenjax.faults.fault import Faults
from ravenjax.numbers.vec import replace

PATTERN_RUNS, DAC_CNT = 256, 20_000.0
"""Rows of the fault table, which later runs repeat with another value, and the most counts by which
a fault overwrites a DAC command.
"""
GOLDEN = 0.6180339887498949
"""Multiples of this number, modulo 1, fill an interval evenly without repeating."""


def campaign_keys(runs: int, ticks: int) -> dict[str, Any]:
    """Return the keys of the timed campaign file."""
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": "overwrite",
        "value": {"uniform": [-DAC_CNT, DAC_CNT]},
        "start_ms": {"uniform": [0, ticks - 1]},
        "duration_ms": {"uniform": [1, 100]},
    }
    return {
        "campaign": {"name": "bench", "seed": 1, "duration_s": ticks / 1000, "arms": ["gold"]},
        "operator": {"motion": "suture", "seed": 1},
        "group": [{"name": "dac", "design": "random", "runs": runs, "fault": [fault]}],
    }


def campaign(runs: int, ticks: int) -> CampaignConfig:
    """Return the timed campaign."""
    return loading.from_dict(campaign_keys(runs, ticks))


@dataclasses.dataclass(frozen=True, eq=False)
class Workload:
    """The program, and its runs by number."""

    ticks: int  # of a run

    @cached_property
    def plan(self) -> Plan:
        """Return the planned campaign."""
        return plan.make_plan(campaign(PATTERN_RUNS, self.ticks))

    def golden_runs(self, lanes: int) -> Block:
        """Return a block without faults."""
        return Block(*self.plan.lanes([0], lanes, harmless=True), None)

    def block(self, first: int, runs: int, lanes: int, reference: np.ndarray) -> Block:
        """Return run `first` and the following runs, with the last one repeated to fill the block.
        `reference`: of their golden run.
        """
        number = first + np.minimum(np.arange(lanes), runs - 1)
        varied, faults = self.plan.lanes(number % PATTERN_RUNS, lanes)
        value = (DAC_CNT * (2.0 * (number * GOLDEN % 1.0) - 1.0)).astype(np.float32)
        slots = tuple(replace(slot, value=value) for slot in faults.slots)
        return Block(varied, Faults(slots), reference[:, :, None], np.zeros(lanes, int))

    def blocks(self, kernel: Kernel, runs: int, lanes: int) -> list[Block]:
        """Return `runs` runs in blocks of at most `lanes` lanes. Their golden run is computed."""
        golden = kernel.run(self.golden_runs(kernel.size(1)), self.plan.columns).reference[:, :, 0]
        sizes = [(first, min(lanes, runs - first)) for first in range(0, runs, lanes)]
        return [self.block(first, rows, kernel.size(rows), golden) for first, rows in sizes]

    def run(self, kernel: Kernel, blocks: Sequence[Block], threads: int) -> None:
        """Run the blocks, `threads` at a time."""
        with ThreadPoolExecutor(threads) as pool:
            for _ in pool.map(lambda block: kernel.run(block, self.plan.columns), blocks):
                pass


def measure_once(work: Callable[[], object]) -> float:
    """Return the seconds of a single call of `work`."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def repeat(work: Callable[[], object], seconds: float, most: int = 9) -> list[float]:
    """Return the seconds of each call of `work`, repeated up to `most` times within `seconds`."""
    times: list[float] = []
    while not times or (len(times) < most and sum(times) + times[-1] <= seconds):
        times.append(measure_once(work))
    return times
