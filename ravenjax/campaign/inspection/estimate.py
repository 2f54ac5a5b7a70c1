"""Estimates how long a campaign takes and how much memory it needs, before it runs.

The model has a few terms. They were fitted by hand to the processor time of bundled campaigns on
one AMD EPYC (`znver4`, AVX-512) that also did other work. The table shows seconds on one core:
measured with a filled cache of compiled code, with an empty one, and one estimate for both.

| campaign | filled | empty | estimate |
|---|---|---|---|
| quick | 3.3 | 7.2 | 5.4 |
| haptic_sweep | 5.2 | 9.9 | 7.2 |
| safecomp45 | 6.5 | 11.5 | 7.6 |
| seed_burst | 3.5 | 6.6 | 4.7 |
| drawn_robots | 2.4 | 6.5 | 3.7 |
| dsn16_a | 5.7 | 7.6 | 7.4 |

`measure_speed` measures the current speed of this machine. The model assumes that a GPU
computes 3.2e9 ticks per second, as engine cuda on an NVIDIA H200 (`analysis/engines/gpu.md`). For
other engines `engines.selection` has the slowdown relative to simd. The estimate is usually right
within a factor of two if the load of the machine stays the same.
"""

import math
import os
import time
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from ravenjax import resources, threads
from ravenjax.campaign.memory_windows import SHARED
from ravenjax.engines import selection

_MODEL = SimpleNamespace(**resources.read_tables(__file__, "estimate.toml"))
BASIS: str = _MODEL.basis


class CostFactors(NamedTuple):
    """The properties of a campaign that decide its cost."""

    runs: int  # number of runs to compute
    ticks: int  # length of each run, ms
    golden_runs: int  # golden runs that the runs are compared with
    arms: int = 1
    sites: int = 1  # fault sites, summed over arms
    slots: int = 1  # largest number of faults in a run
    cues: int = 1  # number of haptic sets
    thresholds: int = 0  # number of thresholds, summed over detectors
    substeps: int = 1  # integration steps per tick
    reacts: bool = False  # whether the operator reacts to faults

    @property
    def shares_series(self) -> bool:
        """Whether a golden run has so many runs that its series is stored once, not per lane."""
        return self.golden_runs <= max(1, self.runs // SHARED)


class CostEstimate(NamedTuple):
    """Expected time and memory."""

    start_s: float  # time from the command to the first run, s
    run_s: float  # time of computing and storing all runs, without the report, s
    memory_mib: float  # at most


def measure_speed() -> float:
    """Return the current speed of this process with all its threads. The unit is one core of the
    machine that the cost model was fitted on.
    """

    def count_passes(_: int) -> int:
        # Counts how often this thread repeats an array computation in the time of the measurement.
        numbers, count = np.arange(2**14, dtype=np.float32), 0
        end = time.perf_counter() + _MODEL.measured_s
        while time.perf_counter() < end:
            np.sqrt(numbers * numbers + numbers)
            count += 1
        return count

    counts = threads.map_in_threads(count_passes, range(len(os.sched_getaffinity(0))))
    return sum(counts) / _MODEL.measured_s / _MODEL.passes_per_s


def estimate_cost(work: CostFactors, engine: str, speed: float) -> CostEstimate:
    """Return the expected cost of `work` on an engine; speed: value of `measure_speed`."""
    ticks = (work.runs + work.golden_runs) * work.ticks
    properties = selection.engine_properties(engine)
    # A GPU is as fast as this number of cores.
    cores = _MODEL.gpu_cores if properties.needs_gpu else speed
    compute_s = ticks * tick_ns(work) * 1e-9 * properties.slowdown / cores
    # The time series of golden runs are copied for the lanes if runs do not share them. A campaign
    # keeps only some series at a time, with a GPU twice as many.
    copies = 1 if work.shares_series else 2
    series_mib = copies * work.golden_runs * work.ticks * _MODEL.series_bytes * work.arms / 2**20
    most_mib = _MODEL.most_series_mib * (2 if properties.needs_gpu else 1)
    # A start uses one core, so several cores (speed above 1) do not shorten it.
    core_speed = min(1.0, speed)
    storing_s = work.runs * _MODEL.ns_run * 1e-9 / speed
    plan_mib = work.runs * (_MODEL.run_bytes + _MODEL.slot_bytes * work.slots) / 2**20
    memory_mib = _MODEL.base_mib + _MODEL.site_mib * work.sites + plan_mib
    return CostEstimate(
        start_s=(_MODEL.start_s + _MODEL.site_s * work.sites) / core_speed,
        run_s=compute_s + storing_s + _MODEL.branch_s / core_speed,
        memory_mib=memory_mib + min(series_mib, most_mib),
    )


def tick_ns(work: CostFactors) -> float:
    """Return the core time for one tick of one run, ns."""
    ns = _MODEL.ns_arm + _MODEL.ns_further_arm * (work.arms - 1)
    sites_ns, substeps_ns = _MODEL.ns_site * max(0, work.sites - 1), _MODEL.ns_substep
    ns += (sites_ns + substeps_ns * (work.substeps - 1)) * work.arms
    ns += _MODEL.ns_cue * max(0, work.cues - 1) + _MODEL.ns_threshold * work.thresholds
    # Lanes that share a golden run compute some numbers only once, unless the operator reacts.
    return ns if work.shares_series and not work.reacts else ns * _MODEL.unshared


def format_estimate(seconds: float) -> str:
    """Return an expected time as text: `5 s`, `3 min`, `2.5 h`. It has at most two digits, because
    the estimate is not more precise.
    """
    if seconds < 90.0:
        return f"{max(1, math.ceil(seconds)):d} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 5400.0 else f"{seconds / 3600.0:.2g} h"
