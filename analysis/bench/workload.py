"""Defines the timed work: a campaign of one arm and one fault slot, and blocks of its runs, all
different.

All runs share their parameters, as those of one campaign group do. Their common parts (the clean
packet, the nominal model) are computed once for all of them.
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

PATTERN_RUNS = 256
"""Rows of the fault table. Later runs repeat them with another value."""
DAC_CNT = 20_000.0
"""Faults overwrite a DAC command by up to this many counts, in either direction."""
GOLDEN = 0.6180339887498949
"""Multiples of this number, modulo 1, fill an interval evenly without repeating."""


def campaign_keys(runs: int, ticks: int) -> dict[str, Any]:
    """Return the keys of the timed campaign file: suturing with the gold arm, with a DAC command
    overwritten after every check.
    """
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
    """Return the seconds of each call of `work`, repeated as often as fits into `seconds`, between
    once and `most` times.
    """
    times: list[float] = []
    while not times or (len(times) < most and sum(times) + times[-1] <= seconds):
        times.append(measure_once(work))
    return times
