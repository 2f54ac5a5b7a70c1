"""Times whole campaigns kept in memory, by number of runs and by the time at which faults begin.

Until its fault a run equals its golden run. An engine that starts from a checkpoint of the golden
run computes only the ticks after the fault, and with `campaign.observe_ms` only a part of these
ticks.
"""

import functools
from typing import Any

from bench import machine, workload
from ravenjax.campaign import loading, runner
from ravenjax.engines import selection
from ravenjax.numbers.setup import CAMPAIGN

SIZES = {"cuda": (4096, 65_536, 1_048_576), "simd": (256, 4096, 16_384)}
"""Runs of a campaign, by engine."""
TICKS = {"cuda": 10_000, "simd": 1000}
FAULT_TICKS, OBSERVE_MS, FAULT_MS = 10_000, 1000, 10
"""Ticks of a run; how long half of the runs are observed after their fault; duration of the
fault.
"""
STARTS_MS = (0, 2500, 5000, 7500, 9000)
"""Times at which faults begin. At the first there is no golden run to continue from."""


def measure_sizes(seconds: float) -> list[dict[str, Any]]:
    """Time campaigns of each size. The first run traces and compiles, and is shown beside its
    repeats.
    """
    name = selection.fastest_engine(CAMPAIGN)[0]
    rows = []
    for runs in SIZES[name]:
        config = workload.campaign(runs, TICKS[name])
        run = functools.partial(runner.run_campaign, config, None, name)
        first_s, times = (
            workload.measure_once(run),
            workload.repeat(run, seconds / len(SIZES[name])),
        )
        row = {"engine": name, "runs": runs, "ticks": TICKS[name], "first_s": first_s}
        rows.append(row | {"seconds": times, "us_per_run": 1e6 * min(times) / runs})
    return rows


def fault_campaign(runs: int, start_ms: int, observe_ms: int | None) -> dict[str, Any]:
    """Return the keys of the timed campaign, in which all faults begin at one time."""
    keys = workload.campaign_keys(runs, FAULT_TICKS)
    keys["group"][0]["fault"][0] |= {"start_ms": start_ms, "duration_ms": FAULT_MS}
    if observe_ms is not None:
        keys["campaign"]["observe_ms"] = observe_ms
    return keys


def measure_fault_times(seconds: float, runs: int = 0) -> list[dict[str, Any]]:
    """Time campaigns by the start of their faults. `runs`: of each campaign; 0: as many as an
    engine computes in about a second.
    """
    name = selection.fastest_engine(CAMPAIGN)[0]
    runs = runs or (2**17 if name == "cuda" else 1024 * machine.count_usable_cpus())
    ways = [(start, observe) for observe in (None, OBSERVE_MS) for start in STARTS_MS]
    rows: list[dict[str, Any]] = []
    for start, observe in ways:
        config = loading.from_dict(fault_campaign(runs, start, observe))
        run = functools.partial(runner.run_campaign, config, None, name)
        if start == STARTS_MS[0]:
            # The first call traces and compiles.
            run()
        times = workload.repeat(run, 0.8 * seconds / len(ways))
        row = {"engine": name, "runs": runs, "fault_at_ms": start, "observe_ms": observe}
        rows.append(row | {"us_per_run": 1e6 * min(times) / runs, "seconds": times})
    return rows
