"""Estimates how long a campaign takes and how much memory it needs, before it runs.

The model has a few terms that were fitted by hand to campaigns of one machine: 2 cores of an AMD
EPYC (`znver4`, AVX-512) with other work beside it. They fit CPU time rather than elapsed time, with
Python 3.11 and JAX 0.10. The table shows nanoseconds of one core for one millisecond of one run,
with 16 robots per vector:

| campaign | measured | here |
|---|---|---|
| one site, one arm, no detector | 78 | 78 |
| the same with both arms | 142 | 142 |
| with 64 haptic sets | 116 | 141 |
| with 32 detector thresholds | 102 | 100 |
| 4 plant steps a tick | 154 | 153 |
| an operator who reacts | 130 | 133 |
| a golden run for each run | 157 | 133 |
| bundled quick (30 sites) | 169 | 174 |
| bundled hazard_library (30 sites) | 183 | 171 |
| bundled haptic_sweep (126 sets) | 413 | 296 |
| bundled safecomp45 (18 sites, both arms) | 229 | 251 |

For other CPUs the estimate is scaled by vector width and number of cores. Engine cuda: 3.2 G ticks
a second on an NVIDIA H200 (`analysis/engines/gpu.md`). Engines xla and mjx: 200 and 3 000 times
slower than simd (`analysis/engines`). Expect the estimate to be right within a factor of two on an
otherwise idle machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ravenjax.campaign.memory_windows import SHARED

NS_ARM, NS_FURTHER_ARM = 78.0, 64.0
"""ns of a core per tick: for one arm with one fault site, and for the second arm."""
NS_SITE = 3.2
"""ns per further fault site and arm."""
NS_CUE, NS_THRESHOLD = 1.0, 0.7
"""ns per further haptic set, and per threshold of a detector."""
NS_SUBSTEP = 25.0
"""ns per further plant step and arm."""
UNSHARED = 1.7
"""Factor on the work if the robots of a vector share no golden run, or if each operator reacts
differently.
"""
NS_RUN = 12_000.0
"""ns per run, for packing and writing its row."""
WIDTH = 16
"""Robots per vector on the machine that was measured."""

START_S, TRACE_S, SITE_S = 2.5, 2.0, 0.06
"""s: imports and planning; tracing and compiling; tracing and compiling of each fault site."""

CUDA_TICKS_PER_S = 3.2e9
SLOWER = {"xla": 200.0, "mjx": 3000.0}
"""Factor on the time of engine simd on the same CPU."""

MIB_BASE, MIB_SITE = 500.0, 1.5
"""MiB: the process with its packages; each compiled fault site."""
BYTES_RUN, BYTES_SLOT = 60.0, 35.0
"""Bytes of the plan per run, and per fault slot of a run (91 with one slot: `analysis/scale`)."""
BYTES_SERIES = 24
"""Bytes of a golden run's time series per arm and tick."""
MOST_SERIES_MIB = 1536.0
"""MiB of time series that are held at a time: for two windows, and a copy if no two runs share a
golden run.

Twice that with a GPU. See `computation`.
"""

BASIS = (
    "model fitted on 2 cores of an AMD EPYC with AVX-512 (campaign/inspection/estimate.py), scaled"
    " by cores and vector width; right within a factor of two on an idle machine"
)


class CostFactors(NamedTuple):
    """The properties of a campaign that decide its cost."""

    runs: int  # to compute
    ticks: int  # of each run
    # Golden runs that the runs are compared with.
    golden_runs: int
    arms: int = 1
    # Fault sites, summed over arms.
    sites: int = 1
    slots: int = 1
    cues: int = 1  # haptic sets
    thresholds: int = 0  # of all detectors
    substeps: int = 1
    reacts: bool = False


class Machine(NamedTuple):
    """The machine that computes the campaign."""

    engine: str
    cores: int
    width: int = WIDTH  # float32 numbers in a vector of the CPU


class CostEstimate(NamedTuple):
    """Expected time and memory."""

    # Time from the command to the first run with an empty cache, s.
    start_s: float
    # Time of computing and storing all runs, without the report, s.
    run_s: float
    memory_mib: float  # at most


def estimate_cost(work: CostFactors, machine: Machine) -> CostEstimate:
    """Return the expected cost of `work` on `machine`."""
    ticks = (work.runs + work.golden_runs) * work.ticks
    if machine.engine == "cuda":
        compute_s = ticks * tick_ns(work) / NS_ARM / CUDA_TICKS_PER_S
    else:
        slower = SLOWER.get(machine.engine, 1.0)
        compute_s = ticks * tick_ns(work) * 1e-9 * slower * WIDTH / machine.width / machine.cores
    copies = 2 if work.golden_runs > work.runs // SHARED and work.golden_runs > 1 else 1
    series = copies * work.golden_runs * work.ticks * BYTES_SERIES * work.arms / 2**20
    most = MOST_SERIES_MIB * (2 if machine.engine == "cuda" else 1)
    plan = work.runs * (BYTES_RUN + BYTES_SLOT * work.slots) / 2**20
    return CostEstimate(
        start_s=START_S + TRACE_S + SITE_S * work.sites,
        run_s=compute_s + work.runs * NS_RUN * 1e-9 / machine.cores,
        memory_mib=MIB_BASE + MIB_SITE * work.sites + plan + min(series, most),
    )


def tick_ns(work: CostFactors) -> float:
    """Return ns of one core for a tick of one run."""
    shared = work.golden_runs * SHARED <= max(work.runs, SHARED) and not work.reacts
    ns = NS_ARM + NS_FURTHER_ARM * (work.arms - 1)
    ns += (
        NS_SITE * max(0, work.sites - 1) * work.arms + NS_SUBSTEP * (work.substeps - 1) * work.arms
    )
    ns += NS_CUE * max(0, work.cues - 1) + NS_THRESHOLD * work.thresholds
    return ns if shared else ns * UNSHARED


def format_estimate(seconds: float) -> str:
    """Return an expected time as text: `5 s`, `3 min`, `2.5 h`. Two digits at most, as it is not
    known better.
    """
    if seconds < 90.0:
        return f"{max(1, math.ceil(seconds)):d} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 5400.0 else f"{seconds / 3600.0:.2g} h"
