"""Estimates how long a campaign takes and how much memory it needs, before it runs.

The model has a few terms. They were fitted by hand to the processor time of bundled campaigns on
one AMD EPYC (`znver4`, AVX-512) that also did other work. The table shows seconds on one core:
measured with a filled cache of compiled code, measured with an empty cache, and estimated.

| campaign | filled | empty | estimate |
|---|---|---|---|
| quick | 3.3 | 7.2 | 5.4 |
| haptic_sweep | 5.2 | 9.9 | 7.2 |
| safecomp45 | 6.5 | 11.5 | 7.6 |
| seed_burst | 3.5 | 6.6 | 4.7 |
| drawn_robots | 2.4 | 6.5 | 3.7 |
| dsn16_a | 5.7 | 7.6 | 7.4 |

`measure_speed` measures the current speed of this machine. The model assumes that engine cuda
computes 3.2e9 ticks per second, as on an NVIDIA H200 (`analysis/engines/gpu.md`), and that engines
xla and mjx are 200 and 400 times slower than simd (`analysis/engines`). The estimate is usually
right within a factor of two if the load of the machine stays the same.
"""

import math
import os
import time
from typing import NamedTuple

import numpy as np

from ravenjax import threads
from ravenjax.campaign.memory_windows import SHARED

NS_ARM, NS_FURTHER_ARM = 78.0, 64.0
"""Core time per simulated tick, ns: for one arm with one fault site, and for the second arm."""
NS_SITE = 2.2
"""Added core time per tick, ns, for each further fault site of an arm."""
NS_CUE, NS_THRESHOLD = 0.8, 0.4
"""Added core time per tick, ns, for each further haptic set, and for each detector threshold."""
NS_SUBSTEP = 25.0
"""Added core time per tick, ns, for each further integration step of one arm's dynamics."""
UNSHARED = 2.6
"""Factor on the core time if runs computed in one SIMD vector share no golden run, or if the
operator reacts to each fault.
"""
NS_RUN = 12_000.0
"""Core time per run, ns, for preparing its input and writing its row of the result table."""
PASSES_PER_S, MEASURED_S = 90_000.0, 0.2
"""Loop passes of `measure_speed` per second on one core of the machine that the model was fitted
on, and length of the measurement, s.
"""

START_S, SITE_S, BRANCH_S = 3.1, 0.03, 0.3
"""Time before the first run, s: imports, planning and compiling; addition for each fault site;
compiling the code that starts runs in the middle of a golden run. The values lie between those
with a filled and with an empty compile cache.
"""

CUDA_TICKS_PER_S = 3.2e9
SLOWER = {"xla": 200.0, "mjx": 400.0}
"""Time of these engines relative to engine simd on the same CPU."""

MIB_BASE, MIB_SITE = 500.0, 1.5
"""Memory, MiB: of the process with its imported packages; of each compiled fault site."""
BYTES_RUN, BYTES_SLOT = 60.0, 35.0
"""Bytes of the planned fault table per run, and per fault of a run. The sum was measured as 91
bytes for runs with one fault (`analysis/scale`).
"""
BYTES_SERIES = 24
"""Bytes of a golden run's time series per arm and tick."""
MOST_SERIES_MIB = 1536.0
"""Largest memory of golden runs' time series, MiB; twice that with a GPU.

`campaign.computation` keeps the series of two memory windows, and a copy if no two runs share a
golden run.
"""

BASIS = (
    "model fitted on an AMD EPYC with AVX-512 (campaign/inspection/estimate.py), scaled by the"
    " speed of this machine now; right within a factor of two at the same load"
)


class CostFactors(NamedTuple):
    """The properties of a campaign that decide its cost."""

    runs: int  # number of runs to compute
    ticks: int  # length of each run, ms
    # Golden runs that the runs are compared with.
    golden_runs: int
    arms: int = 1
    # Fault sites, summed over arms.
    sites: int = 1
    slots: int = 1  # largest number of faults in a run
    cues: int = 1  # number of haptic sets
    thresholds: int = 0  # number of thresholds, summed over detectors
    substeps: int = 1  # integration steps per tick
    reacts: bool = False  # whether the operator reacts to faults


class CostEstimate(NamedTuple):
    """Expected time and memory."""

    # Time from the command to the first run, s.
    start_s: float
    # Time of computing and storing all runs, without the report, s.
    run_s: float
    memory_mib: float  # at most


def measure_speed() -> float:
    """Return the current speed of this process with all its threads.

    The unit is one core of the machine that the cost model was fitted on.
    """

    def count_passes(_: int) -> int:
        # Counts how often this thread repeats an array computation in MEASURED_S.
        numbers, count = np.arange(2**14, dtype=np.float32), 0
        end = time.perf_counter() + MEASURED_S
        while time.perf_counter() < end:
            np.sqrt(numbers * numbers + numbers)
            count += 1
        return count

    counts = threads.map_in_threads(count_passes, range(len(os.sched_getaffinity(0))))
    return sum(counts) / MEASURED_S / PASSES_PER_S


def estimate_cost(work: CostFactors, engine: str, speed: float) -> CostEstimate:
    """Return the expected cost of `work` on an engine; speed: value of `measure_speed`."""
    ticks = (work.runs + work.golden_runs) * work.ticks
    if engine == "cuda":
        compute_s = ticks * tick_ns(work) / NS_ARM / CUDA_TICKS_PER_S
    else:
        compute_s = ticks * tick_ns(work) * 1e-9 * SLOWER.get(engine, 1.0) / speed
    copies = 2 if work.golden_runs > work.runs // SHARED and work.golden_runs > 1 else 1
    series = copies * work.golden_runs * work.ticks * BYTES_SERIES * work.arms / 2**20
    most = MOST_SERIES_MIB * (2 if engine == "cuda" else 1)
    plan = work.runs * (BYTES_RUN + BYTES_SLOT * work.slots) / 2**20
    return CostEstimate(
        start_s=(START_S + SITE_S * work.sites) / min(1.0, speed),
        run_s=compute_s + work.runs * NS_RUN * 1e-9 / speed + BRANCH_S / min(1.0, speed),
        memory_mib=MIB_BASE + MIB_SITE * work.sites + plan + min(series, most),
    )


def tick_ns(work: CostFactors) -> float:
    """Return the core time for one tick of one run, ns."""
    shared = work.golden_runs * SHARED <= max(work.runs, SHARED) and not work.reacts
    ns = NS_ARM + NS_FURTHER_ARM * (work.arms - 1)
    ns += (NS_SITE * max(0, work.sites - 1) + NS_SUBSTEP * (work.substeps - 1)) * work.arms
    ns += NS_CUE * max(0, work.cues - 1) + NS_THRESHOLD * work.thresholds
    return ns if shared else ns * UNSHARED


def format_estimate(seconds: float) -> str:
    """Return an expected time as text: `5 s`, `3 min`, `2.5 h`.

    It has at most two digits, because the estimate is not more precise.
    """
    if seconds < 90.0:
        return f"{max(1, math.ceil(seconds)):d} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 5400.0 else f"{seconds / 3600.0:.2g} h"
